"""Kitchen tools with a handle: spoon, fork, knife, ladle, spatula, whisk, peeler."""

from __future__ import annotations

from math import pi
from typing import Final

import numpy as np
from manifold3d import CrossSection, Manifold

from xden_builder.phantoms import fittings, shapes, skins
from xden_builder.phantoms.pieces import Archetype, Piece

__all__ = ["ARCHETYPES"]


def spoon(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Spoon stamped of one sheet, its stem bowed and wider towards the end."""
    long, wide = 0.31 * size_cm, size_cm * rng.uniform(0.19, 0.23)
    thick = rng.uniform(0.14, 0.22) * size_cm / 18
    hollow, room = _bowl(long, wide, 0.24 * wide, thick)
    stem = _stem(size_cm - long, 0.018 * size_cm, size_cm * rng.uniform(0.045, 0.06), thick)
    stem = stem.translate((long - 0.3, 0.0, -thick / 2))
    solid = hollow.translate((long / 2, 0.0, 0.0)) + (stem - room.translate((long / 2, 0, 0)))
    return [Piece("body", "body", solid)]


def _bowl(long: float, wide: float, deep: float, thick: float) -> tuple[Manifold, Manifold]:
    """Shell of half an ellipsoid, open above z = 0, and the whole room of its inside."""
    room = fittings.ellipsoid((long / 2 - thick, wide / 2 - thick, deep - thick))
    outside = fittings.ellipsoid((long / 2, wide / 2, deep))
    return shapes.cut_above(outside - room, 0.0), room


def _stem(long: float, narrow: float, wide: float, thick: float) -> Manifold:
    """Bowed strip from x = 0, narrow there and wide at its round end."""
    ends = [shapes.disc(narrow), shapes.disc(wide / 2, (long - wide / 2 + 0.3, 0.0))]
    middle = shapes.disc(0.9 * narrow, (0.4 * long, 0.0))
    outline = CrossSection.batch_hull([ends[0], middle]) + CrossSection.batch_hull(
        [middle, ends[1]]
    )
    strip = Manifold.extrude(outline, thick)
    return fittings.bent(strip, lambda x: 0.06 * long * np.sin(pi * x.clip(0.0) / long), 0.7)


def fork(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Fork stamped of one sheet, with three or four tines."""
    wide, thick = size_cm * rng.uniform(0.11, 0.14), rng.uniform(0.15, 0.22)
    tines = int(rng.integers(3, 5))
    root = 0.36 * size_cm
    pad = [shapes.disc(0.35 * wide, (0.3 * size_cm, 0.0)), shapes.disc(0.12 * wide, (root, 0.0))]
    block = CrossSection.square((0.02, wide)).translate((0.0, -wide / 2))
    head = CrossSection.batch_hull([block, block.translate((0.24 * size_cm, 0.0)), pad[0]])
    head += CrossSection.batch_hull(pad)
    gap = wide / (2 * tines - 1)
    for slot in range(1, tines):
        y = (2 * slot - 0.5) * gap - wide / 2
        long = 0.2 * size_cm
        head -= CrossSection.square((long, gap)).translate((-0.1, y - gap / 2))
    grip = [shapes.disc(0.08 * wide, (root, 0)), shapes.disc(0.4 * wide, (0.97 * size_cm, 0))]
    sheet = Manifold.extrude(head + CrossSection.batch_hull(grip), thick)
    dip = 0.025 * size_cm
    return [
        Piece("body", "body", fittings.bent(sheet, lambda x: -dip * np.sin(9 * x / size_cm), 0.7))
    ]


def kitchen_knife(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Blade with a full tang between two riveted scales."""
    blade, wide = size_cm * rng.uniform(0.58, 0.64), size_cm * rng.uniform(0.09, 0.15)
    thick, grip = rng.uniform(0.18, 0.28), size_cm * rng.uniform(0.075, 0.09)
    edge = [(0.0, -0.75), (0.6, -0.72), (0.85, -0.45), (1.0, 0.15), (0.7, 0.25), (0.0, 0.25)]
    outline = shapes.polygon([(-x * blade, y * wide) for x, y in edge], 0.02 * wide)
    bevel = shapes.upright_across(
        shapes.polygon([(-wide, 0.0), (wide, thick / 2 + 0.1), (wide, -thick / 2 - 0.1)]),
        3 * size_cm,
    )
    scale = _scale(size_cm - blade, grip)
    tang = Manifold.extrude(shapes.inset(scale, 0.04), thick) + shapes.box(
        (1.2, 0.55 * grip, thick), (0.1, 0.0, thick / 2)
    )
    steel = (Manifold.extrude(outline, thick).translate((0, 0, -thick / 2)) ^ bevel) + (
        tang.translate((0, 0, -thick / 2))
    )
    cheek = shapes.slab(scale, -0.85, 0.85, 0.35)
    end = size_cm - blade
    rivets = shapes.union(
        shapes.cylinder(0.24, -0.84, 0.84).translate((x * end, 0, 0)) for x in (0.22, 0.5, 0.78)
    )
    return [
        Piece("rivets", "rivet", rivets),
        Piece("blade", "blade", steel),
        Piece("upper_scale", "handle", cheek.trim_by_plane((0, 0, 1), 0.0)),
        Piece("lower_scale", "handle", cheek.trim_by_plane((0, 0, -1), 0.0)),
    ]


def _scale(long: float, wide: float) -> CrossSection:
    """Outline of a grip from x = 0.3."""
    ends = (
        shapes.disc(0.45 * wide, (0.3 + 0.45 * wide, 0)),
        shapes.disc(wide / 2, (long - wide, 0)),
    )
    return CrossSection.batch_hull(list(ends))


def ladle(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Deep round bowl on a long stem with a hook or a grip at its end."""
    radius, thick = size_cm * rng.uniform(0.13, 0.16), 0.12 * rng.uniform(0.9, 1.3)
    hollow, room = _bowl(2 * radius, 2 * radius, 0.85 * radius, thick)
    end = size_cm - radius
    line = [
        (0.9 * radius, 0, -0.35 * radius),
        (1.15 * radius, 0.0, 0.3),
        (0.5 * end, 0, 0.07 * size_cm),
    ]
    line += [(end - 0.04 * size_cm, 0.0, 0.075 * size_cm)]
    if rng.random() < 0.5:
        hook = [(end, 0, 0.06 * size_cm), (end - 0.02 * size_cm, 0, 0.03 * size_cm)]
        steel = hollow + (fittings.bar([*line, *hook], thick, 0.35, 44) - room)
        return [Piece("body", "body", steel)]
    steel = hollow + (fittings.bar(line, thick, 0.35, 40) - room)
    handle = fittings.grip(0.55 * end, end, 0.55, 0.95).translate((0, 0, 0.073 * size_cm))
    return [Piece("body", "body", steel), Piece("handle", "handle", handle)]


def spatula(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Slotted turner whose stem ends inside the handle."""
    wide, long = size_cm * rng.uniform(0.2, 0.26), 0.3 * size_cm
    thick = rng.uniform(0.12, 0.2)
    front = CrossSection.square((0.3, wide)).translate((0.0, -wide / 2))
    back = shapes.disc(0.3 * wide, (long - 0.3 * wide, 0.0))
    plate = CrossSection.batch_hull([front, back])
    slots = int(rng.integers(3, 6))
    for i in range(slots):
        y = (i + 0.5) / slots * 0.8 * wide - 0.4 * wide
        plate -= shapes.rounded_rectangle(0.5 * long, 0.4 * wide / slots, 0.1).translate(
            (0.45 * long, y)
        )
    blade = Manifold.extrude(plate, thick)
    rise, grip = 0.06 * size_cm, 0.62 * size_cm
    line = [(0.9 * long, 0, thick), (1.15 * long, 0, 0.5 * rise), (1.5 * long, 0, rise)]
    stem = fittings.bar([*line, (grip + 0.6 * (size_cm - grip), 0, rise)], 0.2, 0.4)
    stem = stem.trim_by_plane((0, 0, 1), 0.02)
    handle = fittings.grip(grip, size_cm, 0.8, 1.2).translate((0, 0, rise))
    hole = shapes.cylinder(0.4, -5.0, 9.0).translate((size_cm - 1.4, 0, 0))
    return [
        Piece("blade", "blade", blade + stem),
        Piece("handle", "handle", handle - hole),
    ]


def whisk(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Loops of wire held in a handle."""
    grip, wire = 0.42 * size_cm, rng.uniform(0.08, 0.12)
    bulge = size_cm * rng.uniform(0.1, 0.14)
    loops = []
    count = int(rng.integers(3, 6))
    for i in range(count):
        shrink = 1.0 - 0.035 * i  # each loop lies inside the last, so that wires cross unmet
        half = [(0.24, 0.9 * grip), (0.28, 1.02 * grip), (0.75 * bulge * shrink, 0.66 * size_cm)]
        half += [(bulge * shrink, 0.84 * size_cm), (0.6 * bulge * shrink, 0.97 * size_cm * shrink)]
        top = [(0.0, (size_cm - wire) * shrink)]
        points = [*half, *top, *((-x, z) for x, z in half[::-1])]
        loop = fittings.bar([(x, 0.0, z) for x, z in points], wire, count=60)
        loops.append(loop.rotate((0.0, 0.0, 180.0 * i / count)))
    handle = fittings.grip(0.0, grip, 1.1, 1.1)
    plug = shapes.cylinder(0.4, 0.7 * grip, 0.97 * grip)
    return [
        Piece("wires", "wire", shapes.along_x(shapes.union([plug, *loops]))),
        Piece("handle", "handle", handle),
    ]


def peeler(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Y-shaped peeler: a bow on a handle, a slotted blade between its arms."""
    span, bow = size_cm * rng.uniform(0.4, 0.48), 0.035 * size_cm
    fork_x = 0.62 * size_cm
    half = [(0.1 * size_cm, 0.5 * span, 0), (0.35 * size_cm, 0.42 * span, 0)]
    back = [(x, -y, z) for x, y, z in half[::-1]]
    arms = fittings.bar([*half, (fork_x, 0, 0), *back], bow, 0.7 * bow, 40)
    handle = fittings.grip(0.55 * size_cm, size_cm, 0.05 * size_cm, 0.07 * size_cm)
    edge = shapes.slab(shapes.rounded_rectangle(1.2, span - 0.4, 0.1), -0.06, 0.06)
    slot = shapes.box((0.18, 0.7 * span, 1.0))
    pin = shapes.along_y(shapes.cylinder(0.1, -span / 2, span / 2))
    blade = ((edge - slot) + pin).translate((0.11 * size_cm + 0.1, 0.0, 0.0))
    core = skins.loft([(0.0, 0.1, 0.25), (0.3 * size_cm, 0.1, 0.25)])
    core = shapes.along_x(core).translate((0.62 * size_cm, 0.0, 0.0))
    return [
        Piece("blade", "blade", blade),
        Piece("core", "blade", core),
        Piece("handle", "handle", arms + handle),
    ]


ARCHETYPES: Final = {
    "fork": Archetype(fork, "body"),
    "kitchen_knife": Archetype(kitchen_knife, "rivet blade handle"),
    "ladle": Archetype(ladle, "body handle"),
    "peeler": Archetype(peeler, "blade handle"),
    "spatula": Archetype(spatula, "blade handle"),
    "spoon": Archetype(spoon, "body"),
    "whisk": Archetype(whisk, "wire handle"),
}
