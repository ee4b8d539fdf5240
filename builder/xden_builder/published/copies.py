"""Parts of one object that look like copies of one thing: wheels, cells, screws, halves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from xden_builder.published.survey import PartSeen

__all__ = ["copies"]

VOLUME_OFF: Final = 0.03
SHADOW_OFF: Final = 0.1
LAC_OFF: Final = 0.5
"""Logarithms of the ratios of volume, of mean shadow and of coefficient up to which two parts are
taken for copies: voxels measure volumes to a per cent or two, shadows depend on how a part lies,
and the coefficients of two copies scatter as any do."""


def copies(parts: Sequence[PartSeen]) -> list[list[int]]:
    """List for each part of an object the others that look like copies of it, by their places."""
    figures = np.log([_figures(part) for part in parts]).reshape(-1, 3)
    off = np.abs(figures[:, None] - figures)
    alike = (off < (VOLUME_OFF, SHADOW_OFF, LAC_OFF)).all(axis=2)
    np.fill_diagonal(alike, val=False)
    return [np.flatnonzero(row).tolist() for row in alike]


def _figures(part: PartSeen) -> tuple[float, float, float]:
    """Volume, sum of the shadows along three axes, and coefficient."""
    return part.filled_voxels, math.fsum(part.rays), part.lac_per_cm
