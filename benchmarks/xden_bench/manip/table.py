"""Rows side by side: success with intervals, and against ``uniform`` and ``true`` in pairs."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float64

from xden1k.errors import DataError
from xden_bench.manip.item import STRATA, Stratum
from xden_bench.manip.protocol import StatisticsRules
from xden_bench.manip.rows import Row
from xden_bench.manip.statistics import Decided, decided, wilson_interval
from xden_bench.scoring.bootstrap import Estimate, estimate

__all__ = ["AGAINST", "Against", "Line", "compared_with", "is_step", "ladder", "lines"]

AGAINST: Final = ("uniform", "true")
"""With which every row is compared."""


@dataclass(frozen=True, slots=True)
class Against:
    """A row beside another, on the same trials.

    Parameters
    ----------
    difference
        Of the shares of success, with the bootstrap interval over objects.
    without_one
        Lowest and highest difference with each object left out in turn.
    objects
        With which one of them succeeds more often.
    """

    difference: Estimate
    without_one: tuple[float, float]
    objects: Decided


@dataclass(frozen=True, slots=True)
class Line:
    """A row on one stratum.

    Parameters
    ----------
    name, stratum
        Which.
    success, wilson
        Share of trials, and its interval as if they were independent.
    over_objects
        The same share with the bootstrap interval over objects.
    against
        By the name of the other row.
    axial_error_cm
        Mean absolute error of the centre along the longest axis; None where none was taken.
    expected
        Share of success that the ladder has at these errors; None where it does not reach.
    figures
        Means over trials: wrist moment, turn, score, width, height, lever.
    """

    name: str
    stratum: Stratum
    success: float
    wilson: tuple[float, float]
    over_objects: Estimate
    against: Mapping[str, Against]
    axial_error_cm: float | None
    expected: float | None
    figures: Mapping[str, float]


FIGURES: Final = ("wrist_moment_nm", "turn_deg", "score", "width_cm", "height_cm", "lever_cm")


def lines(rows: Sequence[Row], rules: StatisticsRules) -> tuple[Line, ...]:
    """Compare rows on each stratum.

    Parameters
    ----------
    rows
        Of one table.
    rules
        Of the bootstrap.

    Raises
    ------
    DataError
        If there is no row of ``uniform`` or ``true``.
    """
    others = compared_with(rows)
    return tuple(_line(row, stratum, others, rows, rules) for stratum in STRATA for row in rows)


def compared_with(rows: Sequence[Row]) -> dict[str, Row]:
    """Rows with which every other is compared, by name.

    Raises
    ------
    DataError
        If there is no row of ``uniform`` or ``true``.
    """
    others = {row.name: row for row in rows if row.name in AGAINST}
    if missing := [name for name in AGAINST if name not in others]:
        raise DataError(f"every row is compared with {missing[0]!r}, but there is no row of it")
    return others


def _line(
    row: Row,
    stratum: Stratum,
    others: Mapping[str, Row],
    rows: Sequence[Row],
    rules: StatisticsRules,
) -> Line:
    held = row.held(stratum)
    errors = row.axial_errors_cm(stratum)
    (over_objects,) = estimate(held.mean(axis=1)[:, None], rules.resamples, rules.seed)
    return Line(
        name=row.name,
        stratum=stratum,
        success=float(held.mean()),
        wilson=wilson_interval(int(held.sum()), held.size),
        over_objects=over_objects,
        against={
            name: _against(held, other.held(stratum), rules) for name, other in others.items()
        },
        axial_error_cm=None if np.isnan(errors).any() else float(np.abs(errors).mean()),
        expected=_expected(errors, ladder(rows, stratum)),
        figures={name: float(row.figures(stratum, name).mean()) for name in FIGURES},
    )


def _against(
    a: Bool[np.ndarray, "objects trials"],
    b: Bool[np.ndarray, "objects trials"],
    rules: StatisticsRules,
) -> Against:
    differences = a.mean(axis=1) - b.mean(axis=1)
    (difference,) = estimate(differences[:, None], rules.resamples, rules.seed)
    rest = (differences.sum() - differences) / max(len(differences) - 1, 1)
    return Against(difference, (float(rest.min()), float(rest.max())), decided(differences))


@dataclass(frozen=True, slots=True, eq=False)
class Ladder:
    """Success of the true centre shifted along the longest axis.

    Parameters
    ----------
    shifts_cm
        Shape (shifts,), ascending.
    success
        Shape (shifts, objects).
    """

    shifts_cm: Float64[np.ndarray, "shifts"]
    success: Float64[np.ndarray, "shifts objects"]


def is_step(name: str) -> bool:
    """Whether a row is one of the ladder: the true centre, or that shifted.

    Examples
    --------
    >>> [is_step(name) for name in ("true", "true+2cm", "true-mass-uniform")]
    [True, True, False]
    """
    return re.fullmatch(r"true([+-][\d.]+cm)?", name) is not None


def ladder(rows: Sequence[Row], stratum: Stratum) -> Ladder:
    """Take the ladder from the rows of ``true`` and its shifts, of which there is one at least."""
    steps = [
        (float(np.mean(row.axial_errors_cm(stratum))), row.held(stratum).mean(axis=1))
        for row in rows
        if is_step(row.name)
    ]
    steps.sort(key=lambda step: step[0])
    shifts = np.array([shift for shift, _ in steps])
    return Ladder(shifts, np.stack([share for _, share in steps]))


def _expected(errors_cm: Float64[np.ndarray, "objects"], steps: Ladder) -> float | None:
    """Mean over objects of the ladder of each, between its steps, at the error of each."""
    if np.isnan(errors_cm).any() or len(steps.shifts_cm) < 2:
        return None
    if errors_cm.min() < steps.shifts_cm[0] or errors_cm.max() > steps.shifts_cm[-1]:
        return None
    shares = [
        np.interp(error, steps.shifts_cm, share)
        for error, share in zip(errors_cm, steps.success.T, strict=True)
    ]
    return float(np.mean(shares))
