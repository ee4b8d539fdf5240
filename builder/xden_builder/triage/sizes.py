"""How large, or how long, the objects of a folder are beside their meshes, all together."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from xden_builder.triage.findings import Findings

__all__ = ["FolderSize", "folder_size", "middle_of"]

LEAST_OBJECTS: Final = 5
CLEARLY_SD: Final = 4.0
CLEARLY: Final = 0.002
"""All are said to be of another size if their median is this many of its standard deviations, and
this share, off that of the meshes. Of 15 simulated scanners without such a fault it was 0.06 % off
at most; a pitch 2 % wrong shows as 1.5 %, one of two sources 5 % too near as 0.4 %."""
MEDIAN_SD: Final = 1.2533
"""Standard deviation of the median of normal values, over that of their mean."""
MAD_SD: Final = 1.4826
"""Standard deviation of normal values over their median absolute deviation."""


@dataclass(frozen=True, slots=True)
class FolderSize:
    """How large the objects of a folder are beside their meshes.

    Parameters
    ----------
    factor
        Median of length of the object, or of its shadow, over that of its meshes.
    sd
        Its standard deviation, by how far the objects are apart.
    objects
        How many it is of.
    """

    factor: float
    sd: float
    objects: int

    @property
    def contradicts(self) -> bool:
        """Whether what all have in common, the geometry that was told, must be wrong.

        Examples
        --------
        >>> [FolderSize(factor, 0.0004, 9).contradicts for factor in (1.001, 0.9965)]
        [False, True]
        """
        return self.off_by(CLEARLY)

    def off_by(self, least: float) -> bool:
        """Whether it is off by so much at least, and by more than what chance makes."""
        off = abs(self.factor - 1)
        return self.objects >= LEAST_OBJECTS and off > max(CLEARLY_SD * self.sd, least)


def folder_size(judged: Iterable[Findings]) -> FolderSize | None:
    """Take the sizes of all objects together; None where none has one that it tells."""
    return middle_of(each.size_factor for each in judged if each.size_factor is not None)


def middle_of(factors: Iterable[float]) -> FolderSize | None:
    """Take factors together by their median; None where there are none.

    One object in another unit, or with a part missing, says nothing of the rest.
    """
    told = np.array(list(factors))
    if not len(told):
        return None
    middle = float(np.median(told))
    spread = MAD_SD * float(np.median(np.abs(told - middle)))
    sd = MEDIAN_SD * spread / np.sqrt(len(told))
    return FolderSize(round(middle, 5), round(float(sd), 5), len(told))
