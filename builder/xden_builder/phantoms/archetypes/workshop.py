"""Workshop tools with works inside: saw, knife, level, tape measure, brush, roller."""

from __future__ import annotations

from typing import Final

import numpy as np
from manifold3d import Manifold

from xden_builder.phantoms import shapes, skins
from xden_builder.phantoms.pieces import Archetype, Piece, moved

__all__ = ["ARCHETYPES"]


def saw(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Toothed blade let into a handle with a hole for the hand, held by screws."""
    grip, pitch = size_cm * rng.uniform(0.27, 0.31), rng.uniform(0.35, 0.55)
    wide = size_cm * rng.uniform(0.2, 0.25)
    teeth = np.arange(grip, size_cm - pitch, pitch)
    edge = [(x + dx, dy) for x in teeth for dx, dy in ((0.0, 0.0), (0.8 * pitch, -0.6 * pitch))]
    back = [(size_cm, 0.0), (size_cm, 0.45 * wide), (0.55 * grip, wide), (0.55 * grip, 0.0)]
    blade = shapes.slab(shapes.polygon([*edge, *back]), -0.06, 0.06)
    hand = [(0.0, -0.1), (0.1, 1.05), (0.35, 1.2), (1.0, 1.0), (1.0, 0.15), (0.6, -0.15)]
    outline = shapes.polygon([(x * grip, y * wide) for x, y in hand], 0.12 * grip)
    hole = [(0.25, 0.15), (0.28, 0.85), (0.55, 0.85), (0.62, 0.2)]
    outline -= shapes.polygon([(x * grip, y * wide) for x, y in hole], 0.09 * grip)
    screw = shapes.cylinder(0.32, -1.15, 1.15)
    screws = shapes.union(screw.translate((0.8 * grip, y * wide, 0)) for y in (0.32, 0.75))
    return [
        Piece("screws", "screw", screws),
        Piece("blade", "blade", blade),
        Piece("handle", "handle", shapes.slab(outline, -1.1, 1.1)),
    ]


def utility_knife(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Two half shells with a blade that a slider pushes out, held by one screw."""
    wide, thick, wall = 0.2 * size_cm, rng.uniform(1.5, 2.0), 0.22
    high = wide * rng.uniform(0.8, 0.95)
    side = [(0.0, 0.1), (0.05, 0.9), (0.3, 1.0), (0.85, 0.85), (0.9, 0.25), (0.4, 0.1)]
    outline = shapes.polygon([(x * size_cm, y * high) for x, y in side], 0.2 * high)
    hollow = shapes.inset(outline, wall)
    shell = shapes.slab(outline, -thick / 2, thick / 2) - shapes.slab(
        hollow, wall - thick / 2, thick / 2 - wall
    )
    slot = shapes.box((0.3 * size_cm, 2.0, 0.24), (0.6 * size_cm, high, 0.0))
    mouth = shapes.box((0.3 * size_cm, 0.34 * high, 0.08), (0.9 * size_cm, 0.52 * high, 0.0))
    low, top = 0.36 * high, 0.68 * high
    blade = shapes.polygon(
        [
            (0.66 * size_cm, low),
            (0.9 * size_cm, low),
            (size_cm, low),
            (0.93 * size_cm, top),
            (0.66 * size_cm, top),
        ]
    )
    slider = shapes.box((0.3 * size_cm, 0.3 * high, 0.5), (0.55 * size_cm, 0.5 * high, 0.0))
    slider += shapes.box((1.2, 0.55 * high, 0.24), (0.6 * size_cm, 0.75 * high, 0.0))
    slider += shapes.rounded_box((1.6, 0.3, 0.7), 0.1, (0.6 * size_cm, 1.02 * high, 0.0))
    spot = (0.3 * size_cm, 0.5 * high, 0.0)
    screw = shapes.cylinder(0.18, -thick / 2, 0.45 * thick)
    screw += shapes.cylinder(0.36, 0.3 * thick, 0.48 * thick)
    post = shapes.cylinder(0.42, 0.1 - thick / 2, thick / 2 - 0.1)
    half = shapes.box((3 * size_cm, 3 * size_cm, thick), (0, 0, thick / 2))
    shell = (shell - slot - mouth) + post.translate(spot)
    return [
        Piece("blade", "blade", shapes.slab(blade, -0.04, 0.04)),
        Piece("slider", "slider", slider),
        Piece("screw", "screw", screw.translate(spot)),
        Piece("front", "shell", shell ^ half),
        Piece("back", "shell", shell - half),
    ]


def spirit_level(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """I-beam or box of metal with two vials of spirit, an air bubble in each, and end caps."""
    high, deep, wall = size_cm * rng.uniform(0.15, 0.2), 2.2, 0.25
    radius, vial = 0.2 * high, 0.75 * high
    section = shapes.rounded_rectangle(high, deep, 0.1)
    web = shapes.box((high - 2 * wall, deep, 3 * size_cm), (0, deep / 2 + 0.14, 0))
    web += web.mirror((0, 1, 0))
    pieces: list[Piece] = []
    windows = Manifold()
    for name, at, turn in (("middle", 0.5, 0.0), ("end", 0.82, 90.0)):
        glass = shapes.cylinder(radius, -vial / 2, vial / 2)
        room = shapes.capsule(0.7 * radius, 0.16 - vial / 2, vial / 2 - 0.16)
        bubble = skins.loft(
            [
                (-0.16 * vial, 0.05, 0.05),
                (0.0, 0.42 * radius, 0.42 * radius),
                (0.16 * vial, 0.05, 0.05),
            ]
        )
        spirit = room - bubble.translate((0.25 * radius, 0, 0))
        for role, solid in (("vial", glass - room), ("liquid", spirit)):
            placed = solid.rotate((0, 90 * (turn > 0), 0)).translate((0, 0, at * size_cm))
            pieces.append(Piece(f"{name}_{role}", role, placed))
        windows += shapes.box((high - 2 * wall, 4.0, 0.8 * high), (0, 0, at * size_cm))
    mount = shapes.union(
        shapes.box((high - 2 * wall, 0.9 * deep, 0.84 * high), (0, 0, at * size_cm))
        for at in (0.5, 0.82)
    )
    sight = shapes.union(
        shapes.box((1.2 * radius, 4.0, 0.5 * high), (0, 0, 0))
        .rotate((0, turn, 0))
        .translate((0, 0, at * size_cm))
        for at, turn in ((0.5, 0.0), (0.82, 90.0))
    )
    beam = shapes.slab(section, 0.4, size_cm - 0.4) - web
    cap = shapes.slab(section, 0.0, 0.4)
    pieces += [
        Piece("left_cap", "cap", cap),
        Piece("right_cap", "cap", cap.translate((0, 0, size_cm - 0.4))),
        Piece("mounts", "mount", mount - sight),
        Piece("beam", "beam", beam),
    ]
    return moved(pieces, lambda solid: shapes.along_x(solid))


def tape_measure(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Case with a wound steel tape on a drum, its spring inside, and the hook at the mouth."""
    thick, wall = size_cm * rng.uniform(0.42, 0.52), rng.uniform(0.2, 0.28)
    half = size_cm / 2
    side = [(-1.0, -0.9), (-1.0, 0.3), (-0.5, 0.86), (0.3, 0.86), (0.96, 0.1), (0.96, -0.9)]
    outline = shapes.polygon([(x * half, y * half) for x, y in side], 0.25 * half)
    room = shapes.slab(shapes.inset(outline, wall), wall - thick / 2, thick / 2 - wall, 0.1)
    case = shapes.slab(outline, -thick / 2, thick / 2, 0.2) - room
    wide = thick - 2 * wall - 0.1
    roll = half * rng.uniform(0.5, 0.66)
    drum, at = 0.45 * roll, (-0.08 * half, -0.06 * half, 0.0)
    floor = -0.9 * half
    mouth = shapes.box((half, 0.5, wide), (half, floor + wall + 0.25, 0.0))
    strip = [(at[0], at[1] - roll), (0.5 * half, floor + wall + 0.12)]
    strip += [(1.0 * half, floor + wall + 0.12)]
    ends = [*strip, *((x, y + 0.06) for x, y in reversed(strip))]
    coil = shapes.tube(roll, drum + 0.12, -wide / 2, wide / 2).translate(at)
    tape = coil + shapes.slab(shapes.polygon(ends), -0.45 * wide, 0.45 * wide)
    spool = shapes.tube(drum + 0.12, drum, -wide / 2, wide / 2).translate(at)
    spring = shapes.tube(drum, 0.5 * drum, -0.4 * wide, 0.4 * wide).translate(at)
    post = shapes.cylinder(0.5 * drum, -thick / 2 + 0.1, thick / 2 - 0.1).translate(at)
    hook = shapes.box((0.1, 0.9, 0.8 * wide), (half + 0.05, floor + wall - 0.1, 0.0))
    knob = shapes.rounded_box((0.8, 0.5, 0.9), 0.15, (0.62 * half, 0.52 * half, 0.0))
    pieces = [
        Piece("hook", "hook", hook),
        Piece("tape", "tape", tape),
        Piece("spring", "spring", spring),
        Piece("drum", "drum", spool),
        Piece("lock", "button", knob),
        Piece("case", "shell", (case - mouth) + post),
    ]
    return moved(pieces, lambda solid: solid.rotate((90, 0, 0)))


def paint_brush(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Flat handle with a hole, bristles around a spacer in a tin ferrule."""
    wide, thick = size_cm * rng.uniform(0.09, 0.16), size_cm * rng.uniform(0.03, 0.04)
    grip = 0.58 * size_cm
    stations = [(0.0, 0.45), (0.03, 0.6), (0.2, 0.62), (0.5, 0.38), (0.75, 0.55), (1.0, 0.98)]
    ovals = [(z * grip, thick * min(1.0, 0.6 + s), wide * s) for z, s in stations]
    handle = skins.loft(ovals, 2.4) - shapes.along_x(shapes.cylinder(0.3, -2, 2)).translate(
        (0, 0, 0.08 * grip)
    )
    low, high = 0.94 * grip, 0.94 * grip + 0.16 * size_cm
    tin = skins.loft([(low, thick + 0.06, wide + 0.06), (high, thick + 0.06, wide + 0.06)], 4.0)
    inner = skins.loft([(low - 1, thick, wide), (high + 1, thick, wide)], 4.0)
    spacer = shapes.box((0.7 * thick, 1.6 * wide, 0.1 * size_cm), (0, 0, grip + 0.05 * size_cm))
    hair = skins.loft(
        [
            (grip, 0.99 * thick, 0.99 * wide),
            (high, 0.99 * thick, 0.99 * wide),
            (0.92 * size_cm, 0.9 * thick, 1.05 * wide),
            (size_cm, 0.25 * thick, 1.02 * wide),
        ],
        4.0,
    )
    pieces = [
        Piece("spacer", "spacer", spacer),
        Piece("ferrule", "ferrule", tin - inner),
        Piece("handle", "handle", handle),
        Piece("bristles", "bristles", hair),
    ]
    return moved(pieces, shapes.along_x)


def paint_roller(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Cranked wire frame in a handle, a sleeve with pile turning on its end."""
    wide, wire = size_cm * rng.uniform(0.5, 0.7), rng.uniform(0.3, 0.36)
    core = size_cm * rng.uniform(0.06, 0.075)
    pile, top = core + rng.uniform(0.5, 0.9), size_cm - core - 0.7
    side = 0.5 * wide + 1.0
    points = [(0, 0, 0.25 * size_cm), (0, 0, 0.56 * size_cm), (side, 0, 0.68 * size_cm)]
    points += [(side, 0, top), (-0.45 * wide, 0, top)]
    frame = skins.pipe(skins.bent_path(points, 1.2), wire)
    profile = [(0.0, 0.0), (1.1, 0.0), (1.35, 0.2), (1.15, 0.5), (1.35, 0.8), (0.7, 1.0), (0, 1.0)]
    handle = shapes.lathe(shapes.outline([(r, z * 0.42 * size_cm) for r, z in profile], 0.2))
    spool = shapes.tube(core, core - 0.18, -wide / 2, wide / 2)
    cap = shapes.tube(core - 0.1, 0.9 * wire, 0.47 * wide, 0.5 * wide)
    ends = cap + cap.mirror((0, 0, 1))
    sleeve = shapes.tube(pile, core, -wide / 2, wide / 2)
    across = [shapes.along_x(s).translate((0, 0, top)) for s in (ends, spool, sleeve)]
    pieces = [
        Piece("frame", "frame", frame),
        Piece("caps", "cap", across[0]),
        Piece("core", "core", across[1]),
        Piece("pile", "pile", across[2]),
        Piece("handle", "handle", handle),
    ]
    return moved(pieces, lambda solid: shapes.along_x(solid.rotate((0, 0, 90))))


ARCHETYPES: Final = {
    "paint_brush": Archetype(paint_brush, "spacer ferrule handle bristles"),
    "paint_roller": Archetype(paint_roller, "frame cap core pile handle"),
    "saw": Archetype(saw, "screw blade handle"),
    "spirit_level": Archetype(spirit_level, "liquid vial cap mount beam"),
    "tape_measure": Archetype(tape_measure, "hook tape spring drum button shell"),
    "utility_knife": Archetype(utility_knife, "blade slider screw shell"),
}
