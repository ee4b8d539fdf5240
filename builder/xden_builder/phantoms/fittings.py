"""What many objects share: vessels, hollow cases, bars between points, cells, circuit boards.

Lengths are centimetres.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from manifold3d import CrossSection, Manifold

from xden1k.values.arrays import Points
from xden_builder.phantoms import shapes, skins
from xden_builder.phantoms.pieces import Piece

__all__ = [
    "bar",
    "bent",
    "board",
    "case",
    "cell",
    "curve",
    "ellipsoid",
    "grip",
    "ring",
    "strut",
    "vessel",
]

Point = tuple[float, float, float]


def vessel(
    profile: Sequence[tuple[float, float]], wall_cm: float, fillet_cm: float = 0.0
) -> tuple[Manifold, Manifold]:
    """Open shell of even wall through (radius, z) points from the axis to the rim, and its room.

    What the room holds is part of it: cut it above the level of a liquid.
    """
    radius, rim = profile[-1]
    beyond = rim + wall_cm + fillet_cm + 1.0  # closed beyond the rim, then cut open
    outside = shapes.outline([*profile, (radius, beyond), (0.0, beyond)], fillet_cm)
    room = shapes.lathe(shapes.inset(outside, wall_cm))
    return shapes.cut_above(shapes.lathe(outside) - room, rim), shapes.cut_above(room, rim)


def case(
    section: CrossSection, z0_cm: float, z1_cm: float, wall_cm: float, edge_cm: float = 0.0
) -> tuple[Manifold, Manifold]:
    """Make a closed shell of even wall around an extruded convex outline, and the room in it."""
    outside = shapes.slab(section, z0_cm, z1_cm, edge_cm)
    inner = max(edge_cm - wall_cm, 0.0)
    room = shapes.slab(shapes.inset(section, wall_cm), z0_cm + wall_cm, z1_cm - wall_cm, inner)
    return outside - room, room


def ellipsoid(radii_cm: Point, centre: Point = (0.0, 0.0, 0.0)) -> Manifold:
    """Ball scaled along the axes."""
    corners = shapes.segments(max(radii_cm))
    return Manifold.sphere(1.0, corners).scale(radii_cm).translate(centre)


def ring(radius_cm: float, wire_cm: float, z_cm: float = 0.0) -> Manifold:
    """Ring of round wire about the z axis."""
    return shapes.lathe(shapes.disc(wire_cm, (radius_cm, z_cm)))


def strut(start: Point, end: Point, radius_cm: float, end_radius_cm: float = 0.0) -> Manifold:
    """Round bar from one point to another with ball ends, tapered on request."""
    last = end_radius_cm or radius_cm
    return Manifold.batch_hull([shapes.sphere(radius_cm, start), shapes.sphere(last, end)])


def bar(
    points: Sequence[Point], radius_cm: float, other_cm: float | None = None, count: int = 30
) -> Manifold:
    """Round or oval bar along a smooth line through points."""
    return skins.pipe(skins.smooth_path(points, count), radius_cm, other_cm)


def bent(
    solid: Manifold,
    rise: Callable[[np.ndarray], np.ndarray],
    step_cm: float,
) -> Manifold:
    """Lift each point by a height that depends on its x, as a stamped sheet is bent."""

    def lift(points: Points) -> Points:
        lifted = np.array(points)
        lifted[:, 2] += rise(lifted[:, 0])
        return lifted

    return solid.refine_to_length(step_cm).warp_batch(lift)


def curve(points: Sequence[tuple[float, float]], count: int = 16) -> list[tuple[float, float]]:
    """Smooth line through points of the plane."""
    x, _, y = skins.smooth_path([(x, 0.0, y) for x, y in points], count).T.tolist()
    return list(zip(x, y, strict=True))


def grip(start_cm: float, end_cm: float, thick_cm: float, wide_cm: float) -> Manifold:
    """Swelling handle along x: half thickness in z, half width in y."""
    shares = [(0, 0.5, 0.5), (0.04, 0.75, 0.75), (0.35, 0.95, 0.9), (0.7, 1.0, 1.0)]
    shares += [(0.95, 0.85, 0.8), (1.0, 0.5, 0.5)]
    ovals = [(t * (end_cm - start_cm), thick_cm * x, wide_cm * y) for t, x, y in shares]
    return shapes.along_x(skins.loft(ovals, 2.5)).translate((start_cm, 0.0, 0.0))


def cell(radius_cm: float, z0_cm: float, z1_cm: float) -> Manifold:
    """Round battery with its nub at the upper end."""
    nub = 0.03 * (z1_cm - z0_cm)
    return shapes.cylinder(radius_cm, z0_cm, z1_cm - nub) + shapes.cylinder(
        0.35 * radius_cm, z0_cm, z1_cm
    )


def board(
    rng: np.random.Generator,
    size_cm: tuple[float, float],
    z_cm: float,
    centre: tuple[float, float] = (0.0, 0.0),
) -> list[Piece]:
    """Circuit board on a height, 1.6 mm thick, with chips on it."""
    long, wide = size_cm
    x, y = centre
    chips = shapes.union(
        shapes.box(
            (long * rng.uniform(0.1, 0.2), wide * rng.uniform(0.15, 0.35), 0.14),
            (x + long * share, y + wide * rng.uniform(-0.25, 0.25), z_cm + 0.23),
        )
        for share in (-0.32, 0.0, 0.3)
    )
    plate = shapes.box((long, wide, 0.16), (x, y, z_cm + 0.08))
    return [Piece("board", "board", plate), Piece("chips", "chip", chips)]
