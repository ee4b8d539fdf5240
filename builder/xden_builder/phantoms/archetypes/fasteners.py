"""Small hardware of few parts: screw, nut, wall plug, hook, spring, chain, clips."""

from __future__ import annotations

from math import pi
from typing import Final

import numpy as np
from manifold3d import Manifold

from xden_builder.phantoms import shapes, skins
from xden_builder.phantoms.pieces import Archetype, Piece, moved

__all__ = ["ARCHETYPES"]


def screw(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Wood screw: countersunk head with a recess, a plain neck, a thread that ends in a point."""
    return moved(
        [Piece("body", "body", _wood_screw(rng, size_cm, rng.uniform(0.05, 0.065)))],
        shapes.along_x,
    )


def _wood_screw(rng: np.random.Generator, length: float, share: float) -> Manifold:
    """Upwards from the head at z = 0."""
    major = float(np.clip(share * length, 0.14, 0.32))
    plain = length * rng.uniform(0.25, 0.4)
    rod = shapes.thread(major, 0.66 * major, 0.75 * major, plain, length)
    point = shapes.cylinder(major, plain, length - 3 * major)
    point += shapes.cylinder(major, length - 3 * major, length, 0.06 * major)
    head = shapes.cylinder(2 * major, 0.0, 0.2 * major)
    head += shapes.cylinder(2 * major, 0.2 * major, 1.5 * major, 0.75 * major)
    neck = shapes.cylinder(0.75 * major, 0.0, plain + 0.3 * major)
    cross = shapes.box((0.4 * major, 2 * major, 1.6 * major))
    recess = (cross + cross.rotate((0, 0, 90))) ^ shapes.cylinder(
        major, -0.5 * major, 0.8 * major, 0.4 * major
    )
    return head + neck + (rod ^ point) - recess


def nut(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Hexagon nut, its rims chamfered, with a threaded hole."""
    flats = size_cm * rng.uniform(0.85, 0.87)
    bore, high = 0.31 * flats, 0.5 * flats * rng.uniform(0.85, 1.1)
    body = shapes.slab(shapes.regular_polygon(6, flats), 0.0, high)
    cone = shapes.cylinder(0.5 * flats, 0.0, 0.1 * flats, 0.6 * flats)
    cone += shapes.cylinder(0.6 * flats, 0.1 * flats, high - 0.1 * flats)
    cone += shapes.cylinder(0.6 * flats, high - 0.1 * flats, high, 0.5 * flats)
    return [Piece("body", "body", (body ^ cone) - _tapped(bore, high))]


def _tapped(bore: float, high: float) -> Manifold:
    """Give what a tap cuts away: from below the foot to above the head."""
    return shapes.thread(bore, 0.86 * bore, 0.3 * bore, -0.2 * high, 1.2 * high)


def wall_plug(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Ribbed plug, slit lengthwise, with a screw part of the way in."""
    length, radius = 0.72 * size_cm, 0.72 * size_cm * rng.uniform(0.1, 0.13)
    rims = [(0.1, 1.0), (0.86, 1.0), (0.86, 1.1), (0.98, 1.1)]
    ribs = [(0.2 + 0.1 * i + dz, r) for i in range(6) for dz, r in ((0, 0.88), (0.09, 1.02))]
    points = sorted([*rims[:1], *ribs, *rims[1:]])
    profile = [(0.0, 0.0), (0.62, 0.0), *((r, z) for z, r in points), (1.25, 0.98), (1.25, 1.0)]
    body = shapes.lathe(
        shapes.outline([(r * radius, z * length) for r, z in [*profile, (0.0, 1.0)]])
    )
    body -= shapes.cylinder(0.22 * radius, -1.0, 0.5 * length, 0.35 * radius)
    slit = shapes.box((0.22 * radius, 4 * radius, 0.6 * length), (0, 0, 0.35 * length))
    body -= slit + shapes.cylinder(0.35 * radius, 0.45 * length, 2 * length)
    steel = _wood_screw(rng, 0.8 * size_cm, 0.06).rotate((180, 0, 0)).translate((0, 0, size_cm))
    pieces = [Piece("screw", "screw", steel), Piece("plug", "plug", body)]
    return moved(pieces, shapes.along_x)


def screw_hook(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Wire with a wood thread, a collar and an open bow."""
    wire, bow = size_cm * rng.uniform(0.036, 0.044), size_cm * rng.uniform(0.15, 0.18)
    stem = size_cm - 2 * bow - 2 * wire
    arc = np.radians(np.linspace(-90.0, 150.0, 30))
    x, z = bow * np.cos(arc), stem + bow + wire + bow * np.sin(arc)
    ring = skins.pipe(np.stack([x, 0 * x, z], axis=1), wire)
    shaft = shapes.cylinder(wire, 0.4 * stem, stem + 1.6 * wire)
    collar = shapes.slab(shapes.disc(2.2 * wire), 0.62 * stem, 0.62 * stem + wire, 0.3 * wire)
    rod = shapes.thread(wire, 0.66 * wire, 0.8 * wire, 0.0, 0.5 * stem)
    point = shapes.cylinder(0.06 * wire, 0.0, 3 * wire, wire)
    point += shapes.cylinder(wire, 3 * wire, 0.5 * stem)
    solid = ring + shaft + collar + (rod ^ point)
    return moved([Piece("body", "body", solid)], lambda s: shapes.along_x(s.rotate((0, 0, 90))))


def coil_spring(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Coil under pressure with plain ends, or under tension with hooks."""
    radius, wire = size_cm * rng.uniform(0.12, 0.18), size_cm * rng.uniform(0.018, 0.026)
    if rng.random() < 0.5:
        turns = rng.uniform(0.24, 0.34) * size_cm / (2 * wire)
        solid = skins.spring(radius, wire, 0.0, size_cm, turns)
        return moved([Piece("body", "body", solid)], shapes.along_x)
    low, high = 1.7 * radius, size_cm - 1.7 * radius
    solid = skins.spring(radius, wire, low, high, round((high - low) / (2.3 * wire)))
    angle = np.linspace(0.0, 1.6 * pi, 24)
    mid = radius - wire
    x, z = mid * np.cos(angle), -(0.85 * radius - wire) * np.sin(angle) - 0.0
    arm = np.stack([x, 0 * x, 0.7 * z], axis=1)
    hook = skins.pipe(arm, wire)
    solid += hook.translate((0, 0, low + wire)) + hook.mirror((0, 0, 1)).translate(
        (0, 0, high - wire)
    )
    return moved([Piece("body", "body", solid)], shapes.along_x)


def chain(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Welded links, each turned a quarter against the last, pulled taut."""
    count = int(rng.integers(4, 9))
    wire = size_cm / count * rng.uniform(0.13, 0.16)
    pitch = (size_cm - 2 * wire) / count
    bow = 1.9 * wire
    half = (pitch + wire) / 2 - bow
    angle = np.linspace(-pi / 2, pi / 2, 13)
    right = np.stack([half + bow * np.cos(angle), bow * np.sin(angle), 0 * angle], axis=1)
    path = np.concatenate([right, right * (-1, -1, 1)])
    link = skins.pipe(path, wire, closed=True)
    links = [link.rotate((90 * (i % 2) + 45, 0, 0)) for i in range(count)]
    return [
        Piece(f"link_{i + 1}", "link", solid.translate((i * (pitch - wire - 0.004), 0, 0)))
        for i, solid in enumerate(links)
    ]


def carabiner(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Bent bar with a hinged gate on pins and a spring in it."""
    bar, wide = size_cm * rng.uniform(0.045, 0.055), size_cm * rng.uniform(0.46, 0.54)
    x = size_cm / 2 - bar
    y = wide / 2 - bar
    gate = (-0.45 * x, 0.5 * x)
    points = [(gate[0], -y, 0), (-x, -y, 0), (-x, 0.8 * y, 0), (-0.8 * x, y, 0)]
    points += [(x, 0.7 * y, 0), (x, -y, 0), (gate[1], -y, 0)]
    body = skins.pipe(skins.bent_path(points, 0.5 * y), bar)
    length = gate[1] - gate[0] + 0.6 * bar
    shell = shapes.cylinder(0.8 * bar, 0, length) - shapes.cylinder(0.4 * bar, bar, length - bar)
    coil = skins.spring(0.4 * bar, 0.08 * bar, bar, length - bar, 7.0)
    start = (gate[0] - 0.3 * bar, -y, 0)
    inside, shut = (shapes.along_x(solid).translate(start) for solid in (coil, shell))
    pins = shapes.union(
        shapes.cylinder(0.22 * bar, -1.05 * bar, 1.05 * bar).translate((at, -y, 0))
        for at in (gate[0] - 0.15 * bar, gate[1] + 0.15 * bar)
    )
    ear = shapes.sphere(bar)
    ends = ear.translate((gate[0], -y, 0)) + ear.translate((gate[1], -y, 0))
    return [
        Piece("pins", "pin", pins),
        Piece("spring", "spring", inside),
        Piece("gate", "gate", shut),
        Piece("body", "body", body + ends),
    ]


def binder_clip(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Sprung sheet bent to a wedge, two wire handles in its rolled lips."""
    wide, sheet = size_cm * rng.uniform(0.55, 0.75), rng.uniform(0.05, 0.07)
    depth, back = 0.42 * size_cm, 0.2 * size_cm
    wedge = [(0.0, back), (0.0, -back), (depth, -0.12), (depth, 0.12)]
    outer = shapes.polygon(wedge, 0.02)
    profile = outer - shapes.inset(outer, sheet)
    profile -= shapes.polygon([(0.9 * depth, -0.06), (0.9 * depth, 0.06), (9, 0.06), (9, -0.06)])
    lips = shapes.disc(0.14, (depth, 0.16)) - shapes.disc(0.08, (depth, 0.16))
    lips += lips.mirror((0.0, 1.0))
    body = shapes.upright(profile + lips, wide)
    wire, reach = 0.075, size_cm - depth
    foot, tip = 0.42 * wide, 0.12 * wide
    arms = [(0, -foot, 0), (0, -0.3 * wide, 0), (0.75 * reach, -tip, 0), (reach - wire, -tip, 0)]
    path = skins.bent_path([*arms, *((x, -y, 0) for x, y, _ in reversed(arms))], 0.2)
    handle = skins.pipe(path, wire)
    upper = handle.rotate((0, -12.0, 0)).translate((depth, 0, 0.16))
    return [
        Piece("upper_handle", "wire", upper),
        Piece("lower_handle", "wire", upper.mirror((0, 0, 1))),
        Piece("body", "body", body),
    ]


def paper_clip(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Wire bent round three times."""
    wire = size_cm * rng.uniform(0.016, 0.022)
    wide, long = size_cm * rng.uniform(0.1, 0.12), size_cm - 2 * wire
    line = [(0.25 * long, wide), (0.98 * long, wide), (0.98 * long, -0.75 * wide)]
    line += [(0.0, -0.75 * wide), (0.0, 0.72 * wide), (0.82 * long, 0.72 * wide)]
    line += [(0.82 * long, -0.45 * wide), (0.22 * long, -0.45 * wide)]
    rise = np.linspace(0.0, 2.2 * wire, len(line))
    points = [(x, y, float(z)) for (x, y), z in zip(line, rise, strict=True)]
    return [Piece("body", "body", skins.pipe(skins.bent_path(points, 0.9 * wide, 9), wire))]


def bracket(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Two plates at a right angle, a gusset between them, countersunk holes."""
    wide, thick = size_cm * rng.uniform(0.16, 0.3), size_cm * rng.uniform(0.025, 0.04)
    other = size_cm * rng.uniform(0.55, 0.9)
    side = [(0, 0), (size_cm, 0), (size_cm, thick), (thick, thick), (thick, other), (0, other)]
    body = shapes.upright(shapes.polygon(side), wide)
    rib = [(0, 0), (0.6 * size_cm, 0), (0.6 * size_cm, thick), (thick, 0.6 * other)]
    body += shapes.upright(shapes.polygon([*rib, (0, 0.6 * other)]), 0.8 * thick)
    hole = shapes.cylinder(0.1 * wide, -1, 1)
    hole += shapes.cylinder(0.1 * wide, 0.4 * thick, 1.02 * thick, 0.16 * wide)
    flat = [hole.translate((x * size_cm, y * wide, 0)) for x, y in _HOLES]
    wall = [shapes.along_x(hole).translate((0, y * wide, x * other)) for x, y in _HOLES]
    return [Piece("body", "body", body - shapes.union([*flat, *wall]))]


_HOLES: Final = [(0.3, 0.28), (0.3, -0.28), (0.82, 0.0)]


def key(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Flat key: a bow with a hole, half of them in plastic, a grooved and notched blade."""
    bow, thick = size_cm * rng.uniform(0.2, 0.23), 0.22
    blade, half = size_cm - 2 * bow, 0.075 * size_cm
    cuts = rng.uniform(0.2, 0.9, 6)
    edge = [
        (2 * bow + blade * (i + d) / 7.0, half * (1 - c) if d else half)
        for i, c in enumerate(cuts, 1)
        for d in (0.0, 0.35, 0.6)
    ]
    line = [(1.6 * bow, half), *edge, (size_cm - half, half), (size_cm, 0.0)]
    line += [(size_cm - half, -half), (1.6 * bow, -half)]
    plan = shapes.polygon(line) + shapes.disc(0.9 * bow, (bow, 0.0))
    hole = shapes.disc(0.25 * bow, (0.5 * bow, 0.0))
    covered = rng.random() < 0.5
    plate = shapes.slab(plan - hole, -thick / 2, thick / 2)
    groove = shapes.box((blade, 0.3 * half, 0.08), (size_cm - blade / 2, -0.35 * half, thick / 2))
    pieces = [Piece("blade", "blade", plate - groove - groove.mirror((0, 0, 1)))]
    if covered:
        cover = shapes.slab(shapes.disc(1.05 * bow, (bow, 0.0)), -1.4 * thick, 1.4 * thick, 0.1)
        pieces.append(Piece("cover", "cover", cover - shapes.slab(hole, -2.0, 2.0)))
    return pieces


ARCHETYPES: Final = {
    "binder_clip": Archetype(binder_clip, "wire body"),
    "bracket": Archetype(bracket, "body"),
    "carabiner": Archetype(carabiner, "pin spring gate body"),
    "chain": Archetype(chain, "link"),
    "coil_spring": Archetype(coil_spring, "body"),
    "key": Archetype(key, "blade cover"),
    "nut": Archetype(nut, "body"),
    "paper_clip": Archetype(paper_clip, "body"),
    "screw": Archetype(screw, "body"),
    "screw_hook": Archetype(screw_hook, "body"),
    "wall_plug": Archetype(wall_plug, "screw plug"),
}
