"""Meshes that stay closed under readers which merge vertices, or ask for two faces at each edge.

A mesh of the dataset is closed by its indices. ``trimesh.load`` merges vertices that agree to 1e-8
of the file's unit, Open3D those that agree in single precision; a sliver's two ends become one, its
triangle a line, and an edge where four triangles meet is no longer watertight. So what is written
is merged here first, by both rules, and made to pass.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Integer
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from xden1k.errors import DataError
from xden1k.values.closed import edge_faults

__all__ = ["closed_mesh"]

MERGED: Final = 1.01e-8
"""Of the file's unit: trimesh takes what is nearer than 1e-8 for the same."""
ROUNDINGS: Final = 4
"""Of single precision at the mesh's size: readers that keep vertices so, once they have moved them
to another unit, take what is nearer for the same."""
STEP: Final = 1.5
"""By how much more than that surfaces which touch are drawn apart."""
ROUNDS: Final = 8

# Their sizes change within a function, so they have no names.
Vertices = Float[np.ndarray, "_ 3"]
Triangles = Integer[np.ndarray, "_ 3"]
Corner = Integer[np.ndarray, "3"]
Sides = Integer[np.ndarray, "_"]
Pairs = Integer[np.ndarray, "_ 2"]


def closed_mesh(mesh: trimesh.Trimesh, *, single: bool = False) -> trimesh.Trimesh:
    """Make a mesh whose every edge joins two faces, however its vertices are merged.

    Slivers shorter than the readers' tolerance vanish; where the surface touches itself in an
    edge, its sides are drawn apart by a few roundings, into the solid.

    Parameters
    ----------
    mesh
        In the unit that will be written; closed by its indices (:func:`edge_faults` finds none).
    single
        Whether the format holds single precision.

    Raises
    ------
    DataError
        If it is not closed, or cannot be made so.

    Examples
    --------
    >>> corner = trimesh.util.concatenate(
    ...     [trimesh.creation.box(bounds=[[0, 0, 0], [1, 1, 1]]),
    ...      trimesh.creation.box(bounds=[[1, 1, 0], [2, 2, 1]])])
    >>> trimesh.Trimesh(corner.vertices, corner.faces).is_watertight
    False
    >>> closed_mesh(corner).is_watertight
    True
    """
    faults = edge_faults(mesh.faces)
    if not len(mesh.faces) or faults.open or faults.twisted:
        raise DataError(
            f"expected a closed mesh, got {len(mesh.faces)} triangles with {faults.open} open "
            f"and {faults.twisted} twisted edges"
        )
    vertices, faces = _rounded(np.asarray(mesh.vertices), single), np.asarray(mesh.faces)
    for _ in range(ROUNDS):
        vertices, faces = _drawn_apart(*_merged(vertices, faces), single)
        again = _merged(vertices, faces)
        if len(again[0]) == len(vertices) and not _crowded(faces).any():
            return trimesh.Trimesh(vertices, faces, process=False)
        vertices, faces = again
    raise DataError("some of its edges cannot be told apart at the precision written")


def _rounded(vertices: Vertices, single: bool) -> Vertices:
    return np.asarray(vertices, np.float32 if single else np.float64).astype(np.float64)


def _reach(vertices: Vertices) -> float:
    """Return the distance along an axis below which some reader merges."""
    size = np.float32(np.abs(vertices).max())
    return max(MERGED, ROUNDINGS * float(np.spacing(size)))


def _merged(vertices: Vertices, faces: Triangles) -> tuple[Vertices, Triangles]:
    """Merge what a reader may merge; faces that became a line, or lie back to back, go."""
    near = cKDTree(vertices).query_pairs(_reach(vertices), p=np.inf, output_type="ndarray")
    linked = coo_array((np.ones(len(near), dtype=bool), near.T), shape=(len(vertices),) * 2)
    groups = connected_components(linked, directed=False)[1]
    _, first = np.unique(groups, return_index=True)
    faces = groups[faces]
    a, b, c = faces.T
    faces = _without_pairs(faces[(a != b) & (b != c) & (c != a)])
    used, faces = np.unique(faces, return_inverse=True)
    return vertices[first[used]], faces.reshape(-1, 3)


