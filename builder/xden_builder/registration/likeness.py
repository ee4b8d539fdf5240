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

POINTS, PROBES = 1500, 150
"""Spread over all surfaces of a kind to measure distances to, and over a part to measure from."""
FEWEST: Final = 15
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
        """How far the worst part's surface is from its kind's, beyond the points' own spacing."""
        back = one.rotation / one.scale
        return max(
            kind.distance_cm((other.apply(kind.probes_cm) - one.translation_cm) @ back)
            for kind in self._kinds
        )


class _Kind:
    """Surfaces of parts, as points."""

    def __init__(self, meshes: Sequence[trimesh.Trimesh]) -> None:
        areas = np.array([mesh.area for mesh in meshes])
        counts = np.maximum((POINTS * areas / areas.sum()).astype(int), FEWEST).tolist()
        points = [_sampled(mesh, count, 0) for mesh, count in zip(meshes, counts, strict=True)]
        self._tree = cKDTree(np.concatenate(points))
        self.probes_cm = np.concatenate([_sampled(mesh, PROBES, 1) for mesh in meshes])
        self._spacings_cm = self._far_cm(self.probes_cm)

    def _far_cm(self, points_cm: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "m"]:
        """Of each part."""
        away_cm = self._tree.query(points_cm)[0].reshape(-1, PROBES)
        return np.asarray(np.quantile(away_cm, FAR_QUANTILE, axis=1))

    def distance_cm(self, points_cm: Float64[np.ndarray, "n 3"]) -> float:
        beyond = self._far_cm(points_cm) ** 2 - self._spacings_cm**2
        return float(max(beyond.max(), 0.0) ** 0.5)


def _sampled(mesh: trimesh.Trimesh, count: int, seed: int) -> Float64[np.ndarray, "n 3"]:
    return np.asarray(trimesh.sample.sample_surface(mesh, count, seed=seed)[0])


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
