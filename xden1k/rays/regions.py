"""Exact cuts of closed meshes: disjoint parts, a half, and the outer surface of a whole object.

Booleans by manifold3d, in double precision.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import trimesh

from xden1k.errors import require
from xden1k.rays.lengths import path_lengths
from xden1k.rays.manifolds import mesh_of, solid_of
from xden1k.rays.priority import check_order
from xden1k.values.arrays import Vec3
from xden1k.values.views import ViewGeometry

if TYPE_CHECKING:
    import manifold3d
else:
    manifold3d = require("manifold3d", "build")

__all__ = ["disjoint_regions", "half_beyond", "outer_surface", "sealed"]

NEGLIGIBLE = 1e-4
"""Parts share space if they share more than this of the smaller one's volume; less than this of a
part is nothing."""
COLUMNS = 128
"""Columns along each side of the box in which shared space is looked for."""
OFF_CENTRE = np.array([0.381966, 0.723607, 0.5])
"""Where in its cell a column stands: not in the middle, lest it run along a face that two parts
share and that lies on a symmetry of their common box."""
SEAL = 1e-6
"""How far parts are grown before they are joined, as a share of the object's diagonal."""


def disjoint_regions(
    meshes: Sequence[trimesh.Trimesh], order: Sequence[int]
) -> list[trimesh.Trimesh]:
    """Cut from each mesh what stronger ones own.

    Parameters
    ----------
    meshes
        Closed, outward-wound.
    order
        Indices of the meshes, strongest owner first (see :func:`ownership_order`).

    Returns
    -------
    list of trimesh.Trimesh
        In the order of ``meshes``. The very same object where nothing stronger overlaps (touching
        up to rounding is no overlap); an empty mesh where nothing is left.

    Raises
    ------
    DataError
        If the order is not a permutation, or a mesh is not closed or wound inwards.

    Examples
    --------
    >>> handle, screw = trimesh.creation.box((2, 2, 9)), trimesh.creation.box((1, 1, 5))
    >>> [float(part.volume) for part in disjoint_regions([handle, screw], [1, 0])]
    [31.0, 5.0]
    """
    check_order(order, len(meshes))
    solids = [solid_of(mesh, part) for part, mesh in enumerate(meshes)]
    regions = list(meshes)
    for place, part in enumerate(order):
        cutters = [solids[k] for k in order[:place] if _overlap(meshes[k], meshes[part])]
        if cutters:
            rest = solids[part] - _union(cutters)
            gone = rest.volume() <= NEGLIGIBLE * solids[part].volume()
            regions[part] = trimesh.Trimesh() if gone else mesh_of(rest)
    return regions


def outer_surface(meshes: Sequence[trimesh.Trimesh]) -> trimesh.Trimesh:
    """Outer surface of the union of closed meshes: what a camera could touch, cavities filled.

    A cavity is enclosed if no way leads out of it. Two or more parts are first grown by ``SEAL``
    of the object's diagonal, so that facets which meet only up to rounding leave no way between
    them; the result is that much larger.

    Raises
    ------
    DataError
        If a mesh is not closed or wound inwards.

    Examples
    --------
    >>> hole = trimesh.creation.box((1, 1, 1))
    >>> _ = hole.invert()
    >>> hollow = trimesh.util.concatenate([trimesh.creation.box((2, 2, 2)), hole])
    >>> float(hollow.volume), float(outer_surface([hollow]).volume)
    (7.0, 8.0)
    """
    solids = [solid for solid in _sealed_solids(meshes) if not solid.is_empty()]
    # The shells that face inwards bound cavities. The others, each taken as solid, cover the
    # cavities and all that floats in them.
    shells = _union(solids).decompose()
    return mesh_of(_union([shell for shell in shells if shell.volume() > 0]))


def sealed(meshes: Sequence[trimesh.Trimesh]) -> list[trimesh.Trimesh]:
    """Parts as :func:`outer_surface` joins them: whatever is inside it and in none is a cavity.

    Two or more are grown by ``SEAL`` of the object's diagonal.

    Raises
    ------
    DataError
        If a mesh is not closed or wound inwards.

    Examples
    --------
    >>> left, right = trimesh.creation.box((1, 1, 1)), trimesh.creation.box((1, 1, 1))
    >>> (grown, _) = sealed([left, right.apply_translation((1, 0, 0))])
    >>> 1 < float(grown.volume) < 1.0001
    True
    """
    return [mesh_of(solid) for solid in _sealed_solids(meshes)]


def half_beyond(mesh: trimesh.Trimesh, normal: Vec3, offset_cm: float) -> trimesh.Trimesh:
    """Part of a closed mesh in which ``point @ normal > offset_cm``, closed again; maybe empty.

    Raises
    ------
    DataError
        If the mesh is not closed or wound inwards.

    Examples
    --------
    >>> float(half_beyond(trimesh.creation.box((2, 2, 2)), np.array([0, 1.0, 0]), 0.5).volume)
    2.0
    """
    return mesh_of(solid_of(mesh).trim_by_plane(tuple(normal.tolist()), offset_cm))


def _sealed_solids(meshes: Sequence[trimesh.Trimesh]) -> list[manifold3d.Manifold]:
    """Parts, grown if there are two or more."""
    solids = [solid_of(mesh, part) for part, mesh in enumerate(meshes)]
    filled = [solid for solid in solids if not solid.is_empty()]
    if len(filled) < 2:
        return solids
    boxes = np.array([solid.bounding_box() for solid in filled])
    diagonal = float(np.linalg.norm(boxes[:, 3:].max(axis=0) - boxes[:, :3].min(axis=0)))
    return [one if one.is_empty() else _grown(one, SEAL * diagonal) for one in solids]


def _union(solids: Sequence[manifold3d.Manifold]) -> manifold3d.Manifold:
    return manifold3d.Manifold.batch_boolean(list(solids), manifold3d.OpType.Add)


def _overlap(one: trimesh.Trimesh, other: trimesh.Trimesh) -> bool:
    """Whether two closed meshes share space, seen by columns along z.

    Not by a boolean: where facets nearly coincide, as those of touching parts do after rounding to
    float32, the volume of manifold3d's intersection is off by up to a few percent of the smaller
    part, in either direction.
    """
    low, high = np.maximum(*_corners(one, other, 0)), np.minimum(*_corners(one, other, 1))
    if not (low < high).all():
        return False
    step = (high - low) / COLUMNS
    columns = ViewGeometry(
        beam="parallel",
        direction=np.array([0.0, 0.0, 1.0]),
        pixel00_cm=low + step * OFF_CENTRE,
        column_step_cm=np.array([step[0], 0.0, 0.0]),
        row_step_cm=np.array([0.0, step[1], 0.0]),
        shape=(COLUMNS, COLUMNS),
    )
    shared = path_lengths([one, other], [0, 1], columns).shared_cm.sum(dtype=np.float64)
    smaller = min(float(one.volume), float(other.volume))
    return bool(shared * step[0] * step[1] > NEGLIGIBLE * smaller)


def _corners(one: trimesh.Trimesh, other: trimesh.Trimesh, which: int) -> tuple[Vec3, Vec3]:
    return np.asarray(one.bounds[which]), np.asarray(other.bounds[which])


def _grown(solid: manifold3d.Manifold, distance_cm: float) -> manifold3d.Manifold:
    """Move each vertex outwards along its normal."""
    mesh = mesh_of(solid)
    mesh.vertices = mesh.vertices + distance_cm * mesh.vertex_normals
    return solid_of(mesh)
