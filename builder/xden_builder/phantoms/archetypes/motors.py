"""Personal care that runs on a motor: electric toothbrush, shaver, hair dryer."""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np
from manifold3d import Manifold

from xden_builder.phantoms import shapes, skins
from xden_builder.phantoms.archetypes.care import tufts
from xden_builder.phantoms.pieces import Archetype, Piece, moved

__all__ = ["ARCHETYPES"]


def handset(rng: np.random.Generator, size_cm: float, head: str) -> list[Piece]:
    """Cordless body with cell, motor, board and button, and a head that brushes or shaves."""
    radius = size_cm * (0.068 if head == "brush" else 0.125)
    wall, top = 0.18, size_cm * (0.64 if head == "brush" else 0.76)
    cell_r, cell_l = 0.56 * radius, min(5.0, 0.42 * top)
    profile = [(0.0, 0.9), (0.04, 1.0), (0.5, 1.0), (0.85, 0.95), (1.0, 0.8)]
    body = skins.loft([(z * top, radius * s, 0.92 * radius * s) for z, s in profile], 2.4)
    room = skins.loft(
        [(wall, 0.9 * radius - wall, 0.82 * radius - wall)]
        + [(z * top, radius * s - wall, 0.92 * radius * s - wall) for z, s in profile[1:4]]
        + [(top - wall, 0.82 * radius - wall, 0.75 * radius - wall)],
        2.4,
    )
    low = wall + 0.5
    frame = shapes.box((0.3, 2 * radius, top - 2 * wall - 0.1), (-0.62 * radius, 0, top / 2)) ^ room
    cell = shapes.cylinder(cell_r, low, low + cell_l)
    coil = shapes.tube(0.8 * cell_r, 0.4 * cell_r, wall, low)
    motor_z = low + cell_l + 0.3
    motor = shapes.cylinder(cell_r, motor_z, top - 1.0)
    board = shapes.box((0.16, 1.1 * radius, 0.7 * top), (0.6 * radius, 0, 0.47 * top)) ^ room
    board -= shapes.cylinder(cell_r, 0.0, size_cm)
    button = shapes.along_x(shapes.cylinder(0.35 * radius, 0.6 * radius, 1.06 * radius)).translate(
        (0, 0, 0.55 * top)
    )
    bridge = shapes.box((1.2 * radius, 0.4 * radius, 0.3), (0, 0, motor_z - 0.15)) ^ room
    pieces = [
        Piece("cell", "cell", cell),
        Piece("motor", "motor", motor),
        Piece("contact", "contact", coil),
        Piece("board", "board", board),
        Piece("button", "button", button),
        Piece("frame", "frame", frame + bridge),
    ]
    tops = _brush_head if head == "brush" else _foil_head
    pieces += tops(radius, top, size_cm)
    return moved([*pieces, Piece("shell", "shell", body - room)], shapes.along_x)


def _brush_head(radius: float, top: float, size: float) -> list[Piece]:
    """Steel shaft out of the body, a slip-on neck with tufts."""
    shaft = shapes.cylinder(0.18, top - 1.05, top + 2.0)
    stations = [(top, 0.75 * radius), (0.8 * size, 0.5 * radius), (0.9 * size, 0.42 * radius)]
    neck = skins.loft([(z, r, r) for z, r in [*stations, (size, 0.5 * radius)]])
    spots = [(i * 0.24, j * 0.24) for i in range(-3, 4) for j in (-1, 0, 1)]
    hair = tufts(spots, 0.085, 0.2 * radius, 0.4 * radius + 1.0)
    hair = hair.rotate((0, 90, 0)).translate((0, 0, size - 1.0))
    return [
        Piece("shaft", "shaft", shaft),
        Piece("bristles", "bristles", hair),
        Piece("neck", "head", neck),
    ]


def _foil_head(radius: float, top: float, size: float) -> list[Piece]:
    """Drive pin, cutter blocks under two arched foils, a frame around them."""
    long, half = 0.85 * radius, 0.36 * radius
    pin = shapes.cylinder(0.15, top - 1.05, size - 0.9 * half)
    arch = shapes.along_y(shapes.tube(half, half - 0.06, -long, long))
    arch = arch.trim_by_plane((0, 0, 1), -0.02)
    cutter = shapes.along_y(shapes.cylinder(half - 0.06, -0.85 * long, 0.85 * long))
    teeth = shapes.union(
        shapes.box((9, 0.08, 2 * half), (0, y, 0.7 * half))
        for y in np.arange(-0.8 * long, 0.8 * long, 0.2)
    )
    z = size - half
    pair = [(-half, 0, z), (half, 0, z)]
    base = skins.loft(
        [
            (top - 0.1, 0.8 * radius, 0.75 * radius),
            (z - 0.3 * half, 2.1 * half, 1.04 * long),
            (z + 0.2 * half, 2.15 * half, 1.06 * long),
        ],
        4.0,
    )
    return [
        Piece("pin", "shaft", pin),
        *(Piece(f"foil_{i + 1}", "foil", arch.translate(at)) for i, at in enumerate(pair)),
        *(
            Piece(f"cutter_{i + 1}", "cutter", (cutter - teeth).translate(at))
            for i, at in enumerate(pair)
        ),
        Piece("head", "head", base - shapes.box((9, 9, 9), (0, 0, -4.5 + top))),
    ]


