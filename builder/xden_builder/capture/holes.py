"""Holes of a surface, and the triangles that close them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import manifold3d
import numpy as np
import trimesh
from jaxtyping import Float64, Int64
from scipy.optimize import linear_sum_assignment

from xden1k.values.arrays import Vec3
from xden_builder.capture.sides import Sides

__all__ = ["Hole", "find_holes", "uneven_lip"]

FLAT: Final = 0.02
"""How far a rim may leave a plane to either side, as a share of its width."""
PARALLEL: Final = 0.9
"""Least cosine between the planes of two rims that lie within one another."""


@dataclass(frozen=True, slots=True, eq=False)
class Hole:
    """A hole, and how it is closed.

    Parameters
    ----------
    lid
        Shape (m, 3): triangles between the vertices around it, in the plane next to them.
    piece
        Of the surface, that it is in.
    share
        Area of the lid over that of the piece.
    width_cm
        The farther of its two extents in that plane.
    thickness_cm
        How far the rim reaches along the plane's normal.
    middle_cm, normal
        Of the plane.
    """

    lid: Int64[np.ndarray, "m 3"]
    piece: int
    share: float
    width_cm: float
    thickness_cm: float
    middle_cm: Vec3
    normal: Vec3

    @property
    def flat(self) -> bool:
        """Whether the rim lies in a plane."""
        return self.thickness_cm <= 2 * FLAT * self.width_cm

    def within(self, other: Hole) -> bool:
        """Whether one of them lies above the other."""
        apart = other.middle_cm - self.middle_cm
        beside = apart - (apart @ self.normal) * self.normal
        near = np.linalg.norm(beside) < max(self.width_cm, other.width_cm) / 2
        return bool(near and abs(self.normal @ other.normal) > PARALLEL)

    def coplanar(self, other: Hole) -> bool:
        """Whether both lie in one plane."""
        off = abs((other.middle_cm - self.middle_cm) @ self.normal)
        return bool(off <= FLAT * max(self.width_cm, other.width_cm))


def find_holes(solid: trimesh.Trimesh) -> list[Hole]:
    """Find the holes of a surface whose triangles are wound alike."""
    sides = Sides(np.asarray(solid.faces))
    area = np.bincount(sides.piece, weights=solid.area_faces)
    owners = dict(zip(map(tuple, sides.ends.tolist()), sides.piece.repeat(3).tolist(), strict=True))
    return [
        _hole(solid, rim, owners[int(rim[1]), int(rim[0])], area)
        for rim in _rims(sides, np.asarray(solid.vertices), np.asarray(solid.vertex_normals))
    ]


def _hole(
    solid: trimesh.Trimesh, rim: Int64[np.ndarray, "n"], piece: int, area: Float64[np.ndarray, "p"]
) -> Hole:
    around = np.asarray(solid.vertices)[rim]
    middle = around.mean(axis=0)
    axes = np.linalg.svd(around - middle, full_matrices=False)[2]
    seen = (around - middle) @ axes.T
    lid = _lid(seen[:, :2])
    first, second, third = around[lid].transpose(1, 0, 2)
    lid_cm2 = float(np.linalg.norm(np.cross(second - first, third - first), axis=1).sum() / 2)
    extents = np.ptp(seen, axis=0)
    return Hole(
        lid=rim[lid],
        piece=piece,
        share=lid_cm2 / max(float(area[piece]), np.finfo(float).tiny),
        width_cm=float(extents[:2].max()),
        thickness_cm=float(extents[2]) if len(rim) > 3 else 0.0,
        middle_cm=middle,
        normal=axes[2] if len(axes) == 3 else np.cross(*axes[:2]),
    )


def _lid(flat: Float64[np.ndarray, "n 2"]) -> Int64[np.ndarray, "m 3"]:
    """Triangles between points around a hole, which keep the direction of the rim."""
    after = np.roll(flat, -1, axis=0)
    turn = (flat[:, 0] * after[:, 1] - flat[:, 1] * after[:, 0]).sum()
    seen = flat if turn >= 0 else flat * [1.0, -1.0]
    return np.asarray(manifold3d.triangulate([seen]), dtype=np.int64)


def uneven_lip(holes: list[Hole]) -> tuple[Hole, Hole] | None:
    """Find holes of two walls, one within the other, that do not end in one plane."""
    for one in holes:
        others = [each for each in holes if each.piece != one.piece and one.within(each)]
        if others and not any(one.coplanar(each) for each in others):
            return one, others[0]
    return None


def _rims(
    sides: Sides, points: Float64[np.ndarray, "v 3"], normals: Float64[np.ndarray, "v 3"]
) -> list[Int64[np.ndarray, "n"]]:
    """Vertices around each hole, in the order in which what closes it runs along them.

    Sides that no neighbour runs along the other way, turned round: as many of them come to each
    vertex as leave it.
    """
    start, end = _open_sides(sides)
    after = np.empty(len(start), dtype=np.int64)
    coming, leaving = np.argsort(end, kind="stable"), np.argsort(start, kind="stable")
    after[coming] = leaving
    vertices, first, count = np.unique(end[coming], return_index=True, return_counts=True)
    for vertex, at, many in zip(vertices, first, count, strict=True):
        if many > 1:
            here = slice(at, at + many)
            come, leave = coming[here], leaving[here]
            back, on = points[start[come]] - points[vertex], points[end[leave]] - points[vertex]
            after[come] = leave[_through(_clockwise(back, on, normals[vertex]))]
    rims, left = [], np.ones(len(start), dtype=np.bool_)
    for number in range(len(start)):
        rim = []
        while left[number]:
            left[number] = False
            rim.append(start[number])
            number = after[number]
        if rim:
            rims.append(np.array(rim))
    return rims


def _open_sides(sides: Sides) -> tuple[Int64[np.ndarray, "s"], Int64[np.ndarray, "s"]]:
    """Give both ends of the sides that no neighbour runs along, as one would."""
    ahead = np.where(sides.ends[:, 0] < sides.ends[:, 1], 1, -1)
    net = np.bincount(sides.edge, weights=ahead).astype(np.int64)
    _, first = np.unique(sides.edge, return_index=True)
    ends = np.sort(sides.ends[first], axis=1)
    turned = np.where(net[:, None] > 0, ends[:, ::-1], ends)
    each = np.repeat(turned, abs(net), axis=0)
    return each[:, 0], each[:, 1]


def _clockwise(
    back: Float64[np.ndarray, "k 3"], on: Float64[np.ndarray, "k 3"], normal: Vec3
) -> Float64[np.ndarray, "k k"]:
    """Angles from each way back to each way on, through the hole, seen from outside."""
    first = np.cross(normal, np.eye(3)[abs(normal).argmin()])
    second = np.cross(normal, first)  # as long as the first: the normal is one long, or nothing
    angles = [np.arctan2(ways @ second, ways @ first) for ways in (back, on)]
    return np.asarray((angles[0][:, None] - angles[1]) % (2 * np.pi))


def _through(angles: Float64[np.ndarray, "k k"]) -> list[int]:
    """Choose a way on for each way back such that the angles between add up to least."""
    return [int(place) for place in linear_sum_assignment(angles)[1]]
