"""Personal care: razor, brushes, comb, tube, lipstick, pump bottle, perfume."""

from __future__ import annotations

from typing import Final

import numpy as np
from manifold3d import CrossSection, Manifold

from xden_builder.phantoms import shapes, skins
from xden_builder.phantoms.pieces import Archetype, Piece, moved

__all__ = ["ARCHETYPES", "tufts"]


def razor(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Handle with an elastic grip, a head across its end with blades between two bars."""
    radius, wide = size_cm * rng.uniform(0.04, 0.05), rng.uniform(3.8, 4.4)
    points = [(0, 0, 0), (0.35 * size_cm, 0, 0.03 * size_cm), (0.75 * size_cm, 0, 0)]
    path = skins.smooth_path([*points, (0.92 * size_cm, 0, 0.05 * size_cm)], 30)
    handle = skins.pipe(path, 0.85 * radius, radius) + shapes.sphere(0.86 * radius)
    end = (float(path[-1, 0]), 0.0, float(path[-1, 2]))
    joints = [shapes.sphere(0.3, end), shapes.sphere(0.2, (0.95 * size_cm, 0.0, 0.06 * size_cm))]
    handle += Manifold.batch_hull(joints)
    grip = skins.pipe(path[4:18], radius, 1.18 * radius)
    x, z = 0.95 * size_cm, 0.06 * size_cm
    head = shapes.rounded_box((1.1, wide, 0.5), 0.12, (x, 0, z))
    blades = [
        shapes.box((0.28, wide - 0.4, 0.03)).rotate((0, -25, 0)).translate((x + d, 0, z + 0.22))
        for d in (-0.28, 0.0, 0.28)
    ]
    bay = shapes.box((0.9, wide - 0.5, 0.3), (x, 0, z + 0.32))
    strip = shapes.box((0.16, wide - 0.5, 0.14), (x - 0.47, 0, z + 0.2))
    tilt = [
        s.translate((-x, 0, -z)).rotate((0, 35, 0)).translate((x, 0, z))
        for s in (*blades, strip, head - bay)
    ]
    return [
        *(Piece(f"blade_{i + 1}", "blade", blade) for i, blade in enumerate(tilt[:3])),
        Piece("strip", "strip", tilt[3]),
        Piece("grip", "grip", grip - skins.pipe(path, 0.85 * radius, radius)),
        Piece("handle", "handle", handle),
        Piece("head", "head", tilt[4]),
    ]


def tufts(spots: list[tuple[float, float]], radius: float, z0: float, z1: float) -> Manifold:
    """Bundles of bristles, upright at spots of the plane."""
    tuft = shapes.cylinder(radius, z0, z1)
    return shapes.union(tuft.translate((x, y, 0)) for x, y in spots)


def toothbrush(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Curved handle with an elastic inlay and a head full of tufts."""
    wide, thick = size_cm * rng.uniform(0.032, 0.038), size_cm * rng.uniform(0.02, 0.026)
    stations = [(0.0, 0.5), (0.03, 0.8), (0.2, 1.0), (0.42, 0.9), (0.55, 1.05), (0.7, 0.55)]
    stations += [(0.82, 0.5), (0.86, 0.9), (0.97, 0.85), (1.0, 0.5)]
    body = skins.loft(
        [(z * size_cm, thick * min(1, 0.3 + s * 0.7), wide * s) for z, s in stations], 2.6
    )
    body = body.rotate((0, 90, 0))
    inlay = shapes.box((0.3 * size_cm, 0.9 * wide, 9.0), (0.35 * size_cm, 0, 4.5 + 0.4 * thick))
    long, pitch = 0.13 * size_cm, 0.24
    rows = range(int(long / pitch))
    spots = [(0.85 * size_cm + i * pitch, j * pitch) for i in rows for j in (-1, 0, 1)]
    hair = tufts(spots, 0.085, 0.2 * thick, rng.uniform(1.1, 1.4))
    return [
        Piece("bristles", "bristles", hair),
        Piece("inlay", "grip", body ^ inlay),
        Piece("handle", "handle", body - inlay),
    ]


def hairbrush(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Paddle with an air cushion of rubber, its pins set through it."""
    half, thick = size_cm * rng.uniform(0.12, 0.17), rng.uniform(0.7, 0.9)
    x0, x1 = 0.62 * size_cm, size_cm - half
    paddle = CrossSection.batch_hull([shapes.disc(half, (x0, 0)), shapes.disc(half, (x1, 0))])
    grip = CrossSection.batch_hull([shapes.disc(1.2, (1.2, 0)), shapes.disc(0.9, (x0, 0))])
    body = shapes.slab(paddle, -thick, thick, 0.35) + shapes.slab(grip, -thick, thick, 0.4)
    pad = shapes.inset(paddle, 0.3 * half)
    bay = shapes.slab(pad, 0.0, 9.0)
    dome = shapes.slab(pad, 0.0, thick + 0.35, 0.3)
    dome -= shapes.slab(shapes.inset(pad, 0.2), 0.2, thick + 0.1)
    pitch, top = 0.42 * half, thick + rng.uniform(1.2, 1.7)
    spots = [
        (x, y)
        for x in np.arange(x0 - half, x1 + half, pitch).tolist()
        for y in (-1.2 * pitch, -0.4 * pitch, 0.4 * pitch, 1.2 * pitch)
        if x0 - 0.25 * half < x < x1 + 0.25 * half
    ]
    pins = tufts(spots, 0.08, thick + 0.1, top) + shapes.union(
        shapes.sphere(0.13, (x, y, top)) for x, y in spots
    )
    return [
        Piece("pins", "bristles", pins),
        Piece("cushion", "cushion", dome),
        Piece("body", "handle", body - bay),
    ]


def comb(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Back with teeth, fine on one half, coarse on the other."""
    high, thick = size_cm * rng.uniform(0.16, 0.24), rng.uniform(0.28, 0.42)
    plan = shapes.polygon(
        [
            (0, 0),
            (0, 0.85 * high),
            (0.1 * size_cm, high),
            (0.9 * size_cm, high),
            (size_cm, 0.85 * high),
            (size_cm, 0),
        ],
        0.08 * high,
    )
    body = shapes.slab(plan, -thick / 2, thick / 2)
    taper = shapes.upright_across(
        shapes.polygon(
            [
                (-0.1, 0.12),
                (0.7 * high, thick),
                (2 * high, thick),
                (2 * high, -thick),
                (0.7 * high, -thick),
                (-0.1, -0.12),
            ]
        ),
        3 * size_cm,
    )
    slits, x = [], 0.05 * size_cm
    while x < 0.95 * size_cm:
        gap = 0.1 if x < size_cm / 2 else 0.16
        slits.append(shapes.box((gap, 0.68 * high, 9.0), (x, 0.34 * high - 0.02, 0)))
        x += 2.1 * gap
    return [Piece("body", "body", (body ^ taper) - shapes.union(slits))]


def squeeze_tube(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Tube that flattens to a crimped end, a cap on a threaded neck, cream inside."""
    cap, radius = size_cm * rng.uniform(0.14, 0.19), size_cm * rng.uniform(0.12, 0.16)
    neck, wall = 0.45 * radius, rng.uniform(0.06, 0.09)
    crimp, flat = size_cm - 0.8, 1.45 * radius
    stations = [(cap + 0.6, radius, radius), (0.5 * size_cm, 0.85 * radius, 1.15 * radius)]
    stations += [(0.75 * size_cm, 0.55 * radius, 1.3 * radius), (crimp, 0.1, flat)]
    outside = skins.loft([(cap + 0.1, neck, neck), *stations, (size_cm, 0.1, flat)])
    room = skins.loft(
        [(cap + 0.15, neck - wall, neck - wall)]
        + [(z, x - wall, y - wall) for z, x, y in stations[:3]]
        + [(crimp - 0.3, 0.07, flat - 2 * wall)]
    )
    pipe = shapes.cylinder(neck, 0.35 * cap, cap + 0.2)
    mouth = shapes.cylinder(0.5 * neck, 0.0, cap + 0.3)
    hood = shapes.cylinder(0.96 * radius, 0.0, cap, radius) - shapes.cylinder(neck, 0.35 * cap, 99)
    cut = rng.uniform(0.6, 0.95) * crimp
    return moved(
        [
            Piece(
                "cream",
                "cream",
                shapes.cut_above(room, cut) + (mouth - shapes.cylinder(9, -9, 0.35 * cap)),
            ),
            Piece("tube", "shell", (outside + pipe) - room - mouth),
            Piece("cap", "cap", hood),
        ],
        shapes.along_x,
    )


def pump_bottle(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Oval bottle with its liquid and a pump with dip tube and spring on it."""
    top, wide = 0.68 * size_cm, size_cm * rng.uniform(0.16, 0.2)
    deep, neck = wide * rng.uniform(0.55, 0.95), 1.1 * rng.uniform(0.9, 1.1)
    wall = rng.uniform(0.1, 0.16)
    neck = min(neck, 0.8 * deep)
    shares = [(0.0, 0.9), (0.03, 1.0), (0.5, 1.0), (0.75, 0.92), (0.88, 0.7)]
    stations = [(z * top, wide * s, deep * s) for z, s in shares]
    outside = skins.loft([*stations, (0.96 * top, neck, neck), (top + 0.8, neck, neck)], 2.6)
    room = skins.loft(
        [(max(z, wall), x - wall, y - wall) for z, x, y in stations]
        + [(0.95 * top, neck - wall, neck - wall), (top + 2.0, neck - wall, neck - wall)],
        2.6,
    )
    liquid = shapes.cut_above(room, top * rng.uniform(0.3, 0.85))
    return [
        *_pump(neck, top, size_cm),
        Piece("liquid", "liquid", liquid),
        Piece("bottle", "shell", outside - room),
    ]


def _pump(neck: float, top: float, size: float) -> list[Piece]:
    """Dip tube, chamber with a spring, collar and a spout to press."""
    bore, low = 0.5 * neck, top - 2.2
    straw = shapes.tube(0.28, 0.18, 0.6, low + 0.3)
    chamber = shapes.cylinder(bore, low, top + 0.8) - shapes.cylinder(bore - 0.1, low + 0.3, 99)
    chamber -= shapes.cylinder(0.28, low - 1.0, low + 1.0)
    chamber += shapes.tube(neck + 0.01, bore - 0.1, top + 0.8, top + 0.95)
    coil = skins.spring(bore - 0.12, 0.05, low + 0.32, low + 1.6, 5.0)
    stem = shapes.cylinder(0.24, low + 1.6, size - 0.4) + shapes.cylinder(
        bore - 0.1, low + 1.6, low + 1.85
    )
    stem -= shapes.cylinder(0.12, 0.0, size - 0.8)
    collar = shapes.cylinder(neck + 0.3, top - 0.1, top + 1.3)
    collar -= shapes.cylinder(neck + 0.01, 0.0, top + 0.95) + shapes.cylinder(0.3, 0.0, 99)
    head = shapes.slab(shapes.disc(0.95 * neck), size - 1.0, size, 0.2)
    spout = shapes.along_x(shapes.cylinder(0.36, 0.0, 1.6 * neck + 1.6, 0.26))
    pierced = shapes.along_x(shapes.cylinder(0.14, 0.0, 99)).translate((0, 0, size - 0.62))
    head += spout.translate((0, 0, size - 0.62))
    head -= pierced + shapes.cylinder(0.12, size - 1.5, size - 0.6)
    return [
        Piece("spring", "spring", coil),
        Piece("straw", "pump", straw),
        Piece("stem", "pump", stem),
        Piece("chamber", "pump", chamber),
        Piece("head", "cap", head),
        Piece("collar", "cap", collar + shapes.tube(0.31, 0.24, top + 1.0, top + 1.3)),
    ]


def lipstick(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Slanted stick in a metal holder, an inner sleeve, a base and a cap."""
    radius, joint = size_cm * rng.uniform(0.115, 0.14), 0.42 * size_cm
    bore = radius - 0.14
    base = shapes.slab(shapes.disc(radius), 0.0, joint, 0.06) - shapes.cylinder(bore, 0.25, 99)
    sleeve = shapes.tube(bore, bore - 0.1, 0.25, 0.62 * size_cm)
    floor = joint * rng.uniform(0.5, 0.9)
    cup = shapes.cylinder(bore - 0.1, floor, floor + 0.7) - shapes.cylinder(
        bore - 0.16, floor + 0.1, 99
    )
    stick = shapes.slab(shapes.disc(bore - 0.16), floor + 0.1, 0.85 * size_cm, 0.1)
    slant = shapes.box((9, 9, 9), (0, 0, 4.5)).rotate((0, 42, 0)).translate((0, 0, 0.76 * size_cm))
    hood = shapes.slab(shapes.disc(radius), joint, size_cm, 0.06)
    hood -= shapes.cylinder(bore, 0.0, size_cm - 0.2)
    return [
        Piece("stick", "stick", stick - slant),
        Piece("cup", "cup", cup),
        Piece("sleeve", "sleeve", sleeve),
        Piece("base", "shell", base),
        Piece("cap", "cap", hood),
    ]


def perfume(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Block of thick glass with its scent, a crimped atomizer with dip tube, a cap."""
    wide, high = size_cm * rng.uniform(0.42, 0.6), 0.66 * size_cm
    deep, wall = wide * rng.uniform(0.4, 0.65), rng.uniform(0.3, 0.5)
    neck = min(0.65, 0.3 * deep)
    block = shapes.slab(shapes.rounded_rectangle(wide, deep, 0.25), 0.0, high, 0.15)
    room = shapes.slab(
        shapes.rounded_rectangle(wide - 2 * wall, deep - 2 * wall, 0.2),
        1.6 * wall,
        high - wall,
        0.1,
    )
    glass = block + shapes.cylinder(neck, high - 0.1, high + 0.8)
    inside = room + shapes.cylinder(0.6 * neck, high - 2 * wall, high + 9.0)
    liquid = shapes.cut_above(room, high * rng.uniform(0.4, 0.8))
    straw = shapes.tube(0.14, 0.08, 1.7 * wall, high)
    pump = shapes.cylinder(0.45 * neck, high - 0.5, high + 0.8)
    ferrule = shapes.cylinder(1.25 * neck, high + 0.01, high + 1.0) - shapes.cylinder(
        neck, 0.0, high + 0.8
    )
    button = shapes.slab(shapes.disc(0.8 * neck), high + 1.0, high + 1.6, 0.1)
    hood = shapes.slab(shapes.rounded_rectangle(3.4 * neck, 3.2 * neck, 0.15), high, size_cm, 0.1)
    hood -= shapes.cylinder(1.25 * neck, 0.0, max(high + 1.7, size_cm - 0.35))
    return [
        Piece("straw", "pump", straw),
        Piece("pump", "pump", pump),
        Piece("liquid", "liquid", liquid),
        Piece("ferrule", "ferrule", ferrule),
        Piece("button", "pump", button),
        Piece("bottle", "shell", glass - inside),
        Piece("cap", "cap", hood),
    ]


ARCHETYPES: Final = {
    "comb": Archetype(comb, "body"),
    "hairbrush": Archetype(hairbrush, "bristles cushion handle"),
    "lipstick": Archetype(lipstick, "stick cup sleeve shell cap"),
    "perfume": Archetype(perfume, "pump liquid ferrule shell cap"),
    "pump_bottle": Archetype(pump_bottle, "spring pump cap liquid shell"),
    "razor": Archetype(razor, "blade strip grip handle head"),
    "squeeze_tube": Archetype(squeeze_tube, "cream shell cap"),
    "toothbrush": Archetype(toothbrush, "bristles grip handle"),
}
