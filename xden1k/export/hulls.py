"""Convex shapes for contact: closed, and never a source of mass."""

from __future__ import annotations

import numpy as np
import trimesh
from scipy.spatial import ConvexHull

from xden1k.errors import require
from xden1k.export.closed import closed_mesh
from xden1k.values.closed import edge_faults

__all__ = ["convex_shapes"]


def convex_shapes(solid: trimesh.Trimesh, pieces: int) -> tuple[trimesh.Trimesh, ...]:
    """Cover a solid with convex meshes.

    Parameters
    ----------
    solid
        Closed, in the unit that will be written.
    pieces
        How many at most. 1 = its hull; more are by V-HACD, which covers it up to voxels of its own.

    Raises
    ------
    MissingExtraError
        If more than one is asked for, and vhacdx is not installed.

    Examples
    --------
    >>> (hull,) = convex_shapes(trimesh.creation.annulus(1.0, 2.0, 1.0), 1)
    >>> hull.is_watertight, bool(hull.volume > 12)
    (True, True)
    """
    if pieces == 1:
        return (_hull(solid),)
    require("vhacdx", "sim")
    made = trimesh.decomposition.convex_decomposition(solid, maxConvexHulls=pieces)
    meshes = (trimesh.Trimesh(one["vertices"], one["faces"], process=False) for one in made)
    return tuple(map(_hull, meshes))


def _hull(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Return the hull; where trimesh's has a hole, as among slivers, that of joggled points."""
    hull = mesh.convex_hull
    if edge_faults(hull.faces) != (0, 0):
        points = np.asarray(mesh.vertices)
        simplices = ConvexHull(points, qhull_options="QJ Pp").simplices
        hull = trimesh.Trimesh(points, simplices, process=False)
        hull.remove_unreferenced_vertices()
        hull.fix_normals()
    return closed_mesh(hull)