def hair_dryer(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Barrel with motor, fan, heater and grilles, a hollow handle with a switch and cable."""
    radius, wall = size_cm * rng.uniform(0.15, 0.18), 0.22
    long = size_cm * rng.uniform(0.72, 0.82)
    rim = size_cm - radius
    outer = [(0.0, 0.75), (0.06, 0.95), (0.3, 1.0), (0.65, 0.85), (1.0, 0.6)]
    profile = [(r * radius, z * long) for z, r in outer]
    solid = shapes.lathe(shapes.outline([(0, 0), *profile, (0, long)]))
    room = shapes.lathe(
        shapes.outline(
            [(0, -1)]
            + [(r - wall, z) for r, z in [(profile[0][0], -1), *profile]]
            + [(profile[-1][0] - wall, long + 1), (0, long + 1)]
        )
    )
    grille = shapes.union(
        shapes.tube(r * radius, r * radius - 0.12, 0.1, 0.4) for r in (0.25, 0.45, 0.65)
    ) + shapes.union(
        shapes.box((1.6 * radius, 0.14, 0.3), (0, 0, 0.25)).rotate((0, 0, a)) for a in (0, 60, 120)
    )
    grille = grille ^ shapes.cylinder(0.75 * radius - 0.05, 0, 1)
    grip = skins.loft(
        [
            (0.0, 0.42 * radius, 0.5 * radius),
            (0.06 * size_cm, 0.55 * radius, 0.62 * radius),
            (rim, 0.62 * radius, 0.62 * radius),
        ],
        2.5,
    )
    hollow = skins.loft(
        [
            (wall, 0.42 * radius - wall, 0.5 * radius - wall),
            (0.06 * size_cm, 0.55 * radius - wall, 0.62 * radius - wall),
            (rim, 0.62 * radius - wall, 0.62 * radius - wall),
        ],
        2.5,
    )
    at = (-0.3 * long, 0, rim)
    inside = [
        s.rotate((0, 90, 0)).translate(at)
        for s in (solid, room, grille, *_blower(radius, long, room))
    ]
    switch = shapes.rounded_box((0.5, 0.8, 1.6), 0.12, (0.58 * radius, 0, 0.55 * rim))
    shell = (inside[0] + grip) - inside[1] - (hollow - inside[0])
    cable = shapes.cylinder(0.3, -0.9, 1.5) + shapes.cylinder(0.42, wall, 0.6)
    return [
        Piece("cable", "cable", cable),
        Piece("switch", "button", switch),
        Piece("axle", "axle", inside[5]),
        Piece("motor", "motor", inside[3]),
        Piece("heater", "heater", inside[8]),
        Piece("insulator", "insulator", inside[7]),
        Piece("fan", "fan", inside[4] - inside[3]),
        Piece("mounts", "frame", inside[6]),
        Piece("grille", "frame", inside[2] + (inside[6] ^ inside[2])),
        Piece("shell", "shell", shell),
    ]


def _blower(radius: float, long: float, room: Manifold) -> list[Manifold]:
    """Motor, fan, axle, mounts, heater's cross and heater, up the barrel from z = 0."""
    motor = shapes.cylinder(0.36 * radius, 0.12 * long, 0.4 * long)
    fan = shapes.cylinder(0.2 * radius, 0.42 * long, 0.5 * long) + shapes.around(
        shapes.box((0.75 * radius, 0.1, 0.09 * long), (0.4 * radius, 0, 0.46 * long)).rotate(
            (0, 0, 0)
        ),
        7,
    )
    axle = shapes.cylinder(0.12, 0.35 * long, 0.48 * long)
    mounts = (
        shapes.around(shapes.box((radius, 0.2, 0.2 * long), (0.5 * radius, 0, 0.25 * long)), 3)
        ^ room
    )
    cross = (
        shapes.union(
            shapes.box((9 * radius, 0.1, 0.36 * long), (0, 0, 0.76 * long)).rotate((0, 0, a))
            for a in (0, 90)
        )
        ^ room
    )
    heater = skins.spring(0.42 * radius, 0.07, 0.6 * long, 0.93 * long, 7.0)
    return [motor, fan, axle, mounts, cross, heater]


ARCHETYPES: Final = {
    "hair_dryer": Archetype(hair_dryer, "cable button axle motor heater insulator fan frame shell"),
    "handset:brush": Archetype(
        partial(handset, head="brush"),
        "cell motor contact board button frame shaft bristles head shell",
    ),
    "handset:foil": Archetype(
        partial(handset, head="foil"),
        "cell motor contact board button frame shaft foil cutter head shell",
    ),
}
