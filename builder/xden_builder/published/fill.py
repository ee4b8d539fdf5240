"""Which voxels lie inside a mesh that is not closed: votes of three axes.

A column through a surface is inside after an odd number of crossings, unless a face is missing, is
turned or stands twice. Columns along three axes seldom meet the same fault, so that each point
goes by the majority; where there is none, by its generalised winding number (Barill et al. 2018,
doi:10.1145/3197517.3201337).
"""

from __future__ import annotations

from typing import Final

import numpy as np
import trimesh
from jaxtyping import Bool, Float64, Int64

from xden1k.errors import DataError, require
from xden_builder.published import kernels
from xden_builder.published.shares import FINE_SIZE, BoxShares, enclosed, pooled

__all__ = ["fill_mesh"]

MERGE_SHARE: Final = 1e-6
"""Of the longest side: vertices nearer than this are one."""
OFFSET: Final = 1.234567e-4
"""Of the columns from the centres, voxels: meshes like round numbers."""
SURE: Final = 3
"""Least sum of votes that decides; each axis has 0, 1 or 2."""
HALF_TURN: Final = 0.5


def fill_mesh(mesh: trimesh.Trimesh) -> BoxShares:
    """Fill a mesh; the box is in its own unit.

    Raises
    ------
    DataError
        If it is flat, or nothing is inside.

    Examples
    --------
    >>> open_box = trimesh.creation.box((2, 2, 2))
    >>> open_box.update_faces(np.arange(12) > 0)
    >>> float(fill_mesh(open_box).raw.mean())
    1.0
    """
    vertices, faces = _welded(mesh)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    if not (high > low).all():
        raise DataError(f"mesh: expected a body, got sides of {(high - low).tolist()}")
    placed = (vertices - low) / (high - low) * FINE_SIZE
    inside = _inside(placed, faces)
    if not inside.any():
        raise DataError("mesh: nothing is inside its surface")
    return BoxShares(low, high, pooled(inside), pooled(enclosed(inside)))


def _welded(
    mesh: trimesh.Trimesh,
) -> tuple[Float64[np.ndarray, "v 3"], Int64[np.ndarray, "f 3"]]:
    """Vertices at one place made one, and each face once.

    Faces that lie on each other the other way round bound nothing between them, and stay.
    """
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    step = MERGE_SHARE * float(np.ptp(vertices, axis=0).max())
    _, kept, index = np.unique(
        np.round(vertices / step), axis=0, return_index=True, return_inverse=True
    )
    faces = index.reshape(-1)[np.asarray(mesh.faces)].astype(np.int64)
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    start = faces.argmin(axis=1)
    turned = np.take_along_axis(faces, (start[:, None] + np.arange(3)) % 3, axis=1)
    return vertices[kept], np.unique(turned, axis=0)


def _inside(
    vertices: Float64[np.ndarray, "v 3"], faces: Int64[np.ndarray, "f 3"]
) -> Bool[np.ndarray, "n n n"]:
    """Decide each point of the grid."""
    votes = np.zeros((FINE_SIZE,) * 3, dtype=np.int8)
    for axis in range(3):
        parity = np.zeros((FINE_SIZE, FINE_SIZE, FINE_SIZE + 1), dtype=np.uint8)
        winding = np.zeros(parity.shape, dtype=np.int16)
        kernels.cross(vertices, faces, axis, OFFSET, parity, winding)
        kernels.vote(parity, winding, votes.transpose((axis + 1) % 3, (axis + 2) % 3, axis))
    inside = votes >= SURE
    open_points = np.argwhere(np.abs(votes) < SURE)
    if len(open_points):
        turns = require("igl", "import").fast_winding_number(vertices, faces, open_points + 0.5)
        inside[tuple(open_points.T)] = np.abs(turns) > HALF_TURN
    return inside
