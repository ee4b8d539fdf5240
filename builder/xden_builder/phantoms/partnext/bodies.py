"""Pieces of a part's surface, their holes covered, and the voxels they fill or line."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from xden_builder.phantoms.partnext.flood import depths, flooded, near_voxels, sides
from xden_builder.phantoms.partnext.surface import Surface

__all__ = ["bodies", "capped", "filled", "lined"]

WELDED: Final = 1e-3
"""Corners that differ by less, in voxels, are one."""
AIR: Final = 4
"""Voxels around a body."""
SMALLEST: Final = 2.0
"""A body shorter than this, in voxels, along any axis fills none that could be told."""

Triangles = Float64[np.ndarray, "t 3 3"]


def bodies(triangles: Triangles) -> Iterator[Triangles]:
    """Yield the triangles of each connected piece of a surface, the largest box first."""
    corners = _corners(triangles)
    links = (corners[:, [0, 1]].ravel(), corners[:, [1, 2]].ravel())
    count = int(corners.max()) + 1
    graph = coo_array((np.ones(len(links[0]), dtype=np.int8), links), (count, count))
    piece = connected_components(graph, directed=False)[1][corners[:, 0]]
    found = [triangles[piece == number] for number in np.unique(piece)]
    yield from sorted(found, key=lambda one: -float(np.ptp(one.reshape(-1, 3), axis=0).prod()))


def _corners(triangles: Triangles) -> Int64[np.ndarray, "t 3"]:
    """Give each corner a number, those at one place the same."""
    places = np.round(triangles.reshape(-1, 3) / WELDED)
    return np.unique(places, axis=0, return_inverse=True)[1].reshape(-1, 3).astype(np.int64)


def capped(triangles: Triangles) -> Float64[np.ndarray, "more 3 3"]:
    """Add a fan over each hole of a surface, from the middle of its rim; the same where none is.

    Examples
    --------
    >>> import trimesh
    >>> box = trimesh.creation.box((4, 4, 4)).triangles
    >>> len(capped(box)), len(capped(box[1:]))
    (12, 14)
    """
    corners = _corners(triangles)
    ends = corners[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    points = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2, 3)
    _, edge, count = np.unique(np.sort(ends), axis=0, return_inverse=True, return_counts=True)
    single = count[edge.reshape(-1)] % 2 == 1
    _, first = np.unique(edge.reshape(-1)[single], return_index=True)
    rim_ends, rim = ends[single][first], points[single][first]
    if not len(rim):
        return triangles
    number, named = np.unique(rim_ends, return_inverse=True)
    links = named.reshape(-1, 2).T
    graph = coo_array((np.ones(len(rim), dtype=np.int8), tuple(links)), (len(number),) * 2)
    hole = connected_components(graph, directed=False)[1][links[0]]
    sums = np.zeros((int(hole.max()) + 1, 3))
    np.add.at(sums, hole, rim.mean(axis=1))
    middle = (sums / np.bincount(hole)[:, None])[hole]
    return np.concatenate([triangles, np.stack([rim[:, 1], rim[:, 0], middle], axis=1)])


def filled(triangles: Triangles, shape: tuple[int, ...]) -> Int64[np.ndarray, "v"]:
    """List the voxels inside a surface, by their place in the flattened grid."""
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    if (high - low).min() < SMALLEST:
        return np.empty(0, dtype=np.int64)
    start = np.floor(low).astype(np.int64) - AIR
    box = tuple((np.ceil(high).astype(np.int64) + AIR + 1 - start).tolist())
    near = Surface.of(triangles - start)
    air = flooded(near, box)
    front, back = sides(near, air)
    inside = np.argwhere(depths(near.only(front | back), air) > 0) + start
    within = ((inside >= 0) & (inside < shape)).all(axis=1)
    return _flat(inside[within], shape)


def lined(surface: Surface, full: Bool[np.ndarray, "x y z"], wall: float) -> Int64[np.ndarray, "v"]:
    """List the voxels of an object that are within a wall's thickness of a surface."""
    voxels = near_voxels(surface, full.shape, wall)
    voxels = voxels[full[tuple(voxels.T)]]
    hit, feet, _ = surface.nearest(voxels.astype(np.float64), wall + 1.0)
    close = np.linalg.norm(voxels[hit] - feet, axis=1) <= wall
    return _flat(voxels[hit][close], full.shape)


def _flat(voxels: Int64[np.ndarray, "v 3"], shape: tuple[int, ...]) -> Int64[np.ndarray, "v"]:
    return np.asarray(np.ravel_multi_index(tuple(voxels.T), shape), dtype=np.int64)
