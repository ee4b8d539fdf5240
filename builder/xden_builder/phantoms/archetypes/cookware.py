"""Pots and pans: pot, wok, baking tin, moka pot, pressure cooker, colander, thermos."""

from __future__ import annotations

from typing import Final

import numpy as np
from manifold3d import Manifold

from xden_builder.phantoms import fittings, shapes
from xden_builder.phantoms.pieces import Archetype, Piece

__all__ = ["ARCHETYPES"]


def pot(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Stock pot: shell with a thick sandwich floor, two loops, a lid with a knob, food."""
    radius, wall = size_cm * rng.uniform(0.37, 0.4), rng.uniform(0.12, 0.2)
    high = radius * rng.uniform(0.9, 1.4)
    shell, room = fittings.vessel([(0, 0.5), (radius, 0.5), (radius, high)], wall, 0.3)
    ears = fittings.bar(_ear(radius, wall, 0.8 * high, size_cm), 0.35, 0.5)
    ears = shapes.around(ears, 2) - room
    food = shapes.cut_above(room, high * rng.uniform(0.3, 0.8))
    return [
        Piece("food", "liquid", food),
        Piece("floor", "floor", shapes.cylinder(0.85 * radius, 0.0, 0.5)),
        Piece("shell", "shell", shell + ears),
        *_lid(radius, high, wall, rng.uniform(0.05, 0.16) * radius),
    ]


def _ear(radius: float, wall: float, z: float, size_cm: float) -> list[fittings.Point]:
    """Loop at the side, its ends in the wall."""
    out, half = size_cm / 2, 0.28 * radius
    near = 0.94 * radius - wall / 2
    ends = [(near, -half, z), (0.85 * out + 0.15 * near, -0.9 * half, z)]
    return [*ends, (out - 0.35, 0.0, z), *((x, -y, h) for x, y, h in ends[::-1])]


def _lid(radius: float, rim: float, wall: float, rise: float) -> list[Piece]:
    """Domed sheet with a flange on the rim and a lip inside it, and a knob screwed on."""
    shares = np.linspace(0.0, 1.0, 13)
    upper = [(r * radius, rim + 0.2 + rise * (1 - r**2)) for r in shares.tolist()]
    lower = [(r, z - 0.1) for r, z in upper]
    sheet = shapes.lathe(shapes.outline([*lower, *upper[::-1]]))
    lip = shapes.tube(radius - wall - 0.05, radius - wall - 0.17, rim - 0.7, rim + 0.1)
    seat = shapes.tube(radius + 0.05, radius - wall - 0.17, rim, rim + 0.2)
    top = rim + rise + 0.2
    knob = [(0, 0), (0.6, 0), (0.6, 0.5), (1.6, 1.1), (1.6, 1.6), (1.0, 1.9), (0, 1.9)]
    handle = shapes.lathe(shapes.outline([(r, top + z) for r, z in knob], 0.15))
    screw = shapes.cylinder(0.2, top - 0.2, top + 1.2)
    screw += shapes.cylinder(0.45, top - 0.25, top - 0.05)
    return [
        Piece("screw", "rivet", screw),
        Piece("lid", "lid", sheet + lip + seat),
        Piece("knob", "handle", handle),
    ]


def wok(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Thin round-bottomed pan with a wooden handle in a steel socket and a loop opposite."""
    radius, wall = 0.3 * size_cm, rng.uniform(0.15, 0.22)
    high = radius * rng.uniform(0.42, 0.55)
    line = fittings.curve([(0.35, 0.0), (0.7, 0.28), (1.0, 1.0)], 16)
    shell, room = fittings.vessel([(0, 0), *((r * radius, z * high) for r, z in line)], wall)
    z, end = 0.9 * high, size_cm - radius
    loop = [(-0.88 * radius, -0.3 * radius, z), (-1.12 * radius, -0.15 * radius, z)]
    loop += [(-1.17 * radius, 0, z), *((x, -y, h) for x, y, h in loop[::-1])]
    socket = fittings.strut((0.96 * radius, 0, z), (1.4 * radius, 0, z + 0.16 * radius), 0.55)
    handle = fittings.grip(0.0, end - 1.15 * radius, 0.95, 1.1).rotate((0, -20, 0))
    return [
        Piece("pan", "pan", shell + (socket + fittings.bar(loop, 0.35) - room)),
        Piece("handle", "handle", handle.translate((1.2 * radius, 0, z + 0.1 * radius))),
    ]


def baking_tin(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Loaf tin with a rolled rim; most have a loaf in them."""
    wide, high = size_cm * rng.uniform(0.4, 0.6), size_cm * rng.uniform(0.22, 0.28)
    wall, flare = 0.09, 0.94
    outline = shapes.rounded_rectangle(size_cm - 0.6, wide - 0.6, 1.2)
    block = Manifold.extrude(outline.scale((flare, flare)), high, 0, 0.0, (1 / flare, 1 / flare))
    inner = shapes.inset(outline, wall)
    room = Manifold.extrude(inner.scale((flare, flare)), high, 0, 0.0, (1 / flare, 1 / flare))
    room = room.translate((0, 0, wall)) ^ shapes.box((99, 99, 2 * high))
    rim = shapes.slab(shapes.rounded_rectangle(size_cm, wide, 1.5), high - 0.25, high)
    pieces = [Piece("tin", "pan", (block + rim) - room)]
    if rng.random() < 0.7:
        dome = fittings.ellipsoid((0.6 * size_cm, 0.6 * wide, 0.5 * high))
        loaf = room ^ dome.translate((0, 0, high * rng.uniform(0.3, 0.5)))
        base = shapes.cut_above(room, 0.4 * high)
        pieces.insert(0, Piece("loaf", "food", loaf + base))
    return pieces


def moka_pot(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Boiler with water, funnel with coffee, gasket, upper pot with a pillar, lid, handle."""
    radius, wall = size_cm * rng.uniform(0.22, 0.25), 0.3
    waist, joint, rim = 0.78 * radius, 0.45 * size_cm, 0.88 * size_cm
    boiler = _faceted([(radius, 0.0), (waist, joint)])
    water_room = _faceted([(radius - wall, wall), (waist - wall, joint)])
    upper = _faceted([(waist, joint), (1.02 * radius, rim)])
    room = _faceted([(waist - wall, joint + wall), (1.02 * radius - wall, rim)])
    spout = shapes.cylinder(0.25 * radius, rim - 0.16 * size_cm, rim, 0.4 * radius)
    upper = (upper + (spout.translate((0.8 * radius, 0, 0)))) - room
    basket = shapes.cylinder(waist - 0.75, 0.31 * size_cm, joint)
    stem = shapes.cylinder(0.35, 0.06 * size_cm, 0.33 * size_cm)
    pillar = shapes.cylinder(0.55, joint + 0.15, 0.78 * size_cm, 0.35)
    level = size_cm * rng.uniform(0.14, 0.28)
    coffee = shapes.cylinder(waist - 0.9, 0.31 * size_cm + 0.15, joint)
    lid = _faceted([(1.04 * radius, rim), (0.3 * radius, 0.95 * size_cm)])
    knob = shapes.slab(shapes.disc(0.24 * radius), 0.95 * size_cm - 0.1, size_cm, 0.1)
    grip = [(-0.85, 0.83), (-1.7, 0.86), (-1.95, 0.76), (-1.8, 0.48)]
    handle = fittings.bar([(x * radius, 0, z * size_cm) for x, z in grip], 0.05 * size_cm, 0.7)
    flange = shapes.tube(0.9 * waist, waist - 0.9, joint - 0.12, joint)
    return [
        Piece("coffee", "coffee", coffee),
        Piece("funnel", "shell", basket + stem - shapes.cylinder(0.25, 0.0, joint) + flange),
        Piece("gasket", "gasket", shapes.tube(0.9 * waist, waist - 0.9, joint, joint + wall)),
        Piece("water", "liquid", shapes.cut_above(water_room, level)),
        Piece("boiler", "shell", boiler - water_room),
        Piece("pot", "shell", upper + pillar),
        Piece("lid", "lid", lid),
        Piece("knob", "handle", knob),
        Piece("handle", "handle", handle - _faceted([(waist, joint), (1.02 * radius, rim)])),
    ]


def _faceted(rings: list[tuple[float, float]]) -> Manifold:
    """Eight-sided frustum between two (radius, z)."""
    (low, z0), (top, z1) = rings
    return Manifold.cylinder(z1 - z0, low, top, 8).translate((0.0, 0.0, z0))


def pressure_cooker(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Heavy pot whose lid is locked on over a gasket, with a valve and two long handles."""
    radius, wall = size_cm * rng.uniform(0.26, 0.29), rng.uniform(0.25, 0.35)
    high = 1.5 * radius
    shell, room = fittings.vessel([(0, 0.5), (radius, 0.5), (radius, high)], wall, 0.4)
    dome = [(0, 0.35 * radius), (0.4 * radius, 0.3 * radius), (1.02 * radius, 0.1 * radius)]
    dome += [(1.08 * radius, 0.0), (1.08 * radius, -0.9), (0, -0.9)]
    line = shapes.outline([(r, high + z) for r, z in dome], 0.2)
    lid = shapes.lathe(line) - shapes.lathe(shapes.inset(line, wall)) - shell - room
    gasket = shapes.tube(radius - wall, radius - wall - 0.5, high - 0.45, high)
    lid -= shapes.cylinder(radius - wall - 0.5, 0.0, high)
    z = high + 0.34 * radius
    valve = shapes.slab(shapes.disc(0.14 * radius), z + 0.1, z + 2.2, 0.15)
    valve += shapes.cylinder(0.3, z - 0.3, z + 0.3)
    end = size_cm - radius
    arms = [
        shapes.rounded_box((end - radius + 1.0, 2.6, 1.9), 0.5, ((end + radius) / 2, 0, h))
        for h in (high - 2.1, high + 0.1)
    ]
    return [
        Piece("gasket", "gasket", gasket),
        Piece("stew", "liquid", shapes.cut_above(room, high * rng.uniform(0.3, 0.6))),
        Piece("floor", "floor", shapes.cylinder(0.85 * radius, 0.0, 0.5)),
        Piece("pot", "shell", shell),
        Piece("valve", "valve", valve),
        Piece("lid", "lid", lid),
        Piece("lower_handle", "handle", arms[0] - shell - room),
        Piece("upper_handle", "handle", arms[1] - shapes.cylinder(radius - wall, 0, 2 * high)),
    ]


def colander(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Bowl with rings of holes, a foot and two loops."""
    radius, wall = 0.41 * size_cm, rng.uniform(0.1, 0.2)
    high = radius * rng.uniform(0.75, 0.95)
    line = fittings.curve([(0.5, 0.0), (0.85, 0.4), (1.0, 1.0)], 14)
    profile = [(0.0, 0.8), *((r * radius, 0.8 + z * high) for r, z in line)]
    shell, room = fittings.vessel(profile, wall)
    holes = []
    for z, count in ((0.3, 18), (0.48, 22), (0.66, 22)):
        hole = shapes.along_x(shapes.cylinder(0.035 * radius, 0.3 * radius, 1.4 * radius))
        hole = hole.rotate((0, 18 * z, 5 * z)).translate((0, 0, 0.8 + z * high))
        holes.append(shapes.around(hole, count))
    holes += [
        shapes.around(shapes.cylinder(0.035 * radius, 0, 3).translate((r * radius, 0, 0)), count)
        for r, count in ((0.12, 5), (0.3, 12))
    ]
    foot = shapes.tube(0.5 * radius, 0.42 * radius, 0.0, 1.1) - room
    ears = (
        shapes.around(fittings.bar(_ear(radius, wall, 0.75 + 0.9 * high, size_cm), 0.3), 2) - room
    )
    return [Piece("body", "shell", (shell - shapes.union(holes)) + foot + ears)]


def thermos(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Double-walled flask: inner bottle, vacuum, outer shell, stopper, cup, tea."""
    radius, wall = size_cm * rng.uniform(0.14, 0.17), 0.08 * rng.uniform(1.0, 1.5)
    neck, rim = 0.55 * radius, 0.84 * size_cm
    shoulder = 0.72 * size_cm
    outer = [(0, 0), (radius, 0), (radius, shoulder), (neck, 0.8 * size_cm), (neck, rim)]
    gap = 0.16 * radius + wall
    inside = [(0, gap), (radius - gap, gap), (radius - gap, shoulder - gap)]
    inside += [(neck - 2 * wall, 0.79 * size_cm), (neck - 2 * wall, rim)]
    flask = shapes.lathe(shapes.outline([*inside, (0, rim)], 0.2))
    room = shapes.lathe(shapes.inset(shapes.outline([*inside, (0, rim + 2)], 0.2), wall))
    block = shapes.lathe(shapes.outline([*outer, (0, rim)], 0.3))
    vacuum = shapes.lathe(shapes.inset(shapes.outline([*outer, (0, rim)], 0.3), wall))
    vacuum = shapes.cut_above(vacuum, rim - wall)
    shell = (block - vacuum) + (flask - room) - room
    plug = shapes.slab(shapes.disc(neck - 3 * wall), 0.74 * size_cm, rim + 0.4, 0.1) ^ (
        room + shapes.cylinder(neck, rim, rim + 9)
    )
    line = shapes.outline(
        [(0, shoulder), (radius, shoulder), (0.95 * radius, size_cm), (0, size_cm)], 0.3
    )
    cup = shapes.lathe(line) - shapes.lathe(shapes.inset(line, 0.22)) - block
    cup -= shapes.cylinder(radius - 0.3, 0.0, shoulder + 0.5)
    return [
        Piece("tea", "liquid", shapes.cut_above(room, rng.uniform(0.3, 0.7) * size_cm)),
        Piece("stopper", "stopper", plug),
        Piece("flask", "shell", shell),
        Piece("cup", "cup", cup),
    ]


ARCHETYPES: Final = {
    "baking_tin": Archetype(baking_tin, "food pan"),
    "colander": Archetype(colander, "shell"),
    "moka_pot": Archetype(moka_pot, "coffee shell gasket liquid lid handle"),
    "pot": Archetype(pot, "liquid floor shell rivet lid handle"),
    "pressure_cooker": Archetype(pressure_cooker, "gasket liquid floor shell valve lid handle"),
    "thermos": Archetype(thermos, "liquid stopper shell cup"),
    "wok": Archetype(wok, "pan handle"),
}