def _without_pairs(faces: Triangles) -> Triangles:
    """Drop two faces of the same corners that look opposite ways."""
    start = np.argmin(faces, axis=1)[:, None]
    turned = np.take_along_axis(faces, (start + np.arange(3)) % 3, axis=1)
    odd = turned[:, 1] > turned[:, 2]
    corners = np.where(odd[:, None], turned[:, [0, 2, 1]], turned)
    _, group = np.unique(corners, axis=0, return_inverse=True)
    group, sign = group.reshape(-1), np.where(odd, -1, 1)
    net = np.bincount(group, weights=sign).astype(np.int64)
    # of each group as many are kept as are left over, of the side that has more
    left = (sign == np.sign(net)[group]) & (_rank(2 * group + odd) < np.abs(net)[group])
    kept: Triangles = faces[left]
    return kept


def _edges(faces: Triangles) -> tuple[Sides, Bool[np.ndarray, "_"]]:
    """Give each side of each face the number of its edge, and whether it runs upwards."""
    start, end = faces, np.roll(faces, -1, axis=1)
    keys = np.minimum(start, end).astype(np.int64) * (int(faces.max(initial=0)) + 1)
    _, edge = np.unique((keys + np.maximum(start, end)).reshape(-1), return_inverse=True)
    return edge.reshape(-1), (start < end).reshape(-1)


def _crowded(faces: Triangles) -> Bool[np.ndarray, "_"]:
    """Which undirected edges join more than two faces."""
    crowded: Bool[np.ndarray, "_"] = np.bincount(_edges(faces)[0]) > 2
    return crowded


def _drawn_apart(vertices: Vertices, faces: Triangles, single: bool) -> tuple[Vertices, Triangles]:
    """Give each fan of faces around a vertex one of its own, a little into the solid."""
    pairs = _pairs(vertices, faces)
    fans = _fans(faces, pairs)
    _, first, corner = np.unique(fans, return_index=True, return_inverse=True)
    corner, origin = corner.reshape(-1, 3), faces.reshape(-1)[first]
    inwards, area = _inwards(vertices[origin], corner)
    # the fan of the largest area stays, since moving it changes the volume most
    points = _moved(vertices[origin], inwards, _rank(origin, -area), single)
    return _halved(points, corner, pairs, single)


def _pairs(vertices: Vertices, faces: Triangles) -> Pairs:
    """Sides, two of which make an edge: the solid lies between their faces.

    Side 3 f + k runs from corner k of face f to the next.
    """
    edge, upwards = _edges(faces)
    order = np.argsort(edge, kind="stable")
    counts = np.bincount(edge)
    plain = order[counts[edge[order]] == 2].reshape(-1, 2)
    ends = np.cumsum(counts)
    crowded = [
        _around(vertices, faces, order[ends[which] - counts[which] : ends[which]], upwards)
        for which in np.flatnonzero(counts > 2)
    ]
    return np.concatenate([plain, *crowded])


def _around(
    vertices: Vertices, faces: Triangles, sides: Sides, upwards: Bool[np.ndarray, "_"]
) -> Pairs:
    """Pair the sides that meet in one crowded edge."""
    corners = faces.reshape(-1)
    first = sides[upwards[sides]][:1]
    (foot,), (tip,) = vertices[corners[first]], vertices[corners[_next(first)]]
    axis = (tip - foot) / np.linalg.norm(tip - foot)
    arms = vertices[corners[_next(_next(sides))]] - foot
    across = arms - np.outer(arms @ axis, axis)
    angles = np.arctan2(across @ np.cross(axis, across[0]), across @ across[0])
    # Going round against the angle, the solid begins at a side that runs upwards, and ends at one
    # that does not: as brackets do. Twice round, for what is open at the start.
    around = sides[np.lexsort((upwards[sides], -angles))]
    begun: list[int] = []
    pairs: dict[int, int] = {}
    for side in [*around.tolist(), *around.tolist()]:
        if side in pairs or side in begun:
            continue
        if upwards[side]:
            begun.append(side)
        elif begun:
            pairs[side] = begun.pop()
            pairs[pairs[side]] = side
    return np.array([pair for pair in pairs.items() if upwards[pair[0]]])


