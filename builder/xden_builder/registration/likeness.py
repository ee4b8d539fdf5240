"""How far apart two poses put an object, whatever its symmetry."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from typing import Final

import numpy as np
import trimesh
from jaxtyping import Bool, Float64, Int
from scipy.spatial import cKDTree

from xden1k.values.arrays import Vec3
from xden_builder.registration.body import Body
from xden_builder.registration.placement import RigidPlacement

__all__ = ["Likeness", "unlike"]

POINTS, PROBES = 12000, 150
"""Spread over all surfaces of a kind to measure distances to, and over a part to measure from: with
a quarter of the points a round body turned about its axis seems to move by a hundredth of itself.
"""
FEWEST: Final = 100
NEIGHBOURS: Final = 4
"""Points that a distance is measured to, so that one on the other side of an edge does no harm."""
FAR_QUANTILE: Final = 0.9
FAR_SHARE: Final = 1 - FAR_QUANTILE
"""Of the distances of a part, and how many of them are greater."""
STRICT_FAR_SHARE: Final = 0.02
"""The same where a screwdriver's tip or a marker's clip must not be forgotten."""
LISTED_FAR_SHARE: Final = 0.05
"""The same where a pose is listed beside another: as much of a part as `evaluate` lets be wrong."""
OWN_TIMES: Final = 2.0
"""Of what a part seems to be off where it stands, since points are few: less is no distance."""


class Likeness:
    """Distances between poses of one body.

    Parts of like attenuation are one kind: an object turned such that each kind of part comes to
    lie on its own kind looks, and weighs, the same.

    Parameters
    ----------
    body
        The object.
    sight
        Along which it is hardly told where it is, nor how large: poses that differ by these alone
        are alike.
    kinds
        Shape (K,): number of each part's kind, if not by its attenuation.
    """

    def __init__(
        self,
        body: Body,
        sight: Vec3 | None = None,
        kinds: Int[np.ndarray, "k"] | None = None,
    ) -> None:
        self._sight, self._middle_cm = sight, body.spin[0]
        self._far_share, self._own_times = FAR_SHARE, 0.0
        levels = np.round(np.log(body.lac_per_cm), 1)
        self.kinds = np.unique(levels, return_inverse=True)[1] if kinds is None else kinds
        self._kinds = [
            _Kind([mesh for mesh, its in zip(body.meshes, self.kinds, strict=True) if its == kind])
            for kind in np.unique(self.kinds)
        ]

    @property
    def strict(self) -> Likeness:
        """The same, of which a smaller share of a part's surface makes poses unlike."""
        other = copy(self)
        other._far_share = STRICT_FAR_SHARE
        return other

    @property
    def listing(self) -> Likeness:
        """The same, by a twentieth of a part, beyond what few points make of a large one."""
        other = copy(self)
        other._far_share, other._own_times = LISTED_FAR_SHARE, OWN_TIMES
        return other

    def distance_cm(self, one: RigidPlacement, other: RigidPlacement) -> float:
        """How far the worst part's surface is from its kind's."""
        return max(
            float(np.quantile(kind.nearest_cm(points_cm), FAR_QUANTILE, axis=1).max())
            for kind, points_cm in self._moved(one, other)
        )

    def apart(self, one: RigidPlacement, other: RigidPlacement, least_cm: float) -> bool:
        """Whether the worst part's surface is so far from its kind's; quick where it is."""
        return any(
            bool((self._far(kind, points_cm, least_cm).mean(axis=1) > self._far_share).any())
            for kind, points_cm in self._moved(one, other)
        )

    def _far(
        self, kind: _Kind, points_cm: Float64[np.ndarray, "n 3"], least_cm: float
    ) -> Bool[np.ndarray, "parts probes"]:
        """Which probes are so far from their kind's surface, or farther than is felt."""
        least = np.maximum(least_cm, self._own_times * kind.own_cm)[:, None]
        return np.asarray(kind.nearest_cm(points_cm, float(least.max())) >= least)

    def _moved(
        self, one: RigidPlacement, other: RigidPlacement
    ) -> Iterator[tuple[_Kind, Float64[np.ndarray, "n 3"]]]:
        """Yield each kind with its probes in the other pose, as the one sees them."""
        there = other if self._sight is None else self._as_deep(one, other, self._sight)
        back = one.rotation / one.scale
        for kind in self._kinds:
            yield kind, (there.apply(kind.probes_cm) - one.translation_cm) @ back

    def _as_deep(self, one: RigidPlacement, other: RigidPlacement, sight: Vec3) -> RigidPlacement:
        """Put the middle of the volume, which no symmetry moves, as deep as in the one pose."""
        here, there = (each.apply(self._middle_cm[None])[0] for each in (one, other))
        middle_cm = there - ((there - here) @ sight) * sight
        shift = middle_cm - one.scale * other.rotation @ self._middle_cm
        return RigidPlacement(other.rotation, shift, one.scale)


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
        self.own_cm = np.quantile(self.nearest_cm(self.probes_cm), 1 - LISTED_FAR_SHARE, axis=1)

    def nearest_cm(
        self, points_cm: Float64[np.ndarray, "n 3"], most_cm: float = np.inf
    ) -> Float64[np.ndarray, "parts probes"]:
        """Distances along the normals, or beyond the spacing of the points.

        What is farther than asked for may be given as infinitely far.
        """
        bound_cm = float(np.hypot(most_cm, self._spacing_cm))
        away_cm, places = self._tree.query(points_cm, NEIGHBOURS, distance_upper_bound=bound_cm)
        near, places = np.isfinite(away_cm[:, 0]), places.clip(max=self._tree.n - 1)
        off_cm = points_cm[near, None] - self._tree.data[places[near]]
        above_cm2 = np.einsum("nki,nki->nk", off_cm, self._normals[places[near]]) ** 2
        beside_cm2 = (away_cm[near] ** 2 - above_cm2 - self._spacing_cm**2).clip(min=0)
        nearest_cm = np.full(len(points_cm), np.inf)
        nearest_cm[near] = np.sqrt(above_cm2 + beside_cm2).min(axis=1)
        return nearest_cm.reshape(-1, PROBES)


def _sampled(
    mesh: trimesh.Trimesh, count: int, seed: int
) -> tuple[Float64[np.ndarray, "n 3"], Float64[np.ndarray, "n 3"]]:
    """Points spread over a surface, and its normals there."""
    points_cm, faces = trimesh.sample.sample_surface(mesh, count, seed=seed)
    return np.asarray(points_cm), mesh.face_normals[faces]


def unlike(
    placements: Sequence[RigidPlacement],
    is_apart: Callable[[RigidPlacement, RigidPlacement], bool],
    most: int,
) -> list[int]:
    """Pick, in their order, placements that are apart from all picked before; gives indices."""
    kept: list[int] = []
    for number, placement in enumerate(placements):
        if len(kept) == most:
            break
        if all(is_apart(placements[k], placement) for k in kept):
            kept.append(number)
    return kept
