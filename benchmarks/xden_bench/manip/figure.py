"""Success against the error of the centre of mass: the ladder, and methods beside it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from pathlib import Path
from typing import Any, Final

from xden1k.errors import DataError, require
from xden_bench.manip.table import Line, is_step

__all__ = ["draw_ladder"]

MARKERS: Final = "osD^vP*X"
"""Of rows that are no steps."""


def draw_ladder(lines: Sequence[Line], title: str, path: Path) -> None:
    """Draw the stratum *off*: success of every row that has a centre against its axial error.

    Steps of the ladder with the bootstrap interval over objects, others as points.

    Parameters
    ----------
    lines
        Of a table.
    title
        What the figure says above: that all is simulated, and how.
    path
        The picture to write.

    Raises
    ------
    DataError
        If the table has no step of the ladder but the true centre.
    MissingExtraError
        If matplotlib is not installed.
    """
    off = [one for one in lines if one.stratum == "off" and one.axial_error_cm is not None]
    steps = [one for one in off if is_step(one.name)]
    if len(steps) < 2:
        raise DataError("a figure needs rows of the ladder: `true` and its shifts")
    require("matplotlib", "view")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 4), layout="constrained")
    axes: Any = figure.add_subplot()
    for sign, marker in (("+", ">"), ("-", "<")):
        side = [one for one in steps if one.name == "true" or one.name.startswith(f"true{sign}")]
        side.sort(key=lambda one: one.axial_error_cm or 0.0)
        shares = [one.success for one in side]
        ends = [one.over_objects.interval or (one.success, one.success) for one in side]
        axes.errorbar(
            [one.axial_error_cm for one in side],
            shares,
            [
                [share - low for share, (low, _) in zip(shares, ends, strict=True)],
                [high - share for share, (_, high) in zip(shares, ends, strict=True)],
            ],
            marker=marker,
            capsize=3,
            label=f"true centre, shifted to {sign}",
        )
    for (place, names), marker in zip(_points(off).items(), cycle(MARKERS)):
        axes.plot(*place, marker, color="black", fillstyle="none", label=", ".join(names))
    axes.set(
        xlabel="error of the centre of mass along the longest axis, cm (mean over objects)",
        ylabel="picks held",
        ylim=(-0.02, 1.02),
        title=title,
    )
    figure.legend(loc="outside right upper", fontsize="small")
    figure.savefig(path, dpi=110)


def _points(lines: Sequence[Line]) -> dict[tuple[float, float], list[str]]:
    """Names of the rows that are no steps, by where they are."""
    points: dict[tuple[float, float], list[str]] = {}
    for one in lines:
        if not is_step(one.name) and one.axial_error_cm is not None:
            place = round(one.axial_error_cm, 2), round(one.success, 3)
            points.setdefault(place, []).append(one.name)
    return points
