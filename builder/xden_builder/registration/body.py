"""The object that is to be found: its parts about their middle, as points that attenuate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import permutations, product
from typing import Final

import numpy as np
import trimesh
from jaxtyping import Float64

from xden1k.errors import DataError
from xden1k.rays import CubeGrid, part_fractions
from xden1k.values.arrays import Vec3
from xden_builder.capture.space import Space
from xden_builder.registration.placement import RigidPlacement

__all__ = ["Body", "Cloud", "spread_directions"]

SPIN_CELLS: Final = 24
DIRECTIONS: Final = 100
"""In which the outermost point of the object is looked for."""
SQUARE: Final = 0.06
"""Logarithm of the ratio of sides of a box that are taken for equal."""
FLAT_SHARE: Final = 1e-4
"""Of the largest extent: what is thinner has no volume."""


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """Points that stand for small volumes.

    Parameters
    ----------
    points_cm
        Shape (n, 3).
    weights_cm2
        Shape (n,): attenuation coefficient times volume.
    """

    points_cm: Float64[np.ndarray, "n 3"]
    weights_cm2: Float64[np.ndarray, "n"]


@dataclass(frozen=True, eq=False)
class Body:
    """Parts in a frame whose origin is the middle of their box along their principal axes.

    Parameters
    ----------
    space
        What is each part's, in the frame of the files.
    meshes
        Of the parts, their vertices in that frame but not turned.
    lac_per_cm
        Shape (K,): attenuation coefficients that the parts are taken to have.
    middle_cm
        Shape (3,): that origin, in the frame of the files.
    axes
        Shape (3, 3): principal axes of the vertices, one a row, the longest first.
    """

    space: Space
    meshes: Sequence[trimesh.Trimesh]
    lac_per_cm: Float64[np.ndarray, "k"]
    middle_cm: Vec3
    axes: Float64[np.ndarray, "3 3"]

    @classmethod
    def of(cls, space: Space, lac_per_cm: Float64[np.ndarray, "k"]) -> Body:
        """Centre parts.

        Raises
        ------
        DataError
            If all of them lie in one plane.
        """
        points = np.concatenate([np.asarray(mesh.vertices) for mesh in space.meshes])
        _, _, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
        axes *= np.sign(np.linalg.det(axes))
        along = points @ axes.T
        low, high = along.min(axis=0), along.max(axis=0)
        if np.ptp(along, axis=0).min() < FLAT_SHARE * np.ptp(along, axis=0).max():
            raise DataError("all parts together are flat: meshes of bodies are needed")
        middle = (low + high) / 2 @ axes
        centred = [
            trimesh.Trimesh(np.asarray(mesh.vertices) - middle, mesh.faces, process=False)
            for mesh in space.meshes
        ]
        return cls(space, centred, lac_per_cm, middle, axes)

    @cached_property
    def points_cm(self) -> Float64[np.ndarray, "n 3"]:
        """All vertices."""
        return np.concatenate([np.asarray(mesh.vertices) for mesh in self.meshes])

    @cached_property
    def rim_cm(self) -> Float64[np.ndarray, "n 3"]:
        """Outermost vertices in many directions: they tell the box around a shadow."""
        reach = self.points_cm @ spread_directions(DIRECTIONS).T
        return np.asarray(self.points_cm[np.unique(reach.argmax(axis=0))])

    @cached_property
    def radius_cm(self) -> float:
        """Of the sphere about the middle that holds the object."""
        return float(np.linalg.norm(self.points_cm, axis=1).max())

    @cached_property
    def spin(self) -> tuple[Vec3, Float64[np.ndarray, "3 3"]]:
        """Middle of the volume and its principal axes, one a row: what a round body turns about."""
        cloud = self.cloud(SPIN_CELLS)
        middle = np.average(cloud.points_cm, axis=0, weights=cloud.weights_cm2)
        spread = np.cov(cloud.points_cm.T, aweights=cloud.weights_cm2)
        return middle, np.linalg.eigh(spread)[1].T

    @cached_property
    def box_turns(self) -> tuple[Vec3, Float64[np.ndarray, "n 3 3"]]:
        """Middle of the least box around the object, and turns of the box onto itself but for none.

        Half turns, of a box with a square section quarter turns too, and of a cube all 23.
        """
        oriented = trimesh.bounds.oriented_bounds(self.points_cm)  # type: ignore[no-untyped-call]
        to_box, extents_cm = oriented
        axes, away = to_box[:3, :3], to_box[:3, 3]
        signed = [
            np.array(signs)[:, None] * np.eye(3)[list(order)]
            for order in permutations(range(3))
            for signs in product((1, -1), repeat=3)
            if np.abs(np.log(extents_cm[list(order)] / extents_cm)).max() < SQUARE
        ]
        turns = [each for each in signed if np.linalg.det(each) > 0][1:]
        return -axes.T @ away, np.array([axes.T @ each @ axes for each in turns])

    def evened(self, share: float) -> Body:
        """Give the same parts, their attenuation by a share nearer to what is usual among them."""
        log = np.log(self.lac_per_cm)
        return replace(self, lac_per_cm=np.exp(log + share * (log.mean() - log)))

    def placed(self, placement: RigidPlacement) -> RigidPlacement:
        """Say a placement of the files' frame in the body's own."""
        middle = placement.apply(self.middle_cm[None])[0]
        return RigidPlacement(placement.rotation, middle, placement.scale)

    def of_files(self, placement: RigidPlacement) -> RigidPlacement:
        """Say a placement of the body's own frame in that of the files."""
        shift = placement.translation_cm - placement.scale * placement.rotation @ self.middle_cm
        return RigidPlacement(placement.rotation, shift, placement.scale)

    def cloud(self, cells: int) -> Cloud:
        """Fill a box along the principal axes, of so many cells each way, with points.

        The box is stretched to a cube, which changes no share of a cell that a part fills.
        """
        along = self.points_cm @ self.axes.T
        low = along.min(axis=0)
        extent_cm = np.ptp(along, axis=0) * (1 + 1e-6)
        stretched = [
            trimesh.Trimesh(
                (np.asarray(mesh.vertices) @ self.axes.T - low) / extent_cm,
                mesh.faces,
                process=False,
            )
            for mesh in self.meshes
        ]
        grid = CubeGrid(np.full(3, 0.5 / cells), 1 / cells, cells)
        lac = np.zeros((cells,) * 3)
        fills = part_fractions(stretched, self.space.order, grid, subsamples=4)
        for fill, lac_per_cm in zip(fills, self.lac_per_cm.tolist(), strict=True):
            lac[fill.where] += lac_per_cm * fill.share
        places = np.argwhere(lac > 0)
        points = ((places + 0.5) / cells * extent_cm + low) @ self.axes
        return Cloud(points, lac[lac > 0] * float(np.prod(extent_cm / cells)))


def spread_directions(count: int) -> Float64[np.ndarray, "n 3"]:
    """Spread unit vectors over the sphere by a golden spiral (doi:10.1007/s11004-009-9257-x)."""
    place = np.arange(count) + 0.5
    height = 1 - 2 * place / count
    turn = np.pi * (1 + 5**0.5) * place
    across = np.sqrt(1 - height**2)
    return np.stack([across * np.cos(turn), across * np.sin(turn), height], axis=1)
