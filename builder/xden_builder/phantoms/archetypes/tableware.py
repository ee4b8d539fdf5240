"""What is lathed for the table: bowl, plate, cup, glasses, teapot, salt shaker, egg cup, jug."""

from __future__ import annotations

from typing import Final

import numpy as np

from xden_builder.phantoms import fittings, shapes, skins
from xden_builder.phantoms.pieces import Archetype, Piece

__all__ = ["ARCHETYPES"]


def bowl(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Round bowl on a foot ring; every other one holds soup."""
    radius, wall = size_cm / 2, rng.uniform(0.3, 0.45)
    high = radius * rng.uniform(0.7, 0.9)
    line = fittings.curve([(0.42, 0.05), (0.75, 0.28), (0.92, 0.62), (1.0, 1.0)], 14)
    profile = [(0.0, 0.05 * high), *((r * radius, z * high) for r, z in line)]
    shell, room = fittings.vessel(profile, wall, 0.1)
    foot = shapes.tube(0.42 * radius, 0.34 * radius, 0.0, 0.16 * high) - room
    pieces = [Piece("shell", "shell", shell + foot)]
    if rng.random() < 0.5:
        soup = shapes.cut_above(room, high * rng.uniform(0.35, 0.7))
        pieces.insert(0, Piece("soup", "liquid", soup))
    return pieces


def plate(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Flat plate with a raised rim and a foot ring."""
    radius, wall = size_cm / 2, rng.uniform(0.35, 0.5)
    well, rise = rng.uniform(0.6, 0.7), size_cm * rng.uniform(0.06, 0.09)
    top = [(0.0, wall + 0.2), (well * radius, wall + 0.2), ((well + 0.08) * radius, 0.6 * rise)]
    top += [(radius, rise)]
    low = [(r, z - wall) for r, z in top]
    foot = [(0.62 * well * radius, 0.2), (0.62 * well * radius, 0.0), (0.7 * well * radius, 0.0)]
    foot += [(0.7 * well * radius, 0.2)]
    section = shapes.outline([low[0], *foot, *low[1:], *top[::-1]], 0.08)
    return [Piece("body", "shell", shapes.lathe(section))]


def tea_cup(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Tea cup with an ear on a saucer, with or without tea."""
    radius, wall = 0.3 * size_cm, rng.uniform(0.22, 0.32)
    high, base = size_cm * rng.uniform(0.36, 0.42), 0.05 * size_cm
    line = fittings.curve([(0.5, 0.0), (0.84, 0.4), (1.0, 1.0)], 12)
    shell, room = fittings.vessel(
        [(0.0, base), *((r * radius, base + z * high) for r, z in line)], wall, 0.05
    )
    ear = [(0.78, 0.25), (1.2, 0.3), (1.4, 0.62), (1.25, 0.85), (0.92, 0.8)]
    handle = fittings.bar([(x * radius, 0, base + z * high) for x, z in ear], 0.22, 0.38)
    half, rise = size_cm / 2, 0.09 * size_cm
    under = [(0.0, 0.0), (0.5 * half, 0.0), (half, rise - 0.4)]
    over = [(half, rise), (0.58 * half, base + 0.1), (0.54 * half, base), (0.0, base)]
    saucer = shapes.lathe(shapes.outline([*under, *over], 0.05))
    tea = shapes.cut_above(room, base + high * rng.uniform(0.4, 0.85))
    pieces = [Piece("cup", "shell", shell + (handle - room)), Piece("saucer", "shell", saucer)]
    return [Piece("tea", "liquid", tea), *pieces] if rng.random() < 0.6 else pieces


def drinking_glass(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Tumbler with a thick bottom, faceted outside now and then, and a drink."""
    radius, wall = size_cm * rng.uniform(0.27, 0.36), rng.uniform(0.2, 0.3)
    foot, floor = radius * rng.uniform(0.72, 0.95), size_cm * rng.uniform(0.06, 0.14)
    body = shapes.lathe(shapes.outline([(0, 0), (foot, 0), (radius, size_cm), (0, size_cm)], 0.1))
    room = shapes.cylinder(foot - wall, floor, size_cm, radius - wall)
    if rng.random() < 0.5:
        groove = shapes.cylinder(0.5, 0.08 * size_cm, 0.5 * size_cm)
        body -= shapes.around(groove.translate((radius + 0.32, 0, 0)), 12)
    pieces = [
        Piece(
            "shell", "shell", body - room - shapes.cylinder(radius - wall, size_cm - 0.2, size_cm)
        )
    ]
    drink = shapes.cut_above(room, size_cm * rng.uniform(0.3, 0.8))
    return [Piece("drink", "liquid", drink), *pieces] if rng.random() < 0.6 else pieces


def wine_glass(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Bulb on a stem and a foot, with or without wine."""
    bulb, wall = size_cm * rng.uniform(0.17, 0.22), rng.uniform(0.1, 0.16)
    low = size_cm * rng.uniform(0.4, 0.5)
    high = size_cm - low
    line = fittings.curve([(0.0, 0.0), (0.8, 0.2), (1.0, 0.48), (0.74, 1.0)], 18)
    shell, room = fittings.vessel([(r * bulb, low + z * high) for r, z in line], wall)
    foot = bulb * rng.uniform(0.9, 1.05)
    stem = [(0, 0), (foot, 0), (foot, 0.12), (0.45, 0.35), (0.3, 0.9), (0.32, 0.8 * low)]
    stem += [(0.55, low + 0.05), (0, low + 0.05)]
    glass = shell + (shapes.lathe(shapes.outline(stem, 0.05)) - room)
    pieces = [Piece("shell", "shell", glass)]
    wine = shapes.cut_above(room, low + high * rng.uniform(0.3, 0.6))
    return [Piece("wine", "liquid", wine), *pieces] if rng.random() < 0.5 else pieces


def teapot(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Round pot with a bore through its spout, an ear, a lid and tea."""
    radius, wall = size_cm * rng.uniform(0.27, 0.3), rng.uniform(0.3, 0.4)
    high = 1.65 * radius
    line = [(0.55, 0.0), (0.98, 0.35), (0.92, 0.72), (0.45, 1.0)]
    bends = fittings.curve(line, 16)
    shell, room = fittings.vessel([(0, 0), *((r * radius, z * high) for r, z in bends)], wall)
    run = [(0.75 * radius, 0, 0.28 * high), (1.35 * radius, 0, 0.5 * high)]
    run += [(1.55 * radius, 0, 0.85 * high), (1.85 * radius, 0, 1.02 * high)]
    path, thick = skins.smooth_path(run, 24), 0.17 * radius
    bore = skins.pipe(np.concatenate([path, path[-1:] + (path[-1:] - path[-2:-1])]), 0.55 * thick)
    ear = [(-0.8, 0.8), (-1.3, 0.92), (-1.55, 0.6), (-1.2, 0.22), (-0.8, 0.25)]
    handle = fittings.bar([(x * radius, 0, z * high) for x, z in ear], 0.3, 0.45)
    filled = shell + room
    pot = shell + ((skins.pipe(path, thick) + handle) - filled) - bore.trim_by_plane((1, 0, 0), 0)
    mouth = 0.45 * radius
    dome = [(0, 1.0), (mouth, 1.0), (0.9 * mouth, 1.04), (0.15 * radius, 1.12)]
    dome += [(0.1 * radius, 1.16), (0.16 * radius, 1.24), (0, 1.28)]
    lid = shapes.lathe(shapes.outline([(r, z * high) for r, z in dome], 0.05))
    lip = shapes.tube(mouth - wall - 0.1, mouth - wall - 0.35, 0.93 * high, 1.01 * high)
    tea = shapes.cut_above(room - skins.pipe(path, thick), high * rng.uniform(0.25, 0.7))
    return [
        Piece("tea", "liquid", tea - lip),
        Piece("pot", "shell", pot),
        Piece("lid", "shell", lid + lip),
    ]


def salt_shaker(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Small jar with salt under a perforated cap."""
    radius, wall = size_cm * rng.uniform(0.22, 0.28), rng.uniform(0.2, 0.3)
    neck, joint = 0.78 * radius, 0.72 * size_cm
    profile = [(0, 0), (radius, 0), (0.9 * radius, 0.5 * size_cm), (neck, 0.66 * size_cm)]
    shell, room = fittings.vessel([*profile, (neck, 0.8 * size_cm)], wall, 0.1)
    cap_low = 0.67 * size_cm
    wide = neck + 0.12
    bends = [(0, cap_low), (wide, cap_low), (wide, 0.84 * size_cm), (0.4 * neck, size_cm)]
    dome = shapes.outline([*bends, (0, size_cm)], 0.15)
    cap = shapes.lathe(dome) - shell - room
    cap -= shapes.lathe(shapes.inset(dome, 0.12)).trim_by_plane((0, 0, 1), 0.8 * size_cm)
    hole = shapes.cylinder(0.08, joint, 2 * size_cm)
    holes = shapes.around(hole.translate((0.22 * neck, 0, 0)), int(rng.integers(3, 7))) + hole
    salt = shapes.cut_above(room, size_cm * rng.uniform(0.25, 0.6))
    return [
        Piece("contents", "contents", salt),
        Piece("shell", "shell", shell),
        Piece("cap", "cap", cap - holes),
    ]


ARCHETYPES: Final = {
    "bowl": Archetype(bowl, "liquid shell"),
    "drinking_glass": Archetype(drinking_glass, "liquid shell"),
    "plate": Archetype(plate, "shell"),
    "salt_shaker": Archetype(salt_shaker, "contents shell cap"),
    "tea_cup": Archetype(tea_cup, "liquid shell"),
    "teapot": Archetype(teapot, "liquid shell"),
    "wine_glass": Archetype(wine_glass, "liquid shell"),
}
