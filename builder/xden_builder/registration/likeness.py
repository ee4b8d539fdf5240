"""How far apart two poses put an object, whatever its symmetry."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import trimesh
from jaxtyping import Float64
from scipy.spatial import cKDTree

from xden_builder.registration.body import Body
from xden_builder.registration.placement import RigidPlacement

__all__ = ["Likeness", "unlike"]

POINTS, PROBES = 3000, 150
"""Spread over all surfaces of a kind to measure distances to, and over a part to measure from."""
FEWEST: Final = 15
NEIGHBOURS: Final = 4
"""Points that a distance is measured to, so that one on the other side of an edge does no harm."""
FAR_QUANTILE: Final = 0.9
"""Of the distances of a part."""


class Likeness:
    """Distances between poses of one body.

    Parts of like attenuation are one kind: an object turned such that each kind of part comes to
    lie on its own kind looks, and weighs, the same.
    """

    def __init__(self, body: Body) -> None:
        levels = np.round(np.log(body.lac_per_cm), 1)
        self._kinds = [
            _Kind([mesh for mesh, its in zip(body.meshes, levels, strict=True) if its == level])
            for level in np.unique(levels)
        ]

    def distance_cm(self, one: RigidPlacement, other: RigidPlacement) -> float:
        """How far the worst part's surface is from its kind's."""
        back = one.rotation / one.scale
        return max(
            kind.distance_cm((other.apply(kind.probes_cm) - one.translation_cm) @ back)
            for kind in self._kinds
        )


class _Kind:
    """Surfaces of parts, as points with normals."""

    def __init__(self, meshes: Sequence[trimesh.Trimesh]) -> None:
        areas = np.array([mesh.area for mesh in meshes])
        counts = np.maximum((POINTS * areas / areas.sum()).astype(int), FEWEST).tolist()
        sampled = [_sampled(mesh, count, 0) for mesh, count in zip(meshes, counts, strict=True)]
        points_cm, self._normals = (np.concatenate(each) for each in zip(*sampled, strict=True))
        self._tree = cKDTree(points_cm)
        self.probes_cm = np.concatenate([_sampled(mesh, PROBES, 1)[0] for mesh in meshes])
        self._spacing_cm = float(self._tree.query(self.probes_cm)[0].max())

    def distance_cm(self, points_cm: Float64[np.ndarray, "n 3"]) -> float:
        """Distance of the worst part: along the normals, or beyond the spacing of the points."""
        away_cm, places = self._tree.query(points_cm, k=NEIGHBOURS)
        off_cm = points_cm[:, None] - self._tree.data[places]
        above_cm2 = np.einsum("nki,nki->nk", off_cm, self._normals[places]) ** 2
        beside_cm2 = (away_cm**2 - above_cm2 - self._spacing_cm**2).clip(min=0)
        nearest_cm = np.sqrt(above_cm2 + beside_cm2).min(axis=1).reshape(-1, PROBES)
        return float(np.quantile(nearest_cm, FAR_QUANTILE, axis=1).max())


def _sampled(
    mesh: trimesh.Trimesh, count: int, seed: int
) -> tuple[Float64[np.ndarray, "n 3"], Float64[np.ndarray, "n 3"]]:
    """Points spread over a surface, and its normals there."""
    points_cm, faces = trimesh.sample.sample_surface(mesh, count, seed=seed)
    return np.asarray(points_cm), mesh.face_normals[faces]


def unlike(
    placements: Sequence[RigidPlacement], likeness: Likeness, apart_cm: float, most: int
) -> list[int]:
    """Pick, in their order, placements that are unlike all picked before; gives indices."""
    kept: list[int] = []
    for number, placement in enumerate(placements):
        if len(kept) == most:
            break
        if all(likeness.distance_cm(placements[k], placement) >= apart_cm for k in kept):
            kept.append(number)
    return kept