def _next(side: Sides) -> Sides:
    """Corner at the end of a side; its start has the side's own number."""
    following: Sides = side - side % 3 + (side + 1) % 3
    return following


def _fans(faces: Triangles, pairs: Pairs) -> Sides:
    """Give corners that hang together around a vertex the same number."""
    one, other = pairs.T
    start = np.concatenate([one, _next(one)])
    end = np.concatenate([_next(other), other])
    links = coo_array((np.ones(len(start), dtype=bool), (start, end)), shape=(faces.size,) * 2)
    fans: Sides = connected_components(links, directed=False)[1]
    return fans


def _rank(values: Sides, by: Float[np.ndarray, "_"] | None = None) -> Sides:
    """Which of its equals each value is, from 0, in ascending order of ``by``."""
    order = np.lexsort((np.zeros(len(values)) if by is None else by, values))
    rank = np.empty(len(values), dtype=np.int64)
    rank[order] = np.arange(len(values)) - np.searchsorted(values[order], values[order])
    return rank


def _inwards(points: Vertices, faces: Triangles) -> tuple[Vertices, Float[np.ndarray, "_"]]:
    """Directions against the normals around each point, largest component 1; and areas there."""
    sides = points[faces]
    normals = np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0])
    sums, areas = np.zeros_like(points), np.zeros(len(points))
    for column in range(3):
        np.add.at(sums, faces[:, column], normals)
        np.add.at(areas, faces[:, column], np.linalg.norm(normals, axis=1))
    largest = np.abs(sums).max(axis=1, keepdims=True)
    flat = np.broadcast_to([1.0, 0.0, 0.0], sums.shape).copy()
    directions: Vertices = np.divide(-sums, largest, out=flat, where=largest > 0)
    return directions, areas


def _moved(points: Vertices, directions: Vertices, steps: Sides, single: bool) -> Vertices:
    """Move points by some of the smallest steps that every reader tells apart."""
    length = STEP * _reach(points) * steps
    return _rounded(points + directions * length[:, None], single)


def _halved(
    points: Vertices, faces: Triangles, pairs: Pairs, single: bool
) -> tuple[Vertices, Triangles]:
    """Cut edges that still join the same two vertices as another one does in their middle."""
    edge, _ = _edges(faces)
    crowded = pairs[(np.bincount(edge) > 2)[edge[pairs[:, 0]]]]
    if not len(crowded):
        return points, faces
    corners = faces.reshape(-1)
    middles = (points[corners[crowded[:, 0]]] + points[corners[_next(crowded[:, 0])]]) / 2
    inwards = _inwards(points, faces)[0][corners[crowded[:, 0]]]
    middles = _moved(middles, inwards, _rank(edge[crowded[:, 0]]), single)
    middle_of = {
        int(side): len(points) + number for number, pair in enumerate(crowded) for side in pair
    }
    touched = {side // 3 for side in middle_of}
    cut = [piece for face in sorted(touched) for piece in _cut(face, faces[face], middle_of)]
    kept = np.delete(faces, sorted(touched), axis=0)
    whole = np.concatenate([kept, np.array(cut, dtype=np.int64).reshape(-1, 3)])
    return np.concatenate([points, middles]), whole


def _cut(face: int, corners: Corner, middle_of: dict[int, int]) -> list[tuple[int, int, int]]:
    """Triangles of a face with further corners in the middle of some sides."""
    ring = [
        corner
        for k in range(3)
        for corner in (int(corners[k]), middle_of.get(3 * face + k))
        if corner is not None
    ]
    # from a middle, no triangle of the fan lies along an uncut side
    start = next(place for place, corner in enumerate(ring) if corner not in corners)
    ring = ring[start:] + ring[:start]
    return [(ring[0], ring[k], ring[k + 1]) for k in range(1, len(ring) - 1)]
