"""An object that rays meet: which part, where, and which way its surface faces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from xden_baselines.views.rendering import Surface
from xden_baselines.views.shaded.reflection import dot, facing, unit

__all__ = ["AIR", "Body", "Frame", "Group", "Hits"]

Vectors = Float[np.ndarray, "n 3"]
Parts = Int[np.ndarray, "n"]

AIR = -1
"""In place of the number of a part, where there is none."""
STEP = 1e-4
"""From a surface to what is certainly behind it, in diagonals of the object's box."""
SMOOTH_RAD = np.radians(35.0)
"""Facets that meet at less than this stand for one curved surface."""


@dataclass(frozen=True, slots=True, eq=False)
class Hits:
    """Where rays met a surface.

    Parameters
    ----------
    points_cm
        Object frame.
    rays
        Unit vectors, which way they came.
    distance_cm
        How far.
    part
        Number of the part, from 0.
    flat, normals
        Unit normals of the facet and of the curved surface that it stands for, both towards where
        the ray came from.
    """

    points_cm: Vectors
    rays: Vectors
    distance_cm: Float[np.ndarray, "n"]
    part: Parts
    flat: Vectors
    normals: Vectors

    def __len__(self) -> int:
        return len(self.rays)

    def take(self, which: np.ndarray) -> Hits:
        """Return some of them."""
        return Hits(
            self.points_cm[which],
            self.rays[which],
            self.distance_cm[which],
            self.part[which],
            self.flat[which],
            self.normals[which],
        )


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """A part's own frame.

    Parameters
    ----------
    centre_cm
        Mean of its surface.
    axes
        Rows: unit vectors along which it is longest, less long, and thinnest.
    """

    centre_cm: Float[np.ndarray, "3"]
    axes: Float[np.ndarray, "3 3"]

    @classmethod
    def of(cls, mesh: trimesh.Trimesh) -> Frame:
        """Give the frame of a mesh, by the spread of its surface."""
        weights, places = np.asarray(mesh.area_faces), np.asarray(mesh.triangles_center)
        centre = np.average(places, axis=0, weights=weights)
        spread = np.cov((places - centre).T, aweights=weights)
        axes = np.linalg.eigh(spread)[1].T[::-1]
        return cls(centre, axes)

    def places(self, points_cm: Vectors) -> Vectors:
        """Points in this frame, cm."""
        return np.asarray((points_cm - self.centre_cm) @ self.axes.T)

    def turned(self, vectors: Vectors) -> Vectors:
        """Directions in this frame."""
        return np.asarray(vectors @ self.axes.T)

    def back(self, vectors: Vectors) -> Vectors:
        """Directions of this frame, in the object's."""
        return np.asarray(vectors @ self.axes)


class Group:
    """Some parts of an object, to ask which of them is around a point.

    Parameters
    ----------
    triangles_cm, flat
        Their facets and unit normals, outward.
    part
        Which part each facet is of.
    """

    def __init__(
        self, triangles_cm: Float[np.ndarray, "faces 3 3"], flat: Vectors, part: Parts
    ) -> None:
        self._surface, self._flat, self._part = Surface(triangles_cm), flat, part

    def around(self, points_cm: Vectors, rays: Vectors) -> Parts:
        """Which of the parts is around points, seen by rays in any direction; ``AIR``: none."""
        faces, _ = self._surface.first_hits(points_cm, rays)
        leaving = (faces >= 0) & (dot(self._flat[faces], rays) > 0)
        return np.where(leaving, self._part[faces], AIR)


class Body:
    """The parts of an object, ready to be met by rays.

    Parameters
    ----------
    meshes
        Closed, cm, object frame.
    """

    def __init__(self, meshes: Sequence[trimesh.Trimesh]) -> None:
        self._triangles = np.concatenate([np.asarray(mesh.triangles) for mesh in meshes])
        self._flat = np.concatenate([np.asarray(mesh.face_normals) for mesh in meshes])
        self._corners = np.concatenate([_corner_normals(mesh) for mesh in meshes])
        self._part = np.repeat(np.arange(len(meshes)), [len(mesh.faces) for mesh in meshes])
        self._surface = Surface(self._triangles)
        self.frames = [Frame.of(mesh) for mesh in meshes]
        size = np.ptp(self._triangles.reshape(-1, 3), axis=0)
        self.skip_cm = STEP * float(np.linalg.norm(size))

    def cast(self, origins_cm: np.ndarray, rays: Vectors) -> tuple[Bool[np.ndarray, "n"], Hits]:
        """First hits of rays: which rays met anything, and where those did."""
        faces, distance, spot = self._surface.hits(origins_cm, rays)
        hit = faces >= 0
        face, ray, far = faces[hit], rays[hit], distance[hit].astype(np.float64)
        origin = np.broadcast_to(origins_cm, rays.shape)[hit]
        weights = np.column_stack([1 - spot[hit].sum(axis=1), spot[hit]])
        flat, smooth = self._flat[face], np.einsum("ij,ijk->ik", weights, self._corners[face])
        side = np.where(dot(flat, ray) < 0, 1.0, -1.0)[:, None]
        normals = facing(unit(smooth) * side, ray)
        points = origin + far[:, None] * ray
        return hit, Hits(points, ray, far, self._part[face], flat * side, normals)

    def blocked(self, points_cm: Vectors, rays: Vectors) -> Bool[np.ndarray, "n"]:
        """Whether anything is in the way of rays that leave a surface."""
        return self._surface.first_hits(points_cm + self.skip_cm * rays, rays)[0] >= 0

    def group(self, parts: Bool[np.ndarray, "parts"]) -> Group:
        """Return some of the parts as a group."""
        faces = parts[self._part]
        return Group(self._triangles[faces], self._flat[faces], self._part[faces])


def _corner_normals(mesh: trimesh.Trimesh) -> Float[np.ndarray, "faces 3 3"]:
    """Return unit normals at the corners of facets: means over one curve."""
    smooth = np.asarray(mesh.face_adjacency)[np.asarray(mesh.face_adjacency_angles) < SMOOTH_RAD]
    count = len(mesh.faces)
    links = coo_array((np.ones(len(smooth), dtype=bool), tuple(smooth.T)), shape=(count, count))
    curve = connected_components(links, directed=False)[1]
    corners = np.asarray(mesh.faces) * (curve.max() + 1) + curve[:, None]
    _, which = np.unique(corners, return_inverse=True)
    which = which.reshape(corners.shape)
    weighted = np.asarray(mesh.face_normals) * np.asarray(mesh.area_faces)[:, None]
    sums = np.stack(
        [np.bincount(which.ravel(), np.repeat(weighted[:, axis], 3)) for axis in range(3)], axis=1
    )
    flat = np.asarray(mesh.face_normals)[:, None]
    lengths = np.linalg.norm(sums, axis=1)[which][..., None]
    return np.where(lengths > 0, sums[which] / np.where(lengths > 0, lengths, 1), flat)
