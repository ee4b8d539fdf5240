"""What surfaces that are off change: ways through parts, and their volumes.

A wall of a millimetre whose two surfaces are a tenth off each, both outwards or both inwards, is a
fifth thicker or thinner than its mesh, and looks as if it were denser or lighter by as much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import trimesh
from jaxtyping import Float64

from xden1k.rays import PathLengths, disjoint_path_lengths
from xden1k.values.views import XRayView

__all__ = ["Walls"]

MOST: Final = 0.4
"""Of a way: what is thinner than two of these has no thickness that its mesh could tell."""
FLAT: Final = 1e-3
"""Share of the mean over a vertex's normals by which a direction that none of them has counts: a
point on a face moves along the face's normal alone."""
FARTHEST: Final = 3.0
"""Times as far as the faces beside it a corner is moved, at most: spikes would fly off."""


@dataclass(frozen=True, slots=True, eq=False)
class Walls:
    """How far ways and volumes are off where surfaces are one standard deviation off.

    Parameters
    ----------
    way_sd, volume_sd
        Shape (K,): of each part, as shares.
    """

    way_sd: Float64[np.ndarray, "k"]
    volume_sd: Float64[np.ndarray, "k"]

    @classmethod
    def of(
        cls, regions: Sequence[trimesh.Trimesh], views: Sequence[XRayView], surface_sd_cm: float
    ) -> Walls:
        """Grow each part by what its surfaces may be off, and see what becomes of its shadow.

        A pixel counts by the squares of the light that comes through and of the way, as it does
        where a density is fitted.

        Parameters
        ----------
        regions
            What each part owns: closed, in cm.
        views
            Radiographs of them as they stand.
        surface_sd_cm
            Of each part's surface along its normal, all of it alike; 0 where it is exact.

        Examples
        --------
        >>> exact = Walls.of([trimesh.creation.box((1, 1, 1))], [], 0.0)
        >>> exact.way_sd.tolist(), exact.volume_sd.tolist()
        ([0.0], [0.0])
        """
        none = np.zeros(len(regions))
        if not surface_sd_cm:
            return cls(none, none)
        volume_sd = surface_sd_cm * np.array([_surface_over_volume(each) for each in regions])
        grown = [offset(each, surface_sd_cm) for each in regions]
        change, whole = np.zeros((2, len(regions)))
        for view in views:
            before, after = (
                _ways(disjoint_path_lengths(each, view.geometry)) for each in (regions, grown)
            )
            seen = np.where(view.valid, view.transmission, 0.0).clip(0, 1).ravel() ** 2
            change += seen @ (before * (after - before))
            whole += seen @ before**2
        by_shadow = np.divide(change, whole, out=volume_sd.copy(), where=whole > 0)
        return cls(by_shadow.clip(0, MOST), volume_sd.clip(0, MOST))

    def mass_sd(self, masses_g: Float64[np.ndarray, "k"]) -> float:
        """How far volumes leave the mass of all parts off, as a share; each errs by itself.

        Examples
        --------
        >>> Walls(np.zeros(2), np.array([0.03, 0.04])).mass_sd(np.array([1.0, 1.0]))
        0.025
        """
        return float(np.linalg.norm(self.volume_sd * masses_g) / masses_g.sum())


def offset(mesh: trimesh.Trimesh, distance_cm: float) -> trimesh.Trimesh:
    """Move every face of a mesh outwards by a distance, as far as its vertices can.

    Each vertex goes where it is that far from the planes of all faces around it, by least squares.

    Examples
    --------
    >>> offset(trimesh.creation.box((2, 4, 6)), 0.1).extents.round(2).tolist()
    [2.2, 4.2, 6.2]
    """
    if not len(mesh.faces):
        return mesh
    normals = np.repeat(mesh.face_normals, 3, axis=0)
    weights = mesh.face_angles.ravel()[:, None]
    corners, count = mesh.faces.ravel(), len(mesh.vertices)
    squares = np.zeros((count, 3, 3))
    np.add.at(squares, corners, (weights * normals)[:, :, None] * normals[:, None, :])
    sums = np.zeros((count, 3))
    np.add.at(sums, corners, weights * normals)
    traces = np.trace(squares, axis1=1, axis2=2)
    used = np.flatnonzero(traces > 0)  # of a needle's faces none may have a normal
    least = FLAT * traces[:, None, None] * np.eye(3)
    moves = np.zeros((count, 3))
    moves[used] = np.linalg.solve((squares + least)[used], sums[used, :, None])[..., 0]
    length = np.linalg.norm(moves, axis=1, keepdims=True)
    moves *= np.minimum(1.0, FARTHEST / np.maximum(length, FARTHEST))
    moved = np.asarray(mesh.vertices) + distance_cm * moves
    return trimesh.Trimesh(moved, mesh.faces, process=False)


def _ways(lengths: PathLengths) -> Float64[np.ndarray, "pixels k"]:
    """Way through each part for every pixel of the panel."""
    ways = np.zeros((int(np.prod(lengths.shape)), lengths.lengths_cm.shape[2]))
    ways[lengths.pixels] = lengths.lengths_cm[:, 0]
    return ways


def _surface_over_volume(mesh: trimesh.Trimesh) -> float:
    """In 1/cm; 0 for what has no volume."""
    volume = float(mesh.volume) if len(mesh.faces) else 0.0
    return float(mesh.area) / volume if volume > 0 else 0.0
