"""How time and memory grow with pixels, faces and parts: ``xden-build speed --growth``.

One of the three is varied at a time. The object is a casing with the other parts inside it, the
same in size whatever the case.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
import trimesh

from xden1k.errors import require
from xden1k.rays import PathLengths, path_lengths
from xden1k.values.views import ViewGeometry, XRayView
from xden_builder.fit import fit_lac
from xden_builder.reconstruct.settings import BuildSettings
from xden_builder.speed.scenes import nested_parts, radiograph, two_views
from xden_builder.speed.timing import keep_to_one_thread, peak_mb, timed
from xden_builder.workers import WorkerDiedError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["AXES", "BASE", "Case", "Cost", "along", "cases", "costs", "draw_growth"]

Axis = Literal["pixels", "faces", "parts"]

REPEATS = 5
SEED = 0


@dataclass(frozen=True, slots=True)
class Case:
    """How large a problem is.

    Parameters
    ----------
    pixels
        Along each side of both radiographs.
    faces
        Of all parts together.
    parts
        How many.
    """

    pixels: int
    faces: int
    parts: int


BASE: Final = Case(pixels=1024, faces=50_000, parts=6)
AXES: Final[dict[Axis, tuple[int, ...]]] = {
    "pixels": (512, 1024, 2048),
    "faces": (10_000, 50_000, 174_000, 600_000),
    "parts": (1, 6, 20, 40),
}
"""What each of the three is varied over, the others as in ``BASE``."""

MEASURES: Final[tuple[dict[str, tuple[str, str]], ...]] = (
    {"lengths_s": ("path lengths", "#1f7a8c"), "fit_s": ("fit", "#d1742a")},
    {
        "lengths_mb": ("with path lengths", "#1f7a8c"),
        "fit_mb": ("and with the fit", "#d1742a"),
        "start_mb": ("before: libraries, making the meshes", "#9a9a94"),
    },
)
"""What is drawn in the panels of each row: label and colour."""
X_LABELS: Final[dict[Axis, str]] = {
    "pixels": "pixels along each side",
    "faces": "faces, all parts",
    "parts": "parts",
}
Y_LABELS = ("processor time, s", "peak memory, MB")


@dataclass(frozen=True, slots=True)
class Cost:
    """What a case takes, in a process of its own.

    Parameters
    ----------
    case
        The case.
    lengths_s, fit_s
        Processor seconds on one thread, as in the builder's workers, for both views: path lengths
        with as many rays a pixel as the builder takes, and the fit of one attenuation coefficient
        per part.
    start_mb
        Largest memory (resident set, 10^6 bytes) of the process with libraries and meshes loaded.
    lengths_mb
        The same once path lengths are there.
    fit_mb
        The same once the radiographs are made and fitted.
    """

    case: Case
    lengths_s: float
    fit_s: float
    start_mb: float
    lengths_mb: float
    fit_mb: float

    def to_dict(self) -> dict[str, float]:
        """Values for JSON."""
        case = {name: getattr(self.case, name) for name in AXES}
        return case | {name: getattr(self, name) for name in self.__slots__ if name != "case"}


def along(axis: Axis) -> list[Case]:
    """Cases in which one of the three varies."""
    return [replace(BASE, **{axis: value}) for value in AXES[axis]]


def cases() -> list[Case]:
    """All cases, each once."""
    return list(dict.fromkeys(case for axis in AXES for case in along(axis)))


def costs(chosen: Sequence[Case]) -> Iterator[Cost]:
    """Measure cases one after the other, each in a fresh process.

    Raises
    ------
    WorkerDiedError
        If a process is killed.
    """
    _in_fresh_process(replace(BASE, pixels=64, faces=100))  # compiles, which is kept on disk
    yield from map(_in_fresh_process, chosen)


def _in_fresh_process(case: Case) -> Cost:
    # Linux hands the peak memory of a process on to the programs it starts. A child of the fork
    # server starts no program, and the server is small.
    context = get_context("forkserver")
    with ProcessPoolExecutor(1, context, initializer=keep_to_one_thread) as pool:
        try:
            return pool.submit(_measure, case).result()
        except BrokenProcessPool as err:
            raise WorkerDiedError(f"{case}: its process died; is there enough memory?") from err


def _measure(case: Case) -> Cost:
    small = two_views(64)
    fit_lac(_radiographs(_project(nested_parts(20, 1), small), small))  # loads compiled code
    parts, views = nested_parts(case.faces, case.parts), two_views(case.pixels)
    start_mb = peak_mb()
    lengths = _project(parts, views)
    lengths_mb = peak_mb()
    pairs = _radiographs(lengths, views)
    fit_lac(pairs)
    fit_mb = peak_mb()
    lengths_s, _ = timed(lambda: _project(parts, views), REPEATS)
    fit_s, _ = timed(lambda: fit_lac(pairs), REPEATS)
    return Cost(case, lengths_s, fit_s, start_mb, lengths_mb, fit_mb)


def _project(parts: Sequence[trimesh.Trimesh], views: Sequence[ViewGeometry]) -> list[PathLengths]:
    subrays = BuildSettings().subrays
    return [path_lengths(parts, range(len(parts)), view, subrays) for view in views]


def _radiographs(
    lengths: Sequence[PathLengths], views: Sequence[ViewGeometry]
) -> list[tuple[PathLengths, XRayView]]:
    rng = np.random.default_rng(SEED)
    lac = np.append(np.linspace(0.3, 0.6, lengths[0].lengths_cm.shape[2] - 1), 0.2)
    return [
        (each, radiograph(name, view, each, lac, rng))
        for name, each, view in zip(("pa", "lat"), lengths, views, strict=True)
    ]


def draw_growth(rows: Sequence[Cost], path: Path) -> None:
    """Draw time and memory along each axis, both on logarithmic scales.

    Parameters
    ----------
    rows
        Costs of all :func:`cases`.
    path
        The PNG to write.

    Raises
    ------
    MissingExtraError
        If matplotlib (extra ``view``) is not installed.
    """
    require("matplotlib", "view")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    cost = {row.case: row for row in rows}
    figure = Figure(figsize=(11, 6.6), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(2, len(AXES), sharex="col", sharey="row")
    for (axis, values), column in zip(AXES.items(), panels.T, strict=True):
        chosen = [cost[case] for case in along(axis)]
        for panel, measures in zip(column, MEASURES, strict=True):
            _draw_panel(panel, values, chosen, measures)
        _draw_proportion(column[0], axis, cost[BASE].lengths_s)
        column[1].set_xlabel(f"{X_LABELS[axis]}\n(else {_short(getattr(BASE, axis))})")
    for panel, label in zip(panels[:, 0], Y_LABELS, strict=True):
        panel.set_ylabel(label)
        panel.legend(frameon=False, fontsize=9)
    figure.savefig(path, dpi=120, metadata={"Software": None})


def _draw_panel(
    panel: Axes,
    values: Sequence[int],
    chosen: Sequence[Cost],
    measures: Mapping[str, tuple[str, str]],
) -> None:
    for name, (label, colour) in measures.items():
        heights = [getattr(each, name) for each in chosen]
        panel.loglog(values, heights, "o-", color=colour, label=label, markersize=4.5)
    panel.set_xticks(values, [_short(value) for value in values])
    panel.set_xticks([], minor=True)
    from matplotlib.ticker import LogLocator

    for shown in (panel.yaxis.set_major_formatter, panel.yaxis.set_minor_formatter):
        shown(_short)
    panel.yaxis.set_minor_locator(LogLocator(subs=(0.2, 0.3, 0.5)))
    panel.grid(visible=True, which="both", color="#e4e4e0", linewidth=0.6)
    panel.spines[["top", "right"]].set_visible(False)


def _draw_proportion(panel: Axes, axis: Axis, base_s: float) -> None:
    """Show what time in proportion to all pixels, faces or parts would be."""
    power = 2 if axis == "pixels" else 1
    ends = np.array([AXES[axis][0], AXES[axis][-1]])
    times = base_s * (ends / getattr(BASE, axis)) ** power
    panel.plot(ends, times, ":", color="#9a9a94", zorder=1, label="in proportion")


def _short(value: float, _: object = None) -> str:
    return f"{value / 1000:g}k" if value >= 10_000 else f"{value:g}"
