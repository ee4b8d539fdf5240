"""Part meshes from labels: surface nets that neighbours share.

Multi-label surface nets (Gibson 1998, doi:10.1007/BFb0056277): a vertex in every cell of eight
voxels that are not of one label, a face between every two voxels of unlike labels. Both parts at a
face use the same two triangles, so that they neither overlap nor leave a gap, and each part's
triangles bound a solid.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, Int64, UInt8

from xden1k.values.arrays import Faces
from xden_builder.published import kernels

__all__ = ["Net", "part_nets", "surface_size"]

FULL: Final = 0.5
"""Least share of a voxel that is its owner's on the whole."""
FAINT: Final = 0.1
"""The same of a part so thin that it fills few voxels by half."""
MOST_THIN: Final = 0.7
"""Of a part's volume: where the voxels filled by half hold less, it is thin."""
FARTHEST: Final = 0.45
"""Voxels that a vertex may be moved in all, so that surfaces do not cross."""
ROUNDS: Final = 3
_NO_QUADS: Final = np.empty((0, 4), dtype=np.int64), np.empty((0, 2), dtype=np.uint8)


@dataclass(frozen=True, slots=True, eq=False)
class Net:
    """Triangles of all parts on common points.

    Parameters
    ----------
    points
        In voxels: voxel i is i to i + 1.
    faces
        Of each part, counter-clockwise seen from outside.
    """

    points: Float64[np.ndarray, "points 3"]
    faces: Sequence[Int64[np.ndarray, "_faces 3"]]


def part_nets(
    labels: UInt8[np.ndarray, "x y z"],
    share: Float32[np.ndarray, "x y z"],
    filled: Float64[np.ndarray, "parts"],
) -> Net:
    """Mesh the parts of a labelled volume, each as large as what it fills.

    Parameters
    ----------
    labels
        Owner of each voxel, 0 = air, with a margin of air.
    share
        How much of it is filled.
    filled
        Volume of each part, in voxels; one without a voxel gets no face.

    Examples
    --------
    >>> labels = np.zeros((8, 8, 8), dtype=np.uint8)
    >>> labels[2:6, 2:6, 2:4], labels[2:6, 2:6, 4:6] = 1, 2
    >>> net = part_nets(labels, (labels > 0).astype(np.float32), np.full(2, 32.0))
    >>> [len(faces) for faces in net.faces]
    [128, 128]
    """
    kept = np.where(share >= _least_shares(labels, share, filled)[labels], labels, 0)
    kept = kept.astype(np.uint8)
    points, number = _points(kept, share)
    corners, sides = _quads(kept, number)
    triangles = corners[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
    sides = np.repeat(sides, 2, axis=0)
    faces = [
        np.concatenate([triangles[sides[:, 0] == part], triangles[sides[:, 1] == part][:, ::-1]])
        for part in range(1, len(filled) + 1)
    ]
    movable = _facing_air(len(points), triangles, sides)
    for part, triangles_of in enumerate(faces, start=1):
        mine = movable == part
        if mine.any():
            _inflate(points, triangles_of, mine, float(filled[part - 1]))
    return Net(points + 0.5, faces)


def surface_size(labels: UInt8[np.ndarray, "x y z"]) -> int:
    """Count the triangles between voxels of unlike labels, without making them.

    Examples
    --------
    >>> surface_size(np.pad(np.ones((2, 2, 2), dtype=np.uint8), 2))
    48
    """
    number = np.empty((0, 0, 0), dtype=np.int32)
    return 2 * int(kernels.quads(labels, number, *_NO_QUADS, write=False))


def _least_shares(
    labels: UInt8[np.ndarray, "x y z"],
    share: Float32[np.ndarray, "x y z"],
    filled: Float64[np.ndarray, "parts"],
) -> Float64[np.ndarray, "parts1"]:
    """Share from which a voxel is kept, for air and each part."""
    full = np.bincount(labels.ravel(), np.where(share >= FULL, share, 0).ravel(), len(filled) + 1)
    return np.where(full >= MOST_THIN * np.append(0.0, filled), FULL, FAINT)


def _points(
    labels: UInt8[np.ndarray, "x y z"], share: Float32[np.ndarray, "x y z"]
) -> tuple[Float64[np.ndarray, "points 3"], Int32[np.ndarray, "x1 y1 z1"]]:
    x, y, z = labels.shape
    number = np.empty((x - 1, y - 1, z - 1), dtype=np.int32)
    count = kernels.cells(labels, share, number, np.empty((0, 3)), write=False)
    points = np.empty((count, 3))
    kernels.cells(labels, share, number, points, write=True)
    return points, number


def _quads(
    labels: UInt8[np.ndarray, "x y z"], number: Int32[np.ndarray, "x1 y1 z1"]
) -> tuple[Int64[np.ndarray, "quads 4"], UInt8[np.ndarray, "quads 2"]]:
    count = kernels.quads(labels, number, *_NO_QUADS, write=False)
    corners, sides = np.empty((count, 4), dtype=np.int64), np.empty((count, 2), dtype=np.uint8)
    kernels.quads(labels, number, corners, sides, write=True)
    return corners, sides


def _facing_air(
    count: int, triangles: Int64[np.ndarray, "f 3"], sides: UInt8[np.ndarray, "f 2"]
) -> UInt8[np.ndarray, "points"]:
    """Part of each point all of whose triangles lie between that part and air; else 0."""
    owner = np.zeros(count, dtype=np.uint8)
    owner[triangles] = sides.max(axis=1)[:, None]
    between = sides.min(axis=1) > 0
    owner[triangles[between]] = 0
    foreign = owner[triangles] != sides.max(axis=1)[:, None]
    owner[triangles[foreign]] = 0
    return owner


def _inflate(
    points: Float64[np.ndarray, "points 3"],
    faces: Faces,
    movable: Bool[np.ndarray, "points"],
    volume: float,
) -> None:
    """Move points along their normals until the part's triangles hold a volume, in place."""
    budget = FARTHEST
    for _ in range(ROUNDS):
        a, b, c = (points[faces[:, corner]] for corner in range(3))
        cross = np.cross(b - a, c - a) / 2
        missing = volume - float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6
        normals = np.stack(
            [np.bincount(faces.T.ravel(), np.tile(along, 3), len(points)) / 3 for along in cross.T],
            axis=1,
        )
        area = np.linalg.norm(normals, axis=1)
        moving = movable & (area > 0)
        step = np.clip(missing / max(float(area[moving].sum()), 1e-9), -budget, budget)
        points[moving] += step * normals[moving] / area[moving, None]
        budget -= abs(step)
