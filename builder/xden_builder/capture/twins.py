"""Parts that were annotated twice."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Final

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from xden1k.errors import DataError
from xden_builder.capture.parts import CapturePart

__all__ = ["check_twins"]

SAME_SHARE: Final = 0.01
"""Of its size and volume: meshes that differ by less are one."""
SAME_SURFACE_SHARE: Final = 0.05
FEW_POINTS, MANY_POINTS = 300, 5000
"""Nine of ten points of one surface are nearer to those of the other than this share of the size;
points of the other lie about half as far from each other."""


def check_twins(parts: Sequence[CapturePart]) -> None:
    """Refuse two parts of the same mesh: one that was annotated twice.

    Raises
    ------
    DataError
        Naming both.
    """
    for one, other in combinations(parts, 2):
        if _alike(one.mesh, other.mesh):
            raise DataError(
                f"parts {one.name} and {other.name} are the same mesh in the same place: expected "
                "each part once"
            )


def _alike(one: trimesh.Trimesh, other: trimesh.Trimesh) -> bool:
    """Say whether two meshes fill the same space, whatever their triangles."""
    size = float(np.ptp(one.bounds, axis=0).max())
    return (
        float(np.abs(one.bounds - other.bounds).max()) < SAME_SHARE * size
        and abs(float(one.volume / other.volume) - 1) < SAME_SHARE
        and float(np.abs(one.center_mass - other.center_mass).max()) < SAME_SHARE * size
        and _apart_cm(one, other) < SAME_SURFACE_SHARE * size
    )


def _apart_cm(one: trimesh.Trimesh, other: trimesh.Trimesh) -> float:
    """Distance of most of a surface from another one, by points at random on both."""
    few, many = (
        trimesh.sample.sample_surface(mesh, count, seed=0)[0]
        for mesh, count in ((one, FEW_POINTS), (other, MANY_POINTS))
    )
    return float(np.quantile(cKDTree(many).query(few)[0], 0.9))
