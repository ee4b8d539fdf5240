"""One extra filter for all objects of a folder, by the clues of some of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float64

from xden_builder.poly.survey import FILTERS_MM_CU, Clue

__all__ = ["Hardness", "join"]

STEP_MM: Final = 0.002
GRID_MM: Final = np.arange(FILTERS_MM_CU[0], FILTERS_MM_CU[-1] + STEP_MM / 2, STEP_MM)
TOLD_RIGHT: Final = ((0.6, 0.01), (0.4, 0.15))
"""Before any image: share and standard deviation in mm of copper of files that are right but for
rounding and a few kV, and of those that leave a filter out."""
ASTRAY_SHARE: Final = 0.25
ASTRAY_SD: Final = 0.35
"""Share of clues that lead astray (labels that err, grades, pores), and how far."""
CLEARLY_SD: Final = 3.0
CLEARLY_MM: Final = 0.02
"""A filter is said to be missing if it is this many deviations from none, and this thick."""
TWO_TUBES: Final = 12.0
"""Logarithm of how much likelier two filters must make the clues than one."""
APART_MM: Final = 0.05
LEAST_OBJECTS: Final = 3
"""Two tubes are said where their filters differ by so much, and each has so many objects."""


@dataclass(frozen=True, slots=True)
class Hardness:
    """How much harder than told a folder's beam is.

    Parameters
    ----------
    filter_mm_cu, sd_mm_cu
        Extra copper that explains the images, and its standard deviation; negative where less
        filters it than told.
    clues, objects
        How many it rests on, of how many objects.
    two_tubes_mm_cu
        Two filters that explain the images far better than one, if there are such.
    """

    filter_mm_cu: float
    sd_mm_cu: float
    clues: int
    objects: int
    two_tubes_mm_cu: tuple[float, float] | None

    @property
    def contradicts(self) -> bool:
        """Whether the told filter does not explain the images."""
        least = max(CLEARLY_SD * self.sd_mm_cu, CLEARLY_MM)
        return abs(self.filter_mm_cu) > least


def join(clues: Mapping[str, Sequence[Clue]], *, calibrated: bool = False) -> Hardness:
    """Weigh all clues together, by Bayes' rule on a grid.

    Each clue is normally distributed about 0 at the right filter, or one of those that lead
    astray.

    Parameters
    ----------
    clues
        By object; without any, the told filter is believed.
    calibrated
        Whether the told filter was measured, so that none can have been left out.
    """
    count, used = sum(map(len, clues.values())), sum(map(bool, clues.values()))
    if not count:
        return Hardness(0.0, TOLD_RIGHT[0][1], 0, 0, None)
    curves = np.array(
        [
            np.sum([np.zeros(len(GRID_MM)), *map(_log_likelihood, mine)], axis=0)
            for mine in clues.values()
        ]
    )
    log_posterior = curves.sum(axis=0) + _log_prior(TOLD_RIGHT[:1] if calibrated else TOLD_RIGHT)
    chance = np.exp(log_posterior - log_posterior.max())
    chance /= chance.sum()
    mean = float(chance @ GRID_MM)
    sd = float(np.sqrt(chance @ (GRID_MM - mean) ** 2))
    return Hardness(round(mean, 4), round(sd, 4), count, used, _two_tubes(curves))


def _log_likelihood(clue: Clue) -> Float64[np.ndarray, "filters"]:
    off = np.interp(GRID_MM, FILTERS_MM_CU, clue.log_ratio)
    right = (1 - ASTRAY_SHARE) * _normal(off, clue.sd)
    return np.asarray(
        np.log(right + ASTRAY_SHARE * _normal(off, float(np.hypot(clue.sd, ASTRAY_SD))))
    )


def _log_prior(shares: Sequence[tuple[float, float]]) -> Float64[np.ndarray, "filters"]:
    chance = sum(share * _normal(GRID_MM, sd) for share, sd in shares)
    return np.asarray(np.log(np.maximum(chance, np.finfo(float).tiny)))


def _normal(off: Float64[np.ndarray, "n"], sd: float) -> Float64[np.ndarray, "n"]:
    return np.asarray(np.exp(-0.5 * (off / sd) ** 2) / sd)


def _two_tubes(curves: Float64[np.ndarray, "objects filters"]) -> tuple[float, float] | None:
    """Find two filters of which each object has one, if that explains the clues far better."""
    one = float(curves.sum(axis=0).max())
    few = np.arange(0, len(GRID_MM), 5)
    best, found = one + TWO_TUBES, None
    for first in few:
        for second in few[GRID_MM[few] > GRID_MM[first] + APART_MM]:
            pair = curves[:, [first, second]]
            least = min(np.bincount(pair.argmax(axis=1), minlength=2))
            if least >= LEAST_OBJECTS and (both := float(pair.max(axis=1).sum())) > best:
                best, found = both, (float(GRID_MM[first]), float(GRID_MM[second]))
    return found
