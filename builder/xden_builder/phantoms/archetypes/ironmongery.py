"""Hardware with works: hinge, pipe elbow, ball valve, door handle, caster."""

from __future__ import annotations

from typing import Final

import numpy as np
from manifold3d import CrossSection, Manifold

from xden_builder.phantoms import shapes
from xden_builder.phantoms.pieces import Archetype, Piece, moved

__all__ = ["ARCHETYPES"]


def hinge(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Two leaves with interlocking knuckles on a pin, part of the way open."""
    sheet, wide = rng.uniform(0.14, 0.22), size_cm * rng.uniform(0.28, 0.42)
    pin, knuckle = 1.1 * sheet, 2.2 * sheet
    leaf = shapes.box((wide, size_cm, sheet), (wide / 2, 0.0, sheet / 2 - knuckle))
    hole = shapes.cylinder(0.16, -9.0, 9.0) + shapes.cylinder(
        0.32, sheet - knuckle - 0.12, sheet - knuckle + 0.01
    )
    leaf -= shapes.union(
        hole.translate((x * wide, y * size_cm, 0))
        for x, y in ((0.5, 0.36), (0.8, 0.12), (0.5, -0.12), (0.8, -0.36))
    )
    fifth = size_cm / 5
    barrel = shapes.along_y(shapes.cylinder(knuckle, -size_cm / 2, size_cm / 2))
    odd = shapes.union(shapes.box((9.0, fifth - 0.01, 9.0), (0, i * fifth, 0)) for i in (-2, 0, 2))
    near = shapes.box((2.2 * knuckle, 2 * size_cm, 9.0))
    first = (leaf + barrel) - (near - odd)
    second = (leaf.mirror((1, 0, 0)) + barrel) - (near ^ odd)
    second = second.rotate((0, float(rng.uniform(0.0, 60.0)), 0))
    rod = shapes.along_y(shapes.cylinder(pin, -size_cm / 2 - 0.05, size_cm / 2 + 0.05))
    return [
        Piece("pin", "pin", rod),
        Piece("left_leaf", "leaf", second),
        Piece("right_leaf", "leaf", first),
    ]


def pipe_elbow(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Elbow with a beaded collar and a threaded bore at each mouth."""
    bore = size_cm * rng.uniform(0.17, 0.21)
    outer, collar, reach = 1.25 * bore, 1.5 * bore, 0.62 * size_cm
    arm = shapes.cylinder(outer, 0.0, reach) + shapes.slab(
        shapes.disc(collar), reach - 0.9 * bore, reach, 0.12 * bore
    )
    room = shapes.cylinder(0.82 * bore, 0.0, reach)
    room += shapes.thread(1.08 * bore, bore, 0.22 * bore, reach - 1.1 * bore, reach + 0.5)
    body = shapes.union([shapes.sphere(outer), arm, shapes.along_x(arm)])
    hollow = shapes.union([shapes.sphere(0.82 * bore), room, shapes.along_x(room)])
    return moved([Piece("body", "body", body - hollow)], lambda solid: solid.rotate((90, 0, 0)))


def ball_valve(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Bored ball between two seats, its stem through the bonnet to a lever; open or shut."""
    bore = size_cm * rng.uniform(0.075, 0.09)
    ball, half = 1.55 * bore, size_cm * rng.uniform(0.28, 0.32)
    turn = float(rng.choice([0.0, 90.0]))
    sphere = shapes.sphere(ball) - shapes.along_x(shapes.cylinder(bore, -9.0, 9.0)).rotate(
        (0, 0, turn)
    )
    slot = shapes.box((0.6 * bore, 9.0, 0.6 * bore), (0, 0, ball)).rotate((0, 0, turn))
    top = 3.6 * bore
    stem = shapes.cylinder(0.45 * bore, 0.95 * ball, top + 0.9 * bore)
    stem += shapes.box((0.55 * bore, 1.2 * bore, 0.5 * bore), (0, 0, ball)).rotate((0, 0, turn))
    seat = shapes.along_x(shapes.tube(1.35 * bore, bore, 0.8 * ball, 1.25 * ball))
    shell = shapes.along_x(
        shapes.cylinder(2.3 * bore, -1.5 * ball, 1.5 * ball)
        + shapes.slab(shapes.regular_polygon(6, 3.6 * bore), -half, -0.72 * half)
        + shapes.slab(shapes.regular_polygon(6, 3.6 * bore), 0.72 * half, half)
        + shapes.cylinder(1.55 * bore, -half, half)
    )
    shell += shapes.cylinder(0.95 * bore, 0.0, top)
    tapped = shapes.thread(1.25 * bore, 1.13 * bore, 0.22 * bore, 0.55 * half, half + 0.5)
    hollow = shapes.along_x(shapes.cylinder(bore, -half, half) + tapped + tapped.mirror((0, 0, 1)))
    hollow += shapes.sphere(1.01 * ball) + shapes.cylinder(0.45 * bore, 0.0, 9.0)
    reach = size_cm - half
    plan = shapes.polygon(
        [
            (-bore, -bore),
            (-bore, bore),
            (2.2 * bore, bore),
            (reach, 0.75 * bore),
            (reach, -0.75 * bore),
            (2.2 * bore, -bore),
        ],
        0.3 * bore,
    )
    lever = shapes.slab(plan, top, top + 0.3 * bore).rotate((0, 0, turn))
    grip = (
        shapes.slab(
            shapes.rounded_rectangle(0.62 * reach, 2.1 * bore, 0.8 * bore),
            top - 0.25 * bore,
            top + 0.55 * bore,
            0.2 * bore,
        )
        .translate((0.71 * reach, 0, 0))
        .rotate((0, 0, turn))
    )
    nut = shapes.slab(shapes.regular_polygon(6, 1.5 * bore), top + 0.3 * bore, top + 0.75 * bore)
    return [
        Piece("stem", "stem", stem),
        Piece("ball", "ball", sphere - slot),
        Piece("seats", "seat", seat + seat.mirror((1, 0, 0))),
        Piece("lever", "lever", lever),
        Piece("nut", "stem", nut),
        Piece("grip", "grip", grip),
        Piece("body", "body", shell - hollow),
    ]


def door_handle(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Lever on a rose with a square spindle, a return spring and two screws behind it."""
    bar, rose = size_cm * rng.uniform(0.065, 0.08), size_cm * rng.uniform(0.17, 0.2)
    out, deep = size_cm * rng.uniform(0.32, 0.4), 0.42 * rose
    reach = size_cm - rose
    hub = shapes.capsule(bar, 0.1, out + bar)
    lever = shapes.along_x(shapes.capsule(0.9 * bar, -0.9 * bar, reach)).scale((1, 1.15, 1))
    cup = shapes.slab(shapes.disc(rose), 0.0, deep, 0.3 * deep)
    cup -= shapes.cylinder(rose - 0.2, -1.0, deep - 0.2)
    spindle = shapes.box((0.8, 0.8, 0.35 * size_cm + 1.2), (0, 0, 1.2 - 0.175 * size_cm))
    coil = shapes.tube(0.62 * rose, 0.5 * rose, 0.2, deep - 0.25)
    plate = shapes.cylinder(rose - 0.201, 0.0, 0.2) - shapes.cylinder(0.9 * bar, -1.0, 1.0)
    screws = shapes.union(
        shapes.cylinder(0.2, -1.2, deep - 0.2).translate((0, y, 0))
        for y in (-0.8 * rose, 0.8 * rose)
    )
    pieces = [
        Piece("spindle", "spindle", spindle),
        Piece("screws", "screw", screws),
        Piece("lever", "lever", hub + lever.translate((0, 0, out))),
        Piece("spring", "spring", coil),
        Piece(
            "plate",
            "plate",
            plate + shapes.cylinder(0.62 * rose, 0.0, 0.2) - shapes.cylinder(bar, -1.0, 1.0),
        ),
        Piece("rose", "rose", cup),
    ]
    return moved(pieces, lambda solid: solid.rotate((90, 0, 0)))


def caster(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Wheel with hub and tyre on an axle in a fork, balls under its swivel plate."""
    wheel, wide = 0.36 * size_cm, size_cm * rng.uniform(0.2, 0.26)
    trail, high = 0.2 * wheel, size_cm - wheel
    axle = shapes.along_y(
        shapes.cylinder(0.14 * wheel, -0.85 * wide, 0.85 * wide)
        + shapes.slab(shapes.regular_polygon(6, 0.5 * wheel), 0.72 * wide, 0.84 * wide)
        + shapes.slab(shapes.regular_polygon(6, 0.5 * wheel), -0.84 * wide, -0.72 * wide)
    )
    rim = shapes.outline(
        [
            (0.0, -0.5),
            (0.35, -0.5),
            (0.35, -0.25),
            (0.75, -0.25),
            (0.75, 0.25),
            (0.35, 0.25),
            (0.35, 0.5),
            (0.0, 0.5),
        ]
    )
    hub = shapes.along_y(shapes.lathe(rim.scale((wheel, wide))))
    hub -= shapes.along_y(shapes.cylinder(0.14 * wheel, -9.0, 9.0))
    tyre = shapes.along_y(
        shapes.slab(shapes.disc(wheel), -wide / 2, wide / 2, 0.2 * wide)
        - shapes.cylinder(0.74 * wheel, -wide, wide)
    ) + shapes.along_y(shapes.tube(0.8 * wheel, 0.73 * wheel, -0.3 * wide, 0.3 * wide))
    fork = _fork(wheel, wide, trail, high)
    crown_z = high - 0.3 * wheel
    crown = shapes.box((1.3 * wheel, 1.44 * wide, 0.2 * wide), (trail, 0, crown_z - 0.1 * wide))
    race = shapes.cylinder(0.5 * wheel, crown_z - 0.02, high - 0.1 * size_cm * 0.4)
    plate_z = high - 0.04 * size_cm
    plate = shapes.slab(
        shapes.rounded_rectangle(1.7 * wheel, 1.5 * wheel, 0.2 * wheel), plate_z, high
    )
    hole = shapes.cylinder(0.11 * wheel, -99.0, 99.0)
    plate -= shapes.union(
        hole.translate((x * wheel, y * wheel, 0)) for x in (-0.66, 0.66) for y in (-0.55, 0.55)
    )
    rivet = shapes.cylinder(0.13 * wheel, crown_z - 0.3 * wide, high)
    top = [
        solid.translate((trail, 0, 0))
        for solid in (
            rivet,
            race - shapes.cylinder(0.3 * wheel, crown_z + 0.06, plate_z - 0.06),
            plate,
        )
    ]
    return [
        Piece("axle", "axle", axle),
        Piece("rivet", "axle", top[0]),
        Piece("hub", "hub", hub),
        Piece("tyre", "tyre", tyre),
        Piece("race", "race", top[1]),
        Piece("plate", "plate", top[2]),
        Piece("fork", "fork", fork + crown),
    ]


def _fork(wheel: float, wide: float, trail: float, high: float) -> Manifold:
    """Two cheeks from the axle at the origin up to the swivel behind it."""
    cheek = CrossSection.batch_hull(
        [shapes.disc(0.3 * wheel), shapes.disc(0.55 * wheel, (trail, high - 0.7 * wheel))]
    )
    cheek += CrossSection.batch_hull(
        [
            shapes.disc(0.5 * wheel, (trail, high - 0.9 * wheel)),
            shapes.disc(0.2 * wheel, (trail + 0.5 * wheel, high - 0.34 * wheel)),
            shapes.disc(0.2 * wheel, (trail - 0.5 * wheel, high - 0.34 * wheel)),
        ]
    )
    side = shapes.upright(cheek, 0.2 * wide)
    return side.translate((0, 0.62 * wide, 0)) + side.translate((0, -0.62 * wide, 0))


ARCHETYPES: Final = {
    "ball_valve": Archetype(ball_valve, "stem ball seat lever grip body"),
    "caster": Archetype(caster, "axle hub tyre race plate fork"),
    "door_handle": Archetype(door_handle, "spindle screw lever spring plate rose"),
    "hinge": Archetype(hinge, "pin leaf"),
    "pipe_elbow": Archetype(pipe_elbow, "body"),
}
