"""Sports: helmet, air pump, hollow balls, bat, kettlebell, pin, flying disc, shuttlecock."""

from __future__ import annotations

from functools import partial
from math import pi
from typing import Final

import numpy as np
from manifold3d import Manifold

from xden_builder.phantoms import fittings, shapes, skins
from xden_builder.phantoms.pieces import Archetype, Piece, moved

__all__ = ["ARCHETYPES"]


def bicycle_helmet(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Foam dome with vents under a thin shell, pads and a strap with a buckle."""
    wide, high = size_cm * rng.uniform(0.74, 0.8), size_cm * rng.uniform(0.5, 0.56)
    foam, skin = rng.uniform(2.2, 2.8), 0.12
    radii = (size_cm / 2, wide / 2, high)
    solid, coat, room = (_dome(radii, d) for d in (skin, 0.0, skin + foam))
    brim = fittings.ellipsoid((0.42 * size_cm, wide, 0.25 * high), (-0.02 * size_cm, 0, 0))
    vent = fittings.ellipsoid((0.2 * size_cm, 0.045 * wide, high))
    count = int(rng.integers(2, 4))
    places = [(x, y) for x in (-0.24, 0.2) for y in np.linspace(-0.27, 0.27, 2 * count - 1)]
    vents = shapes.union(
        vent.translate((x * size_cm, float(y) * wide, 0.75 * high)) for x, y in places
    )
    cut = vents + brim + room
    inside = _dome(radii, skin + 0.003)  # a hair's gap keeps two curved surfaces apart
    pads = shapes.union(
        fittings.ellipsoid((2.2, 1.3, 1.3), (x * size_cm, y * wide, 0.62 * high))
        for x, y in ((0.3, 0.0), (-0.3, 0.0), (0.0, 0.3), (0.0, -0.3))
    )
    return [
        Piece("strap", "strap", _strap(wide / 2 - foam, 0.42 * high)),
        Piece("buckle", "buckle", shapes.rounded_box((2.2, 3.0, 1.0), 0.3, (0, 0, -0.62 * high))),
        Piece("foam", "foam", inside - cut),
        Piece("shell", "shell", coat - (solid + cut)),
        Piece("pads", "pad", pads ^ room),
    ]


def _dome(radii: fittings.Point, less: float) -> Manifold:
    """Half an egg, shrunk."""
    x, y, z = radii
    egg = Manifold.sphere(1.0, 72).scale((x - less, y - less, z - less))
    return egg.trim_by_plane((0.0, 0.0, 1.0), 0.3)


def _strap(side: float, top: float) -> Manifold:
    """Band from ear to ear under the chin; its ends reach into the foam."""
    half = [(side + 1.2, top), (side + 0.6, 0.3 * top), (0.8 * side, -0.9 * top)]
    half += [(0.35 * side, -1.45 * top)]
    line = [*half, (0.0, -1.48 * top), *((-y, z) for y, z in half[::-1])]
    return fittings.bar([(0.0, y, z) for y, z in line], 0.12, 0.9, 40)


def air_pump(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Hand pump: barrel, rod with piston and seal, spring, valve head, handle."""
    radius, wall = size_cm * rng.uniform(0.055, 0.075), rng.uniform(0.12, 0.2)
    head, top = 0.16 * size_cm, size_cm * rng.uniform(0.66, 0.74)
    bore, end = radius - wall, 0.8 * size_cm
    stop = head + (top - head) * rng.uniform(0.3, 0.75)
    barrel = shapes.tube(radius, bore, head - 0.8, top)
    rod = shapes.cylinder(0.28 * radius, stop + 0.5, end + 1.5)
    piston = shapes.cylinder(bore - 0.08, stop, stop + 1.2)
    seal = shapes.tube(bore, bore - 0.25, stop + 0.4, stop + 0.8)
    cap = shapes.tube(radius + 0.25, 0.28 * radius, top - 1.0, top + 0.5)
    spring = skins.spring(0.7 * bore, 0.07, top - 2.4, top, 5.0)
    base = shapes.slab(shapes.disc(1.15 * radius), head - 1.2, head, 0.2)
    base += shapes.slab(shapes.disc(0.8 * radius), 0.0, head - 1.0, 0.3)
    channel = shapes.cylinder(0.2, -1.0, head)
    nozzle = shapes.tube(0.5 * radius, 0.2, 0.25 * head, 0.45 * head)
    grip = shapes.slab(shapes.disc(1.1 * radius), end, size_cm, 0.4 * radius)
    lever = shapes.rounded_box((2.6 * radius, 0.8, 1.0), 0.3, (1.3 * radius, 0, 0.3 * head))
    pieces = [
        Piece("rod", "rod", rod),
        Piece("seal", "seal", seal),
        Piece("gasket", "seal", nozzle),
        Piece("piston", "piston", piston),
        Piece("spring", "spring", spring),
        Piece("cap", "head", cap - shapes.cylinder(radius, 0.0, top)),
        Piece("lever", "lever", lever - shapes.cylinder(0.3 * radius, -1, head)),
        Piece("barrel", "barrel", barrel),
        Piece("head", "head", base - channel),
        Piece("handle", "handle", grip),
    ]
    return moved(pieces, shapes.along_x)


def shelled_ball(
    rng: np.random.Generator, size_cm: float, wall: float, skin: float, panels: bool
) -> list[Piece]:
    """Hollow core under a skin with a seam or panels."""
    radius = size_cm / 2
    core = shapes.sphere(radius - skin * size_cm)
    core -= shapes.sphere(radius - (skin + wall) * size_cm * rng.uniform(0.9, 1.1))
    cover = shapes.sphere(radius) - shapes.sphere(radius - (skin + 0.2 * wall) * size_cm)
    if panels:
        for normal in _even(6):
            cover -= _groove(radius, normal)
    else:
        cover -= skins.pipe(_seam(radius), 0.02 * size_cm, closed=True)
    return [Piece("core", "core", core), Piece("cover", "cover", cover)]


def _even(count: int) -> np.ndarray:
    """Directions spread evenly: the golden spiral."""
    at = np.arange(count) + 0.5
    z, angle = 1 - 2 * at / count, pi * (1 + 5**0.5) * at
    flat = np.sqrt(1 - z**2)
    return np.stack([flat * np.cos(angle), flat * np.sin(angle), z], axis=1)


def _groove(radius: float, normal: np.ndarray) -> Manifold:
    """Ring cut into a sphere about a direction."""
    polar, azimuth = np.degrees(np.arccos(normal[2])), np.degrees(np.arctan2(normal[1], normal[0]))
    cut = fittings.ring(0.71 * radius, 0.025 * radius, 0.71 * radius)
    return cut.rotate((0.0, float(polar), float(azimuth)))


def _seam(radius: float) -> np.ndarray:
    """Points of the tennis-ball curve on a sphere."""
    angle = 2 * pi * np.arange(100) / 100
    x, y = np.cos(angle) + 0.32 * np.cos(3 * angle), np.sin(angle) - 0.32 * np.sin(3 * angle)
    seam = np.stack([x, y, 2 * np.sqrt(0.32) * np.sin(2 * angle)], axis=1)
    return np.asarray(radius * seam / np.linalg.norm(seam, axis=1, keepdims=True))


def table_tennis_bat(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Plywood blade with a foam and a rubber sheet on each face, and two handle scales."""
    blade, thick = 0.3 * size_cm, rng.uniform(0.5, 0.7)
    round_ = shapes.disc(blade).scale((1.0, rng.uniform(0.92, 0.98)))
    neck = shapes.rounded_rectangle(0.75 * size_cm, 2.4, 0.3).translate((0.02 * size_cm, 0))
    shaft = neck.translate((size_cm - blade - 0.395 * size_cm, 0.0))
    wood = shapes.slab(round_ + shaft, -thick / 2, thick / 2)
    part = round_ ^ shapes.rounded_rectangle(4 * blade, 4 * blade, 0.1).translate((-1.3 * blade, 0))
    sheets = [shapes.slab(part, z, z + d) for z, d in ((thick / 2, 0.2), (thick / 2 + 0.2, 0.15))]
    start, end = 1.02 * blade, size_cm - blade
    scale = fittings.grip(start, end, 1.15, 1.4)
    low = -thick / 2
    return [
        Piece("blade", "wood", wood),
        Piece("upper_sponge", "sponge", sheets[0]),
        Piece("upper_rubber", "rubber", sheets[1]),
        Piece("lower_sponge", "sponge", sheets[0].mirror((0, 0, 1))),
        Piece("lower_rubber", "rubber", sheets[1].mirror((0, 0, 1))),
        Piece("upper_scale", "handle", scale.trim_by_plane((0, 0, 1), -low)),
        Piece("lower_scale", "handle", scale.trim_by_plane((0, 0, -1), -low)),
    ]


def kettlebell(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Iron ball, flat below, with a thick loop; some in a vinyl coat."""
    radius = size_cm * rng.uniform(0.3, 0.34)
    ball = shapes.sphere(radius, (0, 0, 0.92 * radius)).trim_by_plane((0, 0, 1), 0.0)
    bar, top = 0.06 * size_cm, size_cm - 0.06 * size_cm
    half = [(0.62 * radius, 1.5 * radius), (0.85 * radius, 0.5 * (top + 1.5 * radius))]
    half += [(0.6 * radius, 0.97 * top)]
    line = [*half, (0.0, top), *((-x, z) for x, z in half[::-1])]
    loop = fittings.bar([(x, 0.0, z) for x, z in line], bar, count=40)
    if rng.random() < 0.5:
        return [Piece("body", "weight", ball + loop)]
    coat = ball + shapes.cylinder(0.7 * radius, 0.0, 0.2)
    core = shapes.sphere(radius - 0.35, (0, 0, 0.92 * radius)).trim_by_plane((0, 0, 1), 0.35)
    return [Piece("body", "weight", core + loop), Piece("coat", "coat", coat)]


def bowling_pin(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Wooden pin in a plastic skin with a bore at its foot."""
    shares = [(0.15, 0.0), (0.27, 0.12), (0.31, 0.3), (0.22, 0.5), (0.12, 0.66), (0.14, 0.8)]
    shares += [(0.165, 0.88), (0.13, 0.96), (0.0, 1.0)]
    fat = 0.5 * rng.uniform(0.95, 1.05)
    line = [(max(r, 0.0) * size_cm * fat, z * size_cm) for r, z in fittings.curve(shares, 30)]
    section = shapes.outline([(0, 0), *line[:-1], (0, size_cm)])
    inner = shapes.lathe(shapes.inset(section, 0.02 * size_cm))
    bore = shapes.cylinder(0.025 * size_cm, -1.0, 0.12 * size_cm)
    return [
        Piece("wood", "wood", inner - bore),
        Piece("skin", "skin", shapes.lathe(section) - bore),
    ]


def flying_disc(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Disc to throw, hollow underneath, with a thick rim."""
    radius, rise = size_cm / 2, 0.12 * size_cm
    wall = 0.2 * rng.uniform(0.9, 1.2)
    top = [(0.0, 1.0), (0.7, 0.97), (0.95, 0.75), (1.0, 0.3), (0.985, 0.0), (0.95, 0.0)]
    line = [(r * radius, z * rise) for r, z in [*top, (0.95, 0.3)]]
    line += [(0.9 * radius, 0.72 * rise - wall), (0.7 * radius, 0.97 * rise - wall)]
    section = shapes.outline([*line, (0, rise - wall)], 0.05)
    return [Piece("body", "body", shapes.lathe(section))]


def shuttlecock(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Cork half ball in a collar, sixteen quills with vanes, two rings of thread."""
    cork, skirt = 1.3, 0.4 * size_cm
    base = fittings.ellipsoid((cork, cork, 1.4), (0, 0, 1.4)) + shapes.cylinder(cork, 1.4, 2.4)
    quill = fittings.strut((0.95, 0, 2.0), (skirt, 0, size_cm), 0.09, 0.05)
    vane = shapes.polygon([(0.2, 0.5), (1.0, 0.42), (1.0, -0.42), (0.2, -0.1)])
    slope = float(np.degrees(np.arctan2(skirt - 0.95, size_cm - 2.0)))
    sheet = shapes.upright_across(vane.scale((1.0, 1.0)).rotate(90.0).scale((0.8, 1.0)), 0.05)
    long = 0.62 * (size_cm - 2.0)
    sheet = sheet.scale((1.0, 1.0, long)).rotate((0, slope, 0))
    start = 0.36
    sheet = sheet.translate((0.95 + start * (skirt - 0.95), 0, 2.0 + start * (size_cm - 2.0)))
    at = [(0.95 + t * (skirt - 0.95), 2.0 + t * (size_cm - 2.0)) for t in (0.25, 0.4)]
    rings = shapes.union(fittings.ring(radius, 0.08, z) for radius, z in at)
    return [
        Piece("quills", "feather", shapes.around(quill + sheet, 16)),
        Piece("threads", "thread", rings),
        Piece("cork", "cork", base),
    ]


ARCHETYPES: Final = {
    "air_pump": Archetype(air_pump, "rod seal piston spring head lever barrel handle"),
    "bicycle_helmet": Archetype(bicycle_helmet, "strap buckle foam shell pad"),
    "bowling_pin": Archetype(bowling_pin, "wood skin"),
    "kettlebell": Archetype(kettlebell, "weight coat"),
    "shuttlecock": Archetype(shuttlecock, "feather thread cork"),
    "table_tennis_bat": Archetype(table_tennis_bat, "wood sponge rubber handle"),
    "flying_disc": Archetype(flying_disc, "body"),
    "shelled_ball:tennis": Archetype(
        partial(shelled_ball, wall=0.05, skin=0.04, panels=False), "core cover"
    ),
    "shelled_ball:football": Archetype(
        partial(shelled_ball, wall=0.012, skin=0.018, panels=True), "core cover"
    ),
}
