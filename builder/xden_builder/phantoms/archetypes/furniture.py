"""Small furniture: stool, step stool, side table, table lamp, picture frame, clock, drawers."""

from __future__ import annotations

from math import pi
from typing import Final

import numpy as np
from manifold3d import CrossSection, Manifold

from xden_builder.phantoms import fittings, shapes
from xden_builder.phantoms.pieces import Archetype, Piece, moved

__all__ = ["ARCHETYPES"]


# --- to sit and to stand on -----------------------------------------------------------------------


def stool(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Three or four splayed legs, turned or of tube, in a round seat; rungs, feet, upholstery."""
    count, radius = int(rng.integers(3, 5)), size_cm * rng.uniform(0.3, 0.36)
    padded, tubular = rng.random() < 0.5, rng.random() < 0.4
    thick = rng.uniform(2.0, 2.8)
    top = size_cm - (4.0 if padded else 0.0)
    bar = rng.uniform(1.0, 1.3) if tubular else rng.uniform(1.5, 2.0)
    foot, head = (0.9 * radius, 0.0, 0.9 * bar), (0.62 * radius, 0.0, top - 0.4 * thick)
    leg = fittings.strut(foot, head, 0.75 * bar, bar)
    if tubular:
        leg -= fittings.strut(foot, head, 0.75 * bar - 0.15, bar - 0.15)
    shoe = shapes.slab(shapes.disc(1.1 * bar, (foot[0], 0.0)), 0.0, 1.2 * bar, 0.2 * bar)
    share = rng.uniform(0.3, 0.5)
    ends = [start + share * (end - start) for start, end in zip(foot, head, strict=True)]
    turn = 2 * pi / count
    rung = fittings.strut(
        (ends[0], 0.0, ends[2]), (ends[0] * np.cos(turn), ends[0] * np.sin(turn), ends[2]), 0.55
    )
    room = fittings.strut(foot, head, 0.75 * bar - 0.2, bar - 0.2)  # rungs end in a tube's wall
    rungs = shapes.around(rung, count) - shapes.around(room, count)
    seat = shapes.slab(shapes.disc(radius), top - thick, top, 0.35 * thick)
    legs = [
        Piece(f"leg_{i + 1}", "tube" if tubular else "leg", leg.rotate((0, 0, 360 * i / count)))
        for i in range(count)
    ]
    return [
        *legs,
        Piece("rungs", "rung", rungs),
        Piece("shoes", "foot", shapes.around(shoe, count)),
        Piece("seat", "seat", seat),
        *(_upholstery(radius, top) if padded else []),
    ]


def _upholstery(radius: float, top: float) -> list[Piece]:
    """Block of foam on the seat, in a cover that is drawn down around the rim."""
    outside = shapes.slab(shapes.disc(radius + 0.25), top - 1.0, top + 4.0, 1.2)
    foam = shapes.slab(shapes.disc(radius), top, top + 3.8, 1.1)
    block = shapes.cylinder(radius, top - 2.0, top)
    return [Piece("foam", "foam", foam), Piece("cover", "cover", outside - foam - block)]


def step_stool(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Two treads on stepped side panels, a rail at the back, screws and mats that grip."""
    wide, deep, high = size_cm, size_cm * rng.uniform(0.8, 0.9), size_cm * rng.uniform(0.82, 0.95)
    board, middle = rng.uniform(1.5, 2.1), 0.5 * high
    side = [(0, 0), (deep, 0), (0.94 * deep, high), (0.44 * deep, high), (0.44 * deep, middle)]
    arch = shapes.disc(0.26 * deep, (0.52 * deep, 0.0)).scale((1.0, 0.8))
    panel = shapes.upright(shapes.polygon([*side, (0.06 * deep, middle)]) - arch, board)
    inner = 0.46 * wide - board / 2
    treads = [
        shapes.rounded_box((0.5 * deep, wide, board), 0.3, (x * deep, 0, z + board / 2))
        for x, z in ((0.26, middle), (0.7, high))
    ]
    treads[0] = treads[0].trim_by_plane((-1, 0, 0), -0.44 * deep)  # before the risers
    rail = shapes.box((board, 2 * inner, 0.16 * high), (0.86 * deep, 0, 0.7 * high))
    mats = [
        shapes.slab(shapes.rounded_rectangle(0.3 * deep, 0.8 * wide, 0.6), z, z + 0.25).translate(
            (x * deep, 0, board)
        )
        for x, z in ((0.24, middle), (0.7, high))
    ]
    screw = shapes.cylinder(0.22, -3.2, board - 0.25)
    screw += shapes.cylinder(0.22, board - 0.65, board - 0.25, 0.45)
    screws = shapes.union(
        screw.translate((x * deep, y * (inner + board / 2), z))
        for x, z in ((0.12, middle), (0.36, middle), (0.55, high), (0.85, high))
        for y in (-1, 1)
    )
    shift = inner + board / 2
    return [
        Piece("screws", "screw", screws),
        Piece("left_side", "side", panel.translate((0, shift, 0))),
        Piece("right_side", "side", panel.translate((0, -shift, 0))),
        Piece("rail", "side", rail),
        Piece("lower_tread", "tread", treads[0]),
        Piece("upper_tread", "tread", treads[1]),
        Piece("mats", "mat", shapes.union(mats)),
    ]


def side_table(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Hollow board on frame over cardboard comb, on four legs held by bolts; some have a shelf."""
    wide, deep = size_cm * rng.uniform(0.8, 0.95), size_cm * rng.uniform(0.65, 0.8)
    thick, leg = rng.uniform(3.0, 4.5), size_cm * rng.uniform(0.07, 0.09)
    skin, rail, low = 0.35, 1.2 * leg, size_cm - thick
    board = shapes.slab(shapes.rounded_rectangle(wide, deep, 0.4), low, size_cm)
    room = shapes.box(
        (wide - 2 * rail, deep - 2 * rail, thick - 2 * skin), (0, 0, size_cm - thick / 2)
    )
    corner = shapes.box((2.6 * leg, 2.6 * leg, thick - 2 * skin))  # blocks that hold the bolts
    spots = [(x * (wide - leg) / 2, y * (deep - leg) / 2, 0.0) for x in (-1, 1) for y in (-1, 1)]
    blocks = shapes.union(corner.translate((x, y, size_cm - thick / 2)) for x, y, _ in spots)
    hollow = room - blocks
    post = shapes.slab(shapes.rounded_rectangle(leg, leg, 0.2), 0.0, low)
    wall = 0.22 * leg
    post -= shapes.box((leg - 2 * wall, leg - 2 * wall, low - 6.0), (0, 0, 1.0 + (low - 6.0) / 2))
    bolt = shapes.thread(0.4, 0.32, 0.3, low - 4.0, low + 0.7 * thick)
    pieces = [Piece("bolts", "bolt", shapes.union(bolt.translate(spot) for spot in spots))]
    pieces += [Piece(f"leg_{i + 1}", "leg", post.translate(at)) for i, at in enumerate(spots)]
    if rng.random() < 0.5:
        z = size_cm * rng.uniform(0.25, 0.4)
        shelf = shapes.box((wide - leg, deep - leg, 1.5), (0, 0, z))
        pieces.append(Piece("shelf", "shelf", shelf))
    comb = _comb(wide, deep, 3.5) ^ hollow
    return [*pieces, Piece("comb", "comb", comb), Piece("top", "top", board - hollow)]


def _comb(wide: float, deep: float, pitch: float) -> Manifold:
    """Upright strips that cross, as they keep the faces of a hollow board apart."""
    half = (int(wide / pitch / 2), int(deep / pitch / 2))
    along = (
        shapes.box((wide, 0.08, 200.0), (0, i * pitch, 0)) for i in range(-half[1], half[1] + 1)
    )
    across = (
        shapes.box((0.08, deep, 200.0), (i * pitch, 0, 0)) for i in range(-half[0], half[0] + 1)
    )
    return shapes.union([*along, *across])


# --- to light, to look at -------------------------------------------------------------------------


def table_lamp(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Weighted foot, a tube with its cable, a socket with a lamp, and a shade on a wire ring."""
    foot, high = size_cm * rng.uniform(0.2, 0.25), size_cm * rng.uniform(0.05, 0.09)
    shade, top = size_cm * rng.uniform(0.24, 0.3), rng.uniform(0.55, 0.8)
    low, tip = size_cm * rng.uniform(0.55, 0.6), 0.68 * size_cm
    wall, stem = 0.25, max(0.5, 0.016 * size_cm)
    line = shapes.outline([(0, 0), (foot, 0), (foot, 0.5 * high), (2 * stem, high), (0, high)], 0.3)
    room = shapes.lathe(shapes.inset(line, wall))
    weight = shapes.cut_above(room, 0.62 * high) - shapes.cylinder(1.5 * stem, -1.0, size_cm)
    tube = shapes.tube(stem, stem - 0.12, wall, tip - 4.0)
    cord = fittings.bar([(0, 0, tip - 4.2), (0, 0, 0.5 * tip), (0, 0, 0.76 * high)], 0.26)
    tail = [(0, 0, 0.76 * high), (0.4 * foot, 0, 0.72 * high), (foot + 2.0, 0, 0.3)]
    cable = cord + fittings.bar(tail, 0.26) + shapes.sphere(0.26, (0, 0, 0.76 * high))
    socket = shapes.tube(2.0, 1.5, tip - 4.5, tip) + shapes.tube(2.0, stem, tip - 4.5, tip - 4.0)
    lip = shapes.tube(2.4, 2.0, tip - 2.0, tip - 1.6)
    wire = shapes.around(
        fittings.strut(
            (1.9, 0, tip - 1.8), (shade * _at(low, tip - 1.8, size_cm, top), 0, tip - 1.8), 0.12
        ),
        3,
    )
    cone = shapes.cylinder(shade, low, size_cm, top * shade)
    cone -= shapes.cylinder(shade - 0.15, low - 1e-3, size_cm + 1e-3, top * shade - 0.15)
    return [
        Piece("weight", "weight", weight),
        Piece("cable", "cable", cable),
        Piece("stem", "stem", tube),
        *_lamp(tip),
        Piece("socket", "socket", socket + lip),
        Piece("foot", "shell", shapes.lathe(line) - room),
        Piece("ring", "wire", wire),
        Piece("shade", "shade", cone),
    ]


def _at(low: float, z: float, high: float, top: float) -> float:
    """Share of its lower radius that a shade has at a height."""
    return 1.0 + (top - 1.0) * (z - low) / (high - low)


def _lamp(tip: float) -> list[Piece]:
    """Cap in a socket that ends at ``tip``, a board with diodes, a globe."""
    cap = shapes.thread(1.5, 1.38, 0.36, tip - 3.4, tip) - shapes.cylinder(1.2, tip - 3.2, tip + 9)
    globe = fittings.ellipsoid((2.9, 2.9, 3.6), (0, 0, tip + 3.2)) + shapes.cylinder(
        1.6, tip, tip + 1.0, 2.2
    )
    globe = globe.trim_by_plane((0, 0, 1), tip)
    room = fittings.ellipsoid((2.75, 2.75, 3.45), (0, 0, tip + 3.2))
    plate = shapes.cylinder(2.16, tip + 1.0, tip + 1.2)
    driver = shapes.box((1.4, 0.16, 4.0), (0, 0, tip - 1.0))
    led = shapes.box((0.3, 0.3, 0.1), (1.2, 0, tip + 1.25))
    return [
        Piece("cap", "cap", cap),
        Piece("driver", "board", driver),
        Piece("plate", "board", plate),
        Piece("leds", "chip", shapes.around(led, 8)),
        Piece("globe", "globe", globe - room - shapes.cylinder(1.2, tip - 1.0, tip + 1.1)),
    ]


def picture_frame(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Frame that leans on an easel: glass, mount, print and back in its rebate, held by points."""
    wide, bar = size_cm * rng.uniform(0.7, 0.82), size_cm * rng.uniform(0.06, 0.09)
    deep, rebate, depth = rng.uniform(1.6, 2.4), 0.5, 0.5
    inside = (wide - 2 * bar + 2 * rebate, size_cm - 2 * bar + 2 * rebate)
    sheet = CrossSection.square(inside, center=True)
    window = CrossSection.square((0.66 * inside[0], 0.66 * inside[1]), center=True)
    pieces = []
    for name, thick in (("glass", 0.2), ("mount", 0.15), ("print", 0.03), ("back", 0.3)):
        section = sheet - window if name == "mount" else sheet
        pieces.append(Piece(name, name, shapes.slab(section, -depth - thick, -depth)))
        depth += thick
    point = shapes.box((0.8, 1.2, 0.08), (inside[0] / 2, 0.3 * size_cm, -depth - 0.04))
    points = point + point.mirror((0, 1, 0))
    hinge = shapes.box((0.2 * wide, 1.0, 0.1), (0, 0.16 * size_cm, -depth - 0.05))
    half = [(-0.08 * wide, 0.0), (-0.14 * wide, -0.66 * size_cm)]
    prop = shapes.polygon([*half, *((-x, y) for x, y in reversed(half))])
    easel = shapes.slab(prop, -0.3, 0.0).rotate((18, 0, 0))
    pieces += [
        Piece("points", "point", points + points.mirror((1, 0, 0))),
        Piece("hinge", "hinge", hinge),
        Piece("easel", "back", easel.translate((0, 0.16 * size_cm, -depth - 0.1))),
        Piece("frame", "frame", _bars(wide, size_cm, bar, deep) - shapes.slab(sheet, -9.0, -0.5)),
    ]
    return moved(pieces, lambda solid: solid.rotate((90 - 8, 0, 0)))


def _bars(wide: float, high: float, bar: float, deep: float) -> Manifold:
    """Four bars around a picture, bevelled towards it."""
    outer = CrossSection.square((wide, high), center=True)
    sight = CrossSection.square((wide - 2 * bar, high - 2 * bar), center=True)
    flare = ((wide - 0.7 * bar) / (wide - 2 * bar), (high - 0.7 * bar) / (high - 2 * bar))
    bevel = Manifold.extrude(sight, 0.35, 0, 0.0, flare).translate((0, 0, -0.35))
    return shapes.slab(outer, -deep, 0.0) - shapes.slab(sight, -deep, 0.0) - bevel


def wall_clock(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Ring with a glass over a dial, three hands on a spindle, quartz works with a cell behind."""
    radius, deep = size_cm / 2, rng.uniform(3.6, 4.6)
    lip, level = 0.1 * radius, deep - 1.3
    side = [(radius - 0.3, 0.0), (radius, 0.5), (radius, deep - 0.6), (radius - 0.5 * lip, deep)]
    side += [(radius - lip, deep - 0.3), (radius - lip, level), (radius - 0.3, level)]
    case = shapes.lathe(shapes.polygon(side)) + shapes.tube(
        radius - 0.3, 0.86 * radius, 0.0, 0.0 + 0.3
    )
    dial = shapes.cylinder(radius - 0.3, level - 0.15, level)
    glass = shapes.cylinder(radius - 0.8 * lip, deep - 0.65, deep - 0.4)
    mark = shapes.box((0.14 * radius, 0.035 * radius, 0.08), (0.74 * radius, 0, level + 0.04))
    hands = _hands(radius, level + 0.1, rng.uniform(0.0, 12.0))
    works, inside = fittings.case(
        shapes.rounded_rectangle(5.6, 5.6, 0.4), level - 1.75, level - 0.15, 0.18
    )
    spindle = shapes.cylinder(0.2, level - 0.9, level + 0.62)
    cell = fittings.cell(0.7, -2.3, 2.3).rotate((0, 90, 0)).translate((0, -1.8, level - 0.95))
    wheel = shapes.cylinder(1.0, level - 0.6, level - 0.45) + shapes.tube(
        0.7, 0.2, level - 0.45, level - 0.33
    )
    coil = shapes.along_x(shapes.tube(0.45, 0.15, -0.8, 0.8)).translate((-0.4, 1.9, level - 1.1))
    core = shapes.along_x(shapes.cylinder(0.15, -1.3, 1.3)).translate((-0.4, 1.9, level - 1.1))
    return [
        Piece("spindle", "spindle", spindle),
        Piece("core", "core", core),
        Piece("coil", "coil", coil),
        Piece("cell", "cell", cell ^ inside),
        Piece("wheel", "wheel", wheel),
        Piece("hands", "hand", hands),
        Piece("marks", "hand", shapes.around(mark, 12)),
        Piece("dial", "dial", dial),
        Piece("glass", "glass", glass),
        Piece("works", "works", works + _rest(level)),
        Piece("case", "shell", case - shapes.cylinder(radius - 0.3, level - 0.15, level)),
    ]


def _rest(level: float) -> Manifold:
    """Ribs in the works that carry the coil's core and the cell."""
    core = shapes.box((0.2, 0.4, 0.8), (-1.5, 1.9, level - 1.2))
    return core + core.translate((2.2, 0, 0)) + shapes.box((0.3, 0.3, 0.6), (0, -1.8, level - 1.4))


def _hands(radius: float, z: float, hour: float) -> Manifold:
    """Hour, minute and second hand, one above the other on the spindle."""
    solids = []
    for i, (reach, wide, turns) in enumerate(
        ((0.45, 0.05, hour / 12), (0.68, 0.035, hour % 1), (0.72, 0.012, (60 * hour) % 1))
    ):
        blade = shapes.box(
            (1.15 * reach * radius, wide * radius, 0.06), (0.42 * reach * radius, 0, 0)
        )
        hub = shapes.tube(0.4, 0.2, -0.07, 0.07)
        solids.append(
            (blade + hub).rotate((0, 0, -360 * turns)).translate((0, 0, z + 0.07 + 0.14 * i))
        )
    return shapes.union(solids)


def drawer_box(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Small chest: carcass with a thin back, drawers with knobs, and what is kept in them."""
    count, board = int(rng.integers(2, 4)), rng.uniform(0.7, 1.1)
    wide, high, deep = size_cm, size_cm * rng.uniform(0.62, 0.8), size_cm * rng.uniform(0.55, 0.7)
    outside = shapes.box((deep, wide, high), (0, 0, high / 2))
    pitch = (high - board) / count
    bay = (deep, wide - 2 * board, pitch - board)
    bays = [(0.4, 0.0, board + i * pitch + bay[2] / 2) for i in range(count)]
    carcass = outside - shapes.union(shapes.box(bay, at) for at in bays)
    back = shapes.box((0.4, wide - 0.6, high - 0.6), (0.2 - deep / 2, 0, high / 2))
    pieces = []
    for i, at in enumerate(bays):
        shut = float(rng.uniform(0.0, 0.22) * deep) if i == count - 1 else 0.0
        pieces += _drawer(rng, str(i + 1), bay, (at[0] + shut, 0.0, at[2] - bay[2] / 2))
    return [
        *pieces,
        Piece("back", "back", back),
        Piece("carcass", "carcass", carcass),
    ]


def _drawer(
    rng: np.random.Generator, name: str, bay: fittings.Point, at: fittings.Point
) -> list[Piece]:
    """Tray that slides on the floor of its bay, its front flush, with a knob and a load."""
    long, wide, high = bay[0] - 0.8, bay[1] - 0.3, bay[2] - 0.3
    front = bay[0] / 2 - 0.4
    tray = shapes.box((long, wide, high), (front - long / 2, 0, high / 2))
    tray -= shapes.box((long - 1.6, wide - 1.0, high), (front - long / 2, 0, high / 2 + 0.4))
    knob = shapes.slab(shapes.disc(0.9), 0.9, 2.2, 0.3) + shapes.cylinder(0.5, 0.0, 1.0)
    screw = shapes.cylinder(0.2, -0.8, 1.6) + shapes.cylinder(0.4, -1.0, -0.8)
    knob, screw = (
        shapes.along_x(solid).translate((front, 0, 0.5 * high)) for solid in (knob, screw)
    )
    size = (rng.uniform(0.3, 0.8) * (long - 2.0), rng.uniform(0.2, 0.8) * (wide - 1.4))
    load = shapes.box((*size, rng.uniform(0.2, 0.8) * (high - 0.6)))
    load = load.translate((front - long / 2, 0, 0.4 + load.bounding_box()[5]))
    solids = {"screw": screw, "knob": knob, "load": load, "drawer": tray}
    return [Piece(f"{role}_{name}", role, solid.translate(at)) for role, solid in solids.items()]


ARCHETYPES: Final = {
    "drawer_box": Archetype(drawer_box, "screw knob load drawer back carcass"),
    "picture_frame": Archetype(picture_frame, "glass mount print back point hinge frame"),
    "side_table": Archetype(side_table, "bolt leg shelf comb top"),
    "step_stool": Archetype(step_stool, "screw side tread mat"),
    "stool": Archetype(stool, "leg tube rung foot seat foam cover"),
    "table_lamp": Archetype(
        table_lamp, "weight cable stem cap board chip globe socket shell wire shade"
    ),
    "wall_clock": Archetype(wall_clock, "spindle core coil cell wheel hand dial glass works shell"),
}
