"""Solids whose surface is skinned over rings: ovals along an axis, bars along a path, springs.

Lengths are centimetres.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, pi

import numpy as np
from jaxtyping import Float
from manifold3d import Error, Manifold, Mesh64

from xden1k.errors import DataError
from xden1k.values.arrays import Points
from xden_builder.phantoms.shapes import segments

__all__ = ["bent_path", "helix", "loft", "pipe", "skin", "smooth_path", "spring"]


def skin(rings: Float[np.ndarray, "rings corners 3"], closed: bool = False) -> Manifold:
    """Solid whose surface joins rings of equally many corners, one after the other.

    Parameters
    ----------
    rings
        Shape (rings, corners, 3).
    closed
        Join the last ring to the first (a loop) instead of capping both ends.

    Raises
    ------
    DataError
        If the surface is not that of a solid.
    """
    count, corners, _ = rings.shape
    index = np.arange(count * corners).reshape(count, corners)
    lower = index if closed else index[:-1]
    upper = np.roll(index, -1, axis=0) if closed else index[1:]
    a, b, c, d = lower, np.roll(lower, -1, axis=1), np.roll(upper, -1, axis=1), upper
    faces = [np.stack(corner, axis=-1).reshape(-1, 3) for corner in ((a, b, c), (a, c, d))]
    vertices = rings.reshape(-1, 3)
    if not closed:
        vertices = np.concatenate([vertices, rings[[0, -1]].mean(axis=1)])
        for ring, centre, step in ((index[0], len(vertices) - 2, 1), (index[-1], -1, -1)):
            middle = np.full(corners, centre % len(vertices))
            faces.append(np.stack([np.roll(ring, -step), ring, middle], axis=-1))
    return _solid(vertices, np.concatenate(faces))


def _solid(vertices: Points, faces: np.ndarray) -> Manifold:
    """Manifold of a triangle mesh, wound outward."""
    signed = np.linalg.det(vertices[faces]).sum()
    wound = faces if signed > 0 else faces[:, ::-1]
    solid = Manifold(
        Mesh64(np.ascontiguousarray(vertices), np.ascontiguousarray(wound, dtype=np.uint64))
    )
    if solid.status() != Error.NoError or not solid.volume() > 0:
        raise DataError(
            f"a skinned surface must bound a solid, got {solid.status().name} and "
            f"{solid.volume():g} cm³"
        )
    return solid


def loft(stations: Sequence[tuple[float, float, float]], exponent: float = 2.0) -> Manifold:
    """Solid through ovals: (z, half width in x, half width in y), ascending z.

    ``exponent`` 2 gives ellipses, larger values squarer super-ellipses.
    """
    widest = max(max(x, y) for _, x, y in stations)
    angles = 2 * pi * np.arange(segments(widest)) / segments(widest)
    x, y = (np.sign(f) * np.abs(f) ** (2 / exponent) for f in (np.cos(angles), np.sin(angles)))
    rings = [
        np.stack([half_x * x, half_y * y, np.full_like(x, z)], axis=1)
        for z, half_x, half_y in stations
    ]
    return skin(np.stack(rings))


def smooth_path(points: Sequence[tuple[float, ...]], count: int = 24) -> Float[np.ndarray, "n 3"]:
    """Cubic spline through points, sampled evenly in its parameter (chord length)."""
    from scipy.interpolate import CubicSpline

    corners = np.array(points, dtype=np.float64)
    steps = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    at = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(CubicSpline(at, corners)(np.linspace(0.0, at[-1], count)))


def bent_path(
    points: Sequence[tuple[float, ...]], radius_cm: float, per_bend: int = 8
) -> Float[np.ndarray, "n 3"]:
    """Straight lines between points, each corner rounded as bent wire is.

    A bend starts and ends ``radius_cm`` before and after its corner, or half way to the next.
    """
    corners = np.array(points, dtype=np.float64)
    path = [corners[:1]]
    for before, corner, after in zip(corners, corners[1:], corners[2:], strict=False):
        steps = (before - corner, after - corner)
        start, end = (
            corner + step * min(radius_cm / float(np.linalg.norm(step)), 0.49) for step in steps
        )
        at = np.linspace(0.0, 1.0, per_bend)[:, None]
        path.append((1 - at) ** 2 * start + 2 * at * (1 - at) * corner + at**2 * end)
    return np.concatenate([*path, corners[-1:]])


def helix(
    radius_cm: float, z0_cm: float, z1_cm: float, turns: float, per_turn: int = 14
) -> Float[np.ndarray, "n 3"]:
    """Points of a helix about the z axis."""
    at = np.linspace(0.0, 1.0, ceil(turns * per_turn) + 1)
    angle = 2 * pi * turns * at
    x, y = radius_cm * np.cos(angle), radius_cm * np.sin(angle)
    return np.stack([x, y, z0_cm + (z1_cm - z0_cm) * at], axis=1)


def pipe(
    path: Float[np.ndarray, "n 3"],
    radius_cm: float,
    other_radius_cm: float | None = None,
    closed: bool = False,
) -> Manifold:
    """Round or oval bar along a path.

    Parameters
    ----------
    path
        Shape (n, 3); a closed path does not repeat its first point.
    radius_cm
        Half width across the path, in the plane of its first bend.
    other_radius_cm
        Half width square to that plane; the same when left out.
    closed
        Join the end to the start; the path should then lie in a plane.
    """
    other = radius_cm if other_radius_cm is None else other_radius_cm
    corners = segments(max(radius_cm, other))
    angles = 2 * pi * np.arange(corners) / corners
    across, aside = _frames(path, closed)
    ring = (
        radius_cm * np.cos(angles)[:, None] * across[:, None]
        + other * np.sin(angles)[:, None] * aside[:, None]
    )
    return skin(path[:, None] + ring, closed)


def _frames(
    path: Float[np.ndarray, "n 3"], closed: bool
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Two unit vectors square to the path at each point, carried along without twist."""
    if closed:
        tangents = np.roll(path, -1, axis=0) - np.roll(path, 1, axis=0)
    else:
        tangents = np.gradient(path, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    across = np.zeros_like(path)
    start = _bend(tangents)
    for i, tangent in enumerate(tangents):
        start = start - tangent * (start @ tangent)
        start /= np.linalg.norm(start)
        across[i] = start
    return across, np.cross(tangents, across)


def _bend(tangents: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "3"]:
    """Direction into which the path bends most, or any across it if it is straight."""
    off = tangents - tangents[0] * (tangents @ tangents[0])[:, None]
    most = off[np.argmax(np.linalg.norm(off, axis=1))]
    if np.linalg.norm(most) > 1e-6:
        return np.asarray(most)
    return np.asarray(np.eye(3)[np.argmin(np.abs(tangents[0]))])


def spring(radius_cm: float, wire_cm: float, z0_cm: float, z1_cm: float, turns: float) -> Manifold:
    """Coil of round wire of radius ``wire_cm`` that fills the heights given."""
    path = helix(radius_cm - wire_cm, z0_cm + wire_cm, z1_cm - wire_cm, turns)
    return pipe(path, wire_cm)
