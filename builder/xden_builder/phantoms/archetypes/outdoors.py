"""Long sports gear: a tennis racket, a skateboard."""

from __future__ import annotations

from typing import Final

import numpy as np
from manifold3d import CrossSection, Manifold

from xden_builder.phantoms import fittings, shapes, skins
from xden_builder.phantoms.pieces import Archetype, Piece

__all__ = ["ARCHETYPES"]


def tennis_racket(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Hollow hoop with a throat and a shaft, strings through it, a wrapped handle with a plug."""
    long, wide = 0.245 * size_cm, size_cm * rng.uniform(0.17, 0.19)
    beam, flat, wall = 0.018 * size_cm, 0.013 * size_cm, 0.16
    middle, grip = size_cm - long - flat, 0.28 * size_cm
    angle = 2 * np.pi * np.arange(72) / 72
    hoop = np.stack([middle + long * np.cos(angle), wide * np.sin(angle), 0 * angle], axis=1)
    arm = [(0.9 * grip, 0.25 * flat, 0.0), (0.4 * size_cm, 0.6 * flat, 0.0)]
    arm += [(0.47 * size_cm, 0.3 * wide, 0.0), (middle - 0.62 * long, 0.78 * wide, 0.0)]
    path = skins.smooth_path(arm, 24)
    outside, room = Manifold(), Manifold()
    for less in (0.0, wall):
        solid = skins.pipe(hoop, flat - less, beam - less, closed=True)
        side = skins.pipe(path, flat - less, beam - less)
        solid += side + side.mirror((0, 1, 0))
        outside, room = (solid, room) if less == 0.0 else (outside, solid)
    core = shapes.along_x(skins.loft([(0.0, 1.25, 1.45), (grip, 1.15, 1.35)], 4.0))
    hollow = shapes.along_x(skins.loft([(1.5, 0.95, 1.15), (grip - 0.5, 0.85, 1.05)], 4.0))
    wrap = shapes.along_x(skins.loft([(0.3, 1.45, 1.65), (0.97 * grip, 1.35, 1.55)], 4.0))
    butt = shapes.along_x(shapes.slab(shapes.rounded_rectangle(3.2, 3.6, 0.8), -0.8, 0.9, 0.3))
    grommets = skins.pipe(hoop[:37], flat + 0.12, 0.3 * beam) - outside  # the bumper over the tip
    return [
        Piece("strings", "string", _strings(long, wide, flat).translate((middle, 0, 0))),
        Piece("bumper", "trim", grommets),
        Piece("butt", "trim", butt - core),
        Piece("frame", "frame", (outside - room) + (core - hollow) - (room - core)),
        Piece("grip", "grip", wrap - core),
    ]


def _strings(long: float, wide: float, flat: float) -> Manifold:
    """Mains and crosses that end in the hoop, each cross over every other main."""
    reach, gauge = 0.5 * flat, 0.065
    solids = []
    for across, (half, other), count in ((False, (wide, long), 16), (True, (long, wide), 19)):
        for at in np.linspace(-0.84, 0.84, count) * half:
            end = (other + reach) * np.sqrt(1 - (at / half) ** 2)
            rod = shapes.along_x(shapes.cylinder(gauge, -end, end))
            solids.append(
                (rod.rotate((0, 0, 90)) if across else rod).translate(
                    (at, 0, 0) if across else (0, at, 0)
                )
            )
    return shapes.union(solids)


def skateboard(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Bent deck with grit on it; bolted trucks with bushes; wheels on bearings."""
    wide, thick = size_cm * rng.uniform(0.24, 0.28), rng.uniform(1.0, 1.2)
    base, wheel = 0.3 * size_cm, rng.uniform(2.5, 3.0)
    plan = CrossSection.batch_hull(
        [shapes.disc(wide / 2, (s * (size_cm - wide) / 2, 0)) for s in (-1, 1)]
    )
    low = wheel + 4.4
    flat = [shapes.slab(plan, low, low + thick), shapes.slab(plan, low + thick, low + thick + 0.12)]

    def kick(x: np.ndarray) -> np.ndarray:
        return np.asarray(0.3 * np.maximum(np.abs(x) - base - 2.8, 0.0))

    deck, grit = (fittings.bent(solid, kick, 1.5) for solid in flat)
    bolt = shapes.cylinder(0.24, low - 0.9, low + thick) + shapes.cylinder(
        0.45, low - 0.9, low - 0.5
    )
    spots = [
        (x, y) for x in (-base - 2.0, -base + 2.0, base - 2.0, base + 2.0) for y in (-1.5, 1.5)
    ]
    bolts = shapes.union(bolt.translate((x, y, 0)) for x, y in spots)
    trucks = [
        (name, solids)
        for name, turn in (("front", 0.0), ("rear", 180.0))
        for solids in [_truck(wide, wheel, low, base, turn)]
    ]
    wheels = [
        Piece(f"wheel_{i + 1}", "wheel", solid)
        for i, solid in enumerate(
            _wheel(wheel).translate((x, y * (wide / 2 - 1.2), wheel))
            for x in (-base, base)
            for y in (-1, 1)
        )
    ]
    return [
        Piece("bolts", "bolt", bolts),
        *(
            Piece(f"{name}_{part}", role, solid)
            for name, solids in trucks
            for part, role, solid in solids
        ),
        *wheels,
        Piece("deck", "deck", deck),
        Piece("grit", "grit", grit),
    ]


def _wheel(radius: float) -> Manifold:
    """Cast wheel across y with a seat for a bearing in each face."""
    body = shapes.slab(shapes.disc(radius), -1.6, 1.6, 0.5) - shapes.cylinder(0.6, -9.0, 9.0)
    seat = shapes.cylinder(1.1, 0.7, 9.0)
    return shapes.along_y(body - seat - seat.mirror((0, 0, 1)))


def _truck(
    wide: float, wheel: float, low: float, base: float, turn: float
) -> list[tuple[str, str, Manifold]]:
    """Parts of a truck below the deck, its axle across y at the wheels' middle."""
    half = wide / 2 + 0.7
    axle = shapes.along_y(shapes.cylinder(0.4, -half, half)).translate((0, 0, wheel))
    seats = (-0.9, 0.9)
    race = shapes.tube(1.1, 0.9, -0.35, 0.35) + shapes.tube(0.6, 0.4, -0.35, 0.35)
    race += shapes.around(shapes.sphere(0.16, (0.75, 0, 0)), 7)
    bearings = shapes.union(
        shapes.along_y(race).translate((0, s * (wide / 2 - 1.2) + y * 1.16, wheel))
        for s in (-1, 1)
        for y in seats
    )
    plate = shapes.box((6.4, 4.6, 0.5), (0, 0, low - 0.25))
    block = fittings.strut((1.9, 0, low - 0.3), (1.5, 0, low - 1.2), 0.8, 0.7)
    pin = shapes.cylinder(0.45, low - 3.7, low - 0.2).translate((-0.9, 0, 0))
    bush = shapes.tube(1.1, 0.45, low - 2.0, low - 0.5) + shapes.tube(
        1.0, 0.45, low - 3.5, low - 2.6
    )
    hanger = shapes.along_y(shapes.cylinder(0.85, 3.0 - half, half - 3.0)).translate((0, 0, wheel))
    yoke = shapes.tube(1.25, 0.45, low - 2.6, low - 2.0).translate((-0.9, 0, 0))
    hanger += yoke + fittings.strut((0, 0, wheel + 0.3), (0, 0, low - 2.4), 0.8)
    hanger += fittings.strut((0, 0, wheel + 0.3), (1.5, 0, low - 1.6), 0.7, 0.45)
    solids = [
        ("axle", "axle", axle),
        ("pin", "axle", pin),
        ("bearings", "bearing", bearings),
        ("bush", "bush", bush.translate((-0.9, 0, 0))),
        ("base", "truck", plate + block),
        ("hanger", "truck", hanger),
    ]
    return [
        (name, role, solid.rotate((0, 0, turn)).translate((base if turn else -base, 0, 0)))
        for name, role, solid in solids
    ]


ARCHETYPES: Final = {
    "skateboard": Archetype(skateboard, "bolt axle bearing bush truck wheel deck grit"),
    "tennis_racket": Archetype(tennis_racket, "string trim frame grip"),
}
