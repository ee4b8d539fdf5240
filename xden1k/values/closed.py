"""Whether triangles bound a solid."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from xden1k.values.arrays import Faces

__all__ = ["EdgeFaults", "edge_faults"]


class EdgeFaults(NamedTuple):
    """Edges at which triangles do not bound a solid.

    Parameters
    ----------
    open
        Where an odd number of triangles meet.
    twisted
        Where neighbours run along an edge in the same direction.
    """

    open: int
    twisted: int


def edge_faults(faces: Faces) -> EdgeFaults:
    """Count the edges that keep triangles from bounding a solid.

    Four triangles may meet in an edge, as where two corners of a solid touch: every ray still
    leaves as often as it enters. ``trimesh.is_watertight`` asks for exactly two.

    Examples
    --------
    >>> tetrahedron = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    >>> edge_faults(tetrahedron)
    EdgeFaults(open=0, twisted=0)
    >>> edge_faults(tetrahedron[1:]).open
    3
    """
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    keys = edges.min(axis=1) * (int(faces.max(initial=0)) + 1) + edges.max(axis=1)
    _, edge, count = np.unique(keys, return_inverse=True, return_counts=True)
    turns = np.bincount(edge, weights=np.sign(edges[:, 1] - edges[:, 0]))
    uneven = count % 2 == 1
    return EdgeFaults(int(uneven.sum()), int(((turns != 0) & ~uneven).sum()))
