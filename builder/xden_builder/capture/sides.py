"""Sides of triangles: the edges they lie on, and what hangs together."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Int64
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from xden1k.values.arrays import Faces

__all__ = ["Sides", "groups"]


@dataclass(frozen=True, eq=False)
class Sides:
    """The three sides of each triangle, one after the other.

    Parameters
    ----------
    faces
        Shape (n, 3).
    """

    faces: Faces

    @cached_property
    def ends(self) -> Int64[np.ndarray, "sides 2"]:
        """Vertices of each side, in the order in which its triangle runs along it."""
        return self.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)

    @cached_property
    def edge(self) -> Int64[np.ndarray, "sides"]:
        """Number of the edge that each side lies on."""
        low, high = self.ends.min(axis=1), self.ends.max(axis=1)
        keys = low * (int(high.max()) + 1) + high
        return np.asarray(np.unique(keys, return_inverse=True)[1])

    @cached_property
    def meeting(self) -> Int64[np.ndarray, "n 3"]:
        """How many triangles meet at each side."""
        return np.asarray(np.bincount(self.edge)[self.edge].reshape(-1, 3))

    @cached_property
    def pairs(self) -> tuple[Int64[np.ndarray, "p 2"], Bool[np.ndarray, "p"]]:
        """Triangles that meet two at an edge, and whether one is wound against the other."""
        order = np.argsort(self.edge, kind="stable")
        count = np.bincount(self.edge)
        first = (np.cumsum(count) - count)[count == 2]
        both = order[np.stack([first, first + 1], axis=1)]
        ahead = self.ends[both, 0] < self.ends[both, 1]
        return both // 3, np.asarray(ahead[:, 0] == ahead[:, 1])

    @cached_property
    def piece(self) -> Int64[np.ndarray, "n"]:
        """Piece of each triangle: those that hang together by vertices."""
        group = groups(self.ends, int(self.faces.max()) + 1)[self.faces[:, 0]]
        return np.asarray(np.unique(group, return_inverse=True)[1])


def groups(links: Int64[np.ndarray, "m 2"], count: int) -> Int64[np.ndarray, "count"]:
    """Tell the groups of what is linked: a number for each."""
    graph = coo_array((np.ones(len(links), np.bool_), tuple(links.T)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)
