"""Kitchen: an electric kettle, a mug, a frying pan."""

from __future__ import annotations

from typing import Final

import numpy as np
from manifold3d import Manifold

from xden_builder.phantoms import shapes, skins
from xden_builder.phantoms.pieces import Archetype, Piece

__all__ = ["ARCHETYPES"]


def kettle(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Electric kettle: base, heating plate, shell with a spout, water, lid, hollow handle."""
    low, wall = size_cm * rng.uniform(0.33, 0.37), rng.uniform(0.15, 0.25)
    top, floor, rim = low * rng.uniform(0.7, 0.82), 0.12 * size_cm, 0.9 * size_cm
    body = shapes.cylinder(low, floor, rim, top)
    cavity = shapes.cylinder(low - wall, floor, rim, top - wall)
    shell = (body + _spout(top, 0.0, rim, size_cm)) - _spout(top, wall, rim + 0.01, size_cm)
    above, plate = cavity.split_by_plane((0.0, 0.0, 1.0), floor + 0.3)
    level = floor + (rim - floor) * rng.uniform(0.3, 0.7)
    return [
        Piece("heating_plate", "plate", plate),
        Piece("shell", "shell", shell - cavity),
        Piece("water", "liquid", shapes.cut_above(above, level)),
        Piece("base", "base", _hollow_base(low, floor, wall)),
        Piece("lid", "lid", _lid(top, wall, rim, size_cm)),
        Piece("handle", "handle", _kettle_handle(low, top, floor, rim, size_cm) - body),
    ]


def _spout(top: float, wall: float, rim: float, size: float) -> Manifold:
    """Beak at the rim, towards +x, or with ``wall`` the channel in it."""
    root = shapes.cylinder(0.1 * size - wall, rim - 0.2 * size + wall, rim)
    tip = shapes.cylinder(0.025 * size - wall / 3, rim - 0.06 * size + wall, rim)
    return (root.translate((0.75 * top, 0, 0)) + tip.translate((1.25 * top, 0, 0))).hull()


def _hollow_base(radius: float, height: float, wall: float) -> Manifold:
    """Foot, closed, with room for the wiring."""
    profile = [(0, 0), (0.97 * radius, 0), (radius, 0.2 * height), (radius, height), (0, height)]
    section = shapes.outline(profile, 0.1 * height)
    block = shapes.lathe(section) + shapes.cylinder(radius, 0.5 * height, height)
    return block - shapes.lathe(shapes.inset(section, wall))


def _lid(top: float, wall: float, rim: float, height: float) -> Manifold:
    """Disc on the rim with a lip inside it and a knob."""
    knob = [(0, 0.3), (0.1 * top, 0.3), (0.2 * top, height - rim), (0, height - rim)]
    lid = shapes.lathe(shapes.outline([(r, rim + z) for r, z in knob], 0.1))
    lip = shapes.tube(top - 1.5 * wall, top - 2.5 * wall, rim - 0.6, rim + 0.1)
    return lid + lip + shapes.slab(shapes.disc(top), rim, rim + 0.35, 0.1)


def _kettle_handle(low: float, top: float, floor: float, rim: float, size: float) -> Manifold:
    """Hollow grip towards -x; its ends reach into the body, which is cut off it."""
    reach = low + 0.2 * size
    corners = [(0.9 * top, rim - 0.07 * size), (0.85 * reach, rim - 0.05 * size)]
    corners += [(reach, rim - 0.2 * size), (0.96 * reach, floor + 0.25 * size)]
    corners += [(0.9 * low, floor + 0.1 * size)]
    path = skins.smooth_path([(-x, 0.0, z) for x, z in corners], 30)
    grip, bore = 0.035 * size, 0.022 * size
    return skins.pipe(path, grip, 1.3 * grip) - skins.pipe(path[7:-7], bore, 1.3 * bore)


def mug(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Open mug with a foot ring and an oval handle, all of one piece."""
    radius, wall = size_cm * rng.uniform(0.38, 0.46), 0.035 * size_cm * rng.uniform(0.9, 1.2)
    waist, foot = radius * rng.uniform(0.86, 1.04), radius * rng.uniform(0.75, 0.95)
    floor = 0.03 * size_cm
    bends = [(foot, 0.0, floor), (waist, 0.0, 0.4 * size_cm), (radius, 0.0, size_cm)]
    r, _, z = skins.smooth_path(bends, 14).T
    ring = [(0.0, floor), (0.8 * foot, floor), (0.8 * foot, 0.0), (0.93 * foot, 0.0)]
    body = shapes.lathe(shapes.outline([*ring, *zip(r, z, strict=True), (0.0, size_cm)], 0.05))
    inside = [(0.0, floor + wall), *zip(r - wall, z + wall, strict=True), (0.0, size_cm + wall)]
    cavity = shapes.lathe(shapes.outline(inside, 0.1 * radius))
    ear = [(waist, 0.22), (waist + 0.26 * size_cm, 0.3), (waist + 0.32 * size_cm, 0.52)]
    ear += [(radius + 0.24 * size_cm, 0.76), (radius, 0.82)]
    path = skins.smooth_path([(x - 0.7 * wall, 0.0, up * size_cm) for x, up in ear], 36)
    thick = rng.uniform(0.045, 0.06) * size_cm
    return [Piece("body", "shell", body + skins.pipe(path, thick, 1.4 * thick) - cavity)]


def frying_pan(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Pan with a riveted bracket whose tang sits in the handle, towards +x."""
    radius, wall = size_cm * rng.uniform(0.26, 0.29), rng.uniform(0.22, 0.35)
    height, bevel = radius * rng.uniform(0.28, 0.38), 0.8 * radius
    profile = [(0, 0), (bevel, 0), (radius, height), (radius - wall, height)]
    pan = shapes.lathe(shapes.outline([*profile, (bevel - wall, wall), (0, wall)], 0.1))
    filled = shapes.cylinder(bevel, 0.0, height, radius)
    z, wide, end = 0.62 * height, 0.11 * size_cm, size_cm - radius
    plate = shapes.rounded_box((0.5 * radius, wide, 0.6 * height), 0.1, (radius - 0.1, 0, z))
    plate = plate.trim_by_plane((-1, 0, 0), -(radius + 0.25)) - filled
    start = radius + 0.07 * size_cm
    tang = shapes.box((0.62 * (end - radius), 0.3 * wide, 0.22))
    tang = tang.translate((radius + 0.2 + 0.31 * (end - radius), 0, 0))
    grip = 0.034 * size_cm
    ovals = [(0, 0.5, 0.5), (0.03, 0.7, 0.7), (0.4, 0.8, 0.85), (0.7, 1, 1.1), (0.96, 0.9, 1)]
    ovals = [(t * (end - start), grip * x, grip * y) for t, x, y in [*ovals, (1, 0.6, 0.7)]]
    handle = shapes.along_x(skins.loft(ovals, 2.5)).translate((start, 0, 0))
    tilt = rng.uniform(4.0, 10.0)
    tang, handle = (
        part.translate((-radius, 0, 0)).rotate((0, -tilt, 0)).translate((radius, 0, z))
        for part in (tang, handle)
    )
    rivet = shapes.along_x(
        shapes.cylinder(0.035 * size_cm / 4, 0.85 * radius - wall, radius + 0.35)
    )
    rivets = rivet.translate((0, 0.3 * wide, z)) + rivet.translate((0, -0.3 * wide, z))
    return [
        Piece("rivets", "rivet", rivets),
        Piece("pan", "pan", pan),
        Piece("bracket", "bracket", plate + tang),
        Piece("handle", "handle", handle),
    ]


ARCHETYPES: Final = {
    "frying_pan": Archetype(frying_pan, "rivet pan bracket handle"),
    "kettle": Archetype(kettle, "plate shell liquid base lid handle"),
    "mug": Archetype(mug, "shell"),
}
