"""Closed meshes to and from manifold3d, in double precision."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import trimesh

from xden1k.errors import DataError, require

if TYPE_CHECKING:
    import manifold3d
else:
    manifold3d = require("manifold3d", "build")

__all__ = ["mesh_of", "solid_of"]


def solid_of(mesh: trimesh.Trimesh, part: int = 0) -> manifold3d.Manifold:
    """Take up a closed mesh.

    Raises
    ------
    DataError
        If it is not closed or wound inwards; the message gives the number of the part.
    """
    buffers = manifold3d.Mesh64(  # copies, since it wants to be able to write
        np.array(mesh.vertices, dtype=np.float64, order="C"),
        np.array(mesh.faces, dtype=np.uint64, order="C"),
    )
    buffers.merge()
    solid = manifold3d.Manifold(buffers)
    if solid.status() != manifold3d.Error.NoError:
        raise DataError(f"part {part} is not a closed mesh (manifold3d: {solid.status().name})")
    if solid.volume() < 0:
        raise DataError(f"part {part} is wound inwards: its volume is {solid.volume():.6g} cm³")
    return solid


def mesh_of(solid: manifold3d.Manifold) -> trimesh.Trimesh:
    """Return the triangles of a solid.

    Unprocessed: joining vertices by distance, as trimesh does, may fold thin slivers.
    """
    buffers = solid.to_mesh64()
    return trimesh.Trimesh(
        buffers.vert_properties[:, :3], buffers.tri_verts.astype(np.int64), process=False
    )
