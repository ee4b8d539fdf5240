"""Machines with a motor: a cordless drill, headphones, a loudspeaker, a light bulb."""

from __future__ import annotations

from typing import Final

import numpy as np
from manifold3d import Manifold

from xden_builder.phantoms import fittings, shapes, skins
from xden_builder.phantoms.pieces import Archetype, Piece

__all__ = ["ARCHETYPES"]


def cordless_drill(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Pistol-shaped drill: motor, gearbox, chuck with a bit, trigger, pack of lithium cells."""
    scale = size_cm / 20.0
    body = [_shell_outside(scale, wall) for wall in (0.0, 0.28)]
    long, axis = 0.62 * size_cm, 16.0 * scale
    motor = shapes.cylinder(2.0 * scale, 0.6 * scale, 5.6 * scale)
    magnets = shapes.tube(2.0 * scale, 1.55 * scale, 1.2 * scale, 5.0 * scale)
    shaft = shapes.cylinder(0.3 * scale, 0.6 * scale, 6.4 * scale)
    gears = shapes.cylinder(2.1 * scale, 6.0 * scale, 9.4 * scale)
    spindle = shapes.cylinder(0.6 * scale, 9.4 * scale, long + 0.8)
    chuck = [(0, 0), (1.5, 0), (1.9, 0.6), (1.9, 2.8), (1.1, 4.4), (0, 4.4)]
    jaw = shapes.lathe(shapes.outline([(r * scale, long + z * scale) for r, z in chuck], 0.1))
    bit = shapes.thread(0.42, 0.28, 1.2, long + 2.0 * scale, size_cm)
    parts = [
        ("bit", "bit", bit),
        ("spindle", "shaft", spindle),
        ("shaft", "shaft", shaft),
        ("magnets", "magnet", magnets),
        ("armature", "coil", motor - magnets),
        ("gearbox", "gear", gears),
        ("chuck", "chuck", jaw),
    ]
    turned = [
        Piece(name, role, shapes.along_x(solid).translate((-4.0 * scale, 0, axis)))
        for name, role, solid in parts
    ]
    trigger = shapes.rounded_box((1.8, 1.3, 2.6), 0.35, (2.1 * scale, 0, axis - 4.4 * scale))
    switch = shapes.box((1.6, 1.5, 3.4), (0.7 * scale, 0, axis - 4.6 * scale))
    ribs = shapes.box((0.4, 9.0, 9.0), (-2.0 * scale, 0, axis))
    ribs += shapes.box((0.4, 9.0, 9.0), (3.6 * scale, 0, axis))
    ribs += shapes.box((3.0 * scale, 9.0, 0.4), (0.4 * scale, 0, axis - 5.8 * scale))
    return [
        *turned,
        Piece("trigger", "button", trigger),
        Piece("switch", "switch", switch),
        *_pack(scale),
        Piece("shell", "shell", body[0] - (body[1] - ribs)),
    ]


def _shell_outside(scale: float, wall: float) -> Manifold:
    """Barrel along x, handle down from it, shrunk by a wall."""
    ends = (-4.0 * scale + wall, 0.62 * 20.0 * scale - 4.0 * scale - wall)
    barrel = shapes.along_x(shapes.slab(shapes.disc(2.7 * scale - wall), *ends, 0.6)).translate(
        (0, 0, 16.0 * scale)
    )
    stations = [(4.4, 2.3, 1.5), (9.0, 1.8, 1.4), (13.5, 2.0, 1.5), (16.0, 2.4, 1.6)]
    ovals = [(z * scale, x * scale - wall, y * scale - wall) for z, x, y in stations]
    ovals[0] = (ovals[0][0] + wall, ovals[0][1], ovals[0][2])
    return barrel + skins.loft(ovals, 2.5)


def _pack(scale: float) -> list[Piece]:
    """Battery under the handle: two rows of round cells in a box."""
    outline = shapes.rounded_rectangle(11.0 * scale, 7.0 * scale, 0.8 * scale)
    shell, room = fittings.case(outline, 0.0, 4.5 * scale, 0.25, 0.4 * scale)
    radius = 0.9
    cell = shapes.along_y(fittings.cell(radius, -3.2 * scale, 3.2 * scale))
    count = int((11.0 * scale - 0.8) // 1.85)
    row = [(1.81 * (i - (count - 1) / 2), 0.0, 0.25 + radius) for i in range(count)]
    cells = [Piece(f"cell_{i + 1}", "cell", cell.translate(at) ^ room) for i, at in enumerate(row)]
    board = shapes.box((7.0 * scale, 4.0 * scale, 0.16), (0, 0, 0.25 + 2 * radius + 0.08))
    return [*cells, Piece("board", "board", board), Piece("pack", "shell", shell)]


def headphones(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Two cups with drivers and cushions on a sprung band."""
    span, radius = 0.8 * size_cm, size_cm * rng.uniform(0.19, 0.22)
    centre = radius + 0.2
    cup = shapes.slab(shapes.disc(radius), 0.0, 2.2, 0.5)
    room = shapes.cylinder(radius - 0.3, 0.3, 9.0)
    cushion = fittings.ring(radius - 0.9, 0.88, 2.6)
    plate = shapes.cylinder(radius - 0.3, 1.6, 1.8)
    magnet = shapes.cylinder(1.3, 0.6, 1.6)
    coil = shapes.tube(1.7, 1.4, 1.0, 1.6)
    half = [(0.5 * span - 0.3, centre), (0.53 * span, 0.55 * size_cm), (0.4 * span, 0.88 * size_cm)]
    line = [*half, (0.0, size_cm - 0.3), *((-x, z) for x, z in half[::-1])]
    band = fittings.bar([(x, 0.0, z) for x, z in line], 0.3, 1.3, 60)
    core = fittings.bar([(x, 0.0, z) for x, z in line], 0.08, 0.7, 60)
    solids = {
        "magnet": ("magnet", magnet),
        "coil": ("coil", coil),
        "plate": ("plate", plate),
        "cushion": ("cushion", cushion),
        "cup": ("shell", cup - room),
    }
    pieces = [Piece("spring", "spring", core)]
    for side, turn in (("left", 90.0), ("right", -90.0)):
        for name, (role, solid) in solids.items():
            put = solid.rotate((0, turn, 0)).translate((-turn / 90 * (0.5 * span + 0.6), 0, centre))
            pieces.append(Piece(f"{side}_{name}", role, put))
    return [*pieces, Piece("band", "band", band)]


def loudspeaker(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Box with a woofer and a tweeter: cone, coil, magnet, basket; damping wool inside."""
    wide, deep = size_cm * rng.uniform(0.55, 0.68), size_cm * rng.uniform(0.5, 0.6)
    wall = rng.uniform(0.7, 1.2)
    outside = shapes.rounded_box((wide, deep, size_cm), 0.3, (0, 0, size_cm / 2))
    inner = (wide - 2 * wall, deep - 2 * wall, size_cm - 2 * wall)
    room = shapes.box(inner, (0, 0, size_cm / 2))
    pieces, holes = [], Manifold()
    for name, share, z in (("woofer", 0.4, 0.34), ("tweeter", 0.18, 0.77)):
        radius = share * wide
        place = (0.0, -deep / 2, z * size_cm)
        pieces += [
            Piece(f"{name}_{part}", part, shapes.along_y(solid).translate(place))
            for part, solid in _driver(radius).items()
        ]
        holes += shapes.along_y(shapes.cylinder(radius, -9.0, 2 * wall)).translate(place)
    wool = shapes.box((inner[0], 0.2 * deep, inner[2]), (0, 0.4 * deep - wall, size_cm / 2))
    return [
        *pieces,
        Piece("wool", "wool", wool),
        Piece("cabinet", "shell", outside - room - holes),
    ]


def _driver(radius: float) -> dict[str, Manifold]:
    """Loudspeaker that looks towards -z, its rim at z = 0."""
    deep = 0.8 * radius
    neck = 0.28 * radius
    cone = [(radius - 0.1, 0.1), (radius - 0.1, 0.2), (neck, deep), (neck, deep - 0.12)]
    back = [(radius, 0.0), (radius + 0.4, 0.0), (radius + 0.4, -0.2), (radius - 0.1, -0.2)]
    frame = [(radius - 0.1, 0.3), (0.5 * radius, deep + 0.1), (0.5 * radius, deep + 0.3)]
    cap = shapes.cylinder(0.3 * radius, deep - 0.24, deep - 0.12)
    return {
        "magnet": shapes.tube(0.55 * radius, 0.3 * radius, deep + 0.3, deep + 0.3 + 0.3 * radius),
        "coil": shapes.tube(0.3 * radius, 0.24 * radius, deep - 0.12, deep + 0.3 + 0.2 * radius),
        "cone": shapes.lathe(shapes.polygon(cone)) + cap,
        "basket": shapes.lathe(shapes.polygon([*back, *frame, (radius, 0.45)])),
    }


def light_bulb(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Screw cap with a driver board, heat sink, board with diodes, and a globe."""
    radius, cap = size_cm * rng.uniform(0.26, 0.3), 1.3
    thread_top, sink_top = 0.26 * size_cm, size_cm * rng.uniform(0.46, 0.54)
    screw = shapes.thread(cap, cap - 0.12, 0.36, 0.5, thread_top)
    screw += shapes.cylinder(0.5, 0.1, 0.6, cap - 0.12)
    inside = shapes.cylinder(cap - 0.25, 0.7, thread_top)
    sink = [(0, thread_top), (cap, thread_top), (0.8 * radius, sink_top), (0, sink_top)]
    hollow = shapes.cylinder(cap - 0.25, thread_top, sink_top - 0.5)
    half = [(0.8, 0.0), (0.95, 0.2), (1.0, 0.42), (0.9, 0.7), (0.66, 0.88), (0.35, 0.97)]
    line = fittings.curve([*half, (0.0, 1.0)], 20)
    span = size_cm - sink_top
    globe = [(0.0, sink_top), *((max(r, 0) * radius, sink_top + z * span) for r, z in line)]
    section = shapes.outline([*globe[:-1], (0.0, size_cm)])
    bulb = shapes.lathe(section) - shapes.lathe(shapes.inset(section, 0.12))
    board = shapes.box((1.6, 0.16, sink_top - 1.2), (0.0, 0.0, 0.7 + (sink_top - 1.2) / 2))
    chip = shapes.box((0.8, 0.5, 1.0), (0.0, 0.33, 0.5 * sink_top))
    led = shapes.box((0.3, 0.3, 0.1), (0.45 * radius, 0.0, sink_top + 0.21))
    plate = shapes.cylinder(0.7 * radius, sink_top, sink_top + 0.16)
    return [
        Piece("pin", "contact", shapes.slab(shapes.disc(0.45), 0.0, 0.25, 0.1)),
        Piece("cap", "cap", screw - inside),
        Piece("driver", "board", board),
        Piece("chip", "chip", chip),
        Piece("plate", "plate", plate),
        Piece("leds", "chip", shapes.around(led, 6)),
        Piece("sink", "sink", shapes.lathe(shapes.outline(sink)) - hollow),
        Piece("globe", "globe", bulb - plate),
    ]


ARCHETYPES: Final = {
    "cordless_drill": Archetype(
        cordless_drill, "bit shaft magnet coil gear chuck button switch cell board shell"
    ),
    "headphones": Archetype(headphones, "spring magnet coil plate cushion shell band"),
    "light_bulb": Archetype(light_bulb, "contact cap board chip plate sink globe"),
    "loudspeaker": Archetype(loudspeaker, "magnet coil cone basket wool shell"),
}
