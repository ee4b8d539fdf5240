"""Toys with insides: car, train, bricks, puzzle cube, stacking rings, yo-yo."""

from __future__ import annotations

from typing import Final

import numpy as np
from manifold3d import Manifold

from xden_builder.phantoms import fittings, shapes, skins
from xden_builder.phantoms.pieces import Archetype, Piece

__all__ = ["ARCHETYPES"]


# --- on wheels ------------------------------------------------------------------------------------


def toy_car(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Shell with windows on a floor; tyred wheels on axles, a motor that drives the rear one."""
    wheel, wide = size_cm * rng.uniform(0.1, 0.12), size_cm * rng.uniform(0.4, 0.46)
    high, wall = size_cm * rng.uniform(0.28, 0.33), 0.05 + 0.01 * size_cm
    side = [(-0.5, 0.12), (-0.5, 0.55), (-0.42, 0.62), (-0.3, 1.0), (0.02, 1.0), (0.2, 0.6)]
    side += [(0.47, 0.5), (0.5, 0.3), (0.5, 0.12)]
    line = shapes.polygon([(x * size_cm, z * high) for x, z in side], 0.05 * high)
    body = shapes.upright(line, wide) - shapes.upright(shapes.inset(line, wall), wide - 2 * wall)
    body = body.trim_by_plane((0, 0, 1), 0.2 * high)
    sill = 0.64 * high
    panes = [(-0.37, sill), (-0.27, 0.92 * high), (-0.01, 0.92 * high), (0.14, sill)]
    pane = shapes.upright(
        shapes.polygon([(x * size_cm, z) for x, z in panes], 0.02 * high), 2 * wide
    )
    screens = shapes.box((size_cm, 0.8 * wide, 0.28 * high), (-0.1 * size_cm, 0, 0.78 * high))
    axles = [(-0.29 * size_cm, wheel), (0.29 * size_cm, wheel)]
    rod = shapes.along_y(shapes.cylinder(0.14 * wheel, -0.5 * wide, 0.5 * wide))
    arch = shapes.along_y(shapes.cylinder(1.2 * wheel, -wide, wide))
    arches = shapes.union(arch.translate((x, 0, z)) for x, z in axles)
    floor = shapes.box((0.96 * size_cm, wide - 2 * wall, 0.12 * high), (0, 0, 0.26 * high))
    struts = shapes.union(
        shapes.box((0.5 * wheel, 0.36 * wide, wheel), (x, 0, 0.26 * high)) for x, _ in axles
    )
    pieces = [
        Piece(f"axle_{i + 1}", "axle", rod.translate((x, 0, z))) for i, (x, z) in enumerate(axles)
    ]
    for i, (x, y) in enumerate((x, y) for x, _ in axles for y in (-1, 1)):
        pieces += _wheel(str(i + 1), wheel, 0.12 * wide, (x, y * 0.43 * wide, wheel))
    pieces += _drive(size_cm, wheel, axles[0], 0.32 * high)
    wells = arches - shapes.box((size_cm, 0.72 * wide, size_cm))
    return [
        *pieces,
        Piece(
            "windows",
            "window",
            body
            ^ (pane + screens)
            ^ shapes.box((0.52 * size_cm, 9 * wide, 9 * high), (-0.11 * size_cm, 0, 0)),
        ),
        Piece("floor", "floor", floor - wells + struts),
        Piece("body", "shell", body - wells),
    ]


def _wheel(name: str, radius: float, half: float, at: fittings.Point) -> list[Piece]:
    """Dished hub in a grooved tyre, across y."""
    hub = shapes.cylinder(0.62 * radius, -half, half) - shapes.tube(
        0.5 * radius, 0.25 * radius, 0.3 * half, 2 * half
    )
    tyre = shapes.slab(shapes.disc(radius), -half, half, 0.2 * radius)
    tyre -= shapes.tube(2 * radius, 0.93 * radius, -0.15 * half, 0.15 * half)
    turned = [shapes.along_y(solid).translate(at) for solid in (hub, tyre)]
    return [Piece(f"hub_{name}", "hub", turned[0]), Piece(f"tyre_{name}", "tyre", turned[1])]


def _drive(size: float, wheel: float, axle: tuple[float, float], z: float) -> list[Piece]:
    """Gear on the axle and a motor on the floor; two cells where there is room, else a spring."""
    gear = shapes.along_y(shapes.cylinder(0.55 * wheel, 0.03 * size, 0.06 * size))
    block = (0.16 * size, 0.16 * size, 0.1 * size)
    x = axle[0] + 0.6 * wheel + block[0] / 2
    motor = shapes.rounded_box(block, 0.02 * size, (x, -0.02 * size, z + block[2] / 2))
    pieces = [Piece("gear", "gear", gear.translate((axle[0], 0, axle[1])))]
    if size < 15.0:
        coil = skins.spring(0.4 * block[2], 0.004 * size + 0.02, -0.06 * size, 0.06 * size, 6.0)
        inside = shapes.cylinder(0.4 * block[2], -0.06 * size, 0.06 * size)
        place = (x, -0.02 * size, z + block[2] / 2)
        coil, inside = (shapes.along_y(solid).translate(place) for solid in (coil, inside))
        return [*pieces, Piece("spring", "spring", coil), Piece("motor", "case", motor - inside)]
    radius, long = 0.52, 4.4
    cell = shapes.along_x(fittings.cell(radius, 0.0, long))
    start = (x + block[0] / 2 + 0.2, radius + 0.02, z + radius)
    cells = [cell.translate(start), cell.translate((start[0], -start[1], start[2]))]
    return [
        *pieces,
        Piece("motor", "motor", motor),
        *(Piece(f"cell_{i + 1}", "cell", solid) for i, solid in enumerate(cells)),
    ]


def toy_train(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Wooden engine: boiler, cab and funnel doweled on a bed, wheels on pins, magnets to couple."""
    wide, wheel = size_cm * rng.uniform(0.3, 0.36), size_cm * rng.uniform(0.1, 0.12)
    count, low, thick = int(rng.integers(2, 4)), 1.35 * wheel, 0.09 * size_cm
    bed = shapes.rounded_box((0.92 * size_cm, wide, thick), 0.1 * thick, (0, 0, low + thick / 2))
    spots = [(float(x), 0.0, 0.0) for x in np.linspace(-0.3, 0.3, count) * size_cm]
    disc = shapes.along_y(shapes.slab(shapes.disc(wheel), 0.0, 0.08 * size_cm, 0.15 * wheel))
    disc = disc.translate((0, 0.36 * wide, wheel))
    pair = disc + disc.mirror((0, 1, 0))
    rod = shapes.along_y(shapes.cylinder(0.12 * wheel, -0.5 * wide, 0.5 * wide))
    rod = rod.translate((0, 0, wheel))
    block = shapes.box((0.9 * wheel, 0.7 * wide, low - 0.6 * wheel), (0, 0, low / 2 + 0.3 * wheel))
    above = _engine(size_cm, wide, low + thick)
    return [
        *_couplings(size_cm, low + thick / 2),
        *above[:1],
        *(Piece(f"axle_{i + 1}", "nail", rod.translate(at)) for i, at in enumerate(spots)),
        Piece("wheels", "wheel", shapes.union(pair.translate(at) for at in spots)),
        *above[1:],
        Piece("bed", "bed", bed + shapes.union(block.translate(at) for at in spots)),
    ]


def _couplings(size: float, z: float) -> list[Piece]:
    """Magnet in front and behind, each nailed to the bed."""
    nail = shapes.along_x(shapes.cylinder(0.008 * size, 0.4 * size, 0.488 * size))
    magnet = shapes.along_x(shapes.cylinder(0.035 * size, 0.46 * size, 0.49 * size))
    ends = [
        (role, solid.translate((0, 0, z))) for role, solid in (("nail", nail), ("magnet", magnet))
    ]
    return [
        Piece(f"{role}_{side}", role, solid.rotate((0, 0, turn)))
        for side, turn in (("front", 0.0), ("rear", 180.0))
        for role, solid in ends
    ]


def _engine(size: float, wide: float, floor: float) -> list[Piece]:
    """Give what stands on the bed: dowels, funnel and dome, boiler, cab, roof."""
    boiler = 0.38 * wide
    top = floor + 1.85 * boiler
    drum = shapes.slab(shapes.disc(boiler), -0.1 * size, 0.42 * size, 0.2 * boiler)
    drum = shapes.along_x(drum).translate((0, 0, floor + 0.85 * boiler))
    cab = shapes.box((0.3 * size, 0.86 * wide, 0.36 * size), (-0.27 * size, 0, floor + 0.18 * size))
    cab -= shapes.box((0.2 * size, 2 * wide, 0.15 * size), (-0.28 * size, 0, floor + 0.24 * size))
    at = (-0.27 * size, 0, floor + 0.388 * size)
    roof = shapes.rounded_box((0.4 * size, wide, 0.06 * size), 0.02 * size, at)
    funnel = shapes.cylinder(0.04 * size, top - 0.6 * boiler, top)
    funnel += shapes.cylinder(0.045 * size, top - 0.02 * size, top + 0.12 * size, 0.07 * size)
    dome = shapes.sphere(0.06 * size, (0.1 * size, 0, top))
    dowel = shapes.cylinder(0.02 * size, floor - 0.06 * size, floor + 0.6 * boiler)
    return [
        Piece(
            "dowels", "dowel", shapes.union(dowel.translate((x * size, 0, 0)) for x in (-0.2, 0.25))
        ),
        Piece("funnel", "trim", funnel.translate((0.32 * size, 0, 0)) + dome),
        Piece("boiler", "boiler", drum.trim_by_plane((0, 0, 1), floor)),
        Piece("cab", "cab", cab),
        Piece("roof", "trim", roof),
    ]


# --- to build, to solve ---------------------------------------------------------------------------


def building_brick(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """One to three hollow bricks pressed onto each other: studs above, tubes below."""
    studs, count = int(rng.integers(2, 5)), int(rng.integers(1, 4))
    pitch = size_cm / (studs + (0.0 if count == 1 else 1.0))
    brick = _brick(studs, pitch)
    shifts = [0.0, *rng.choice([-1.0, 0.0, 1.0], count - 1)]
    return [
        Piece(
            f"brick_{i + 1}",
            "brick_even" if i % 2 else "brick_odd",
            brick.translate((0.5 * shift * pitch * (studs > 1), 0, 1.2 * i * pitch)),
        )
        for i, shift in enumerate(shifts)
    ]


def _brick(studs: int, pitch: float) -> Manifold:
    """Two rows of studs; proportions of the common 8 mm grid."""
    long, wide, high, wall = studs * pitch, 2 * pitch, 1.2 * pitch, 0.18 * pitch
    gap = 0.02 * pitch
    body = shapes.box((long - gap, wide - gap, high), (0, 0, high / 2))
    body -= shapes.box((long - 2 * wall, wide - 2 * wall, high), (0, 0, high / 2 - 0.15 * pitch))
    stud = shapes.cylinder(0.3 * pitch, high - 0.05 * pitch, high + 0.21 * pitch)
    stud -= shapes.cylinder(0.16 * pitch, 0.0, high + 0.06 * pitch)
    tube = shapes.tube(0.407 * pitch, 0.3 * pitch, 0.0, high - 0.1 * pitch)
    columns = (np.arange(studs) - (studs - 1) / 2) * pitch
    body += shapes.union(stud.translate((x, y * pitch, 0)) for x in columns for y in (-0.5, 0.5))
    return body + shapes.union(tube.translate((x + pitch / 2, 0, 0)) for x in columns[:-1])


def puzzle_cube(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Hollow cubies around a core with sprung screws, tiles on them, the top layer half turned."""
    side = size_cm / 3
    turn = float(rng.choice([0.0, rng.uniform(8.0, 25.0)]))
    cubie = shapes.rounded_box((side, side, side), 0.06 * side)
    foot = shapes.sphere(0.62 * side)
    hollow = shapes.box((0.8 * side,) * 3)
    solids = {"corners": Manifold(), "edges": Manifold(), "centres": Manifold()}
    for spot in np.ndindex(3, 3, 3):
        at = np.array(spot) - 1
        kind = ("", "centres", "edges", "corners")[int(np.abs(at).sum())]
        if kind:
            one = (cubie - hollow).translate(tuple((at * side).tolist()))
            solids[kind] += one.rotate((0, 0, turn if at[2] == 1 else 0.0))
    arm = shapes.cylinder(0.28 * side, 0.0, 0.5 * side)
    core = foot + _six_ways(arm)
    screw = shapes.cylinder(0.09 * side, 0.3 * side, 1.32 * side) + shapes.cylinder(
        0.18 * side, 1.25 * side, 1.32 * side
    )
    coil = skins.spring(0.17 * side, 0.025 * side, 0.6 * side, 1.25 * side, 4.0)
    tiles = _tiles(side, turn)
    return [
        Piece("screws", "screw", _six_ways(screw)),
        Piece("springs", "spring", _six_ways(coil)),
        Piece("core", "core", core),
        *(Piece(name, "cubie", solid) for name, solid in solids.items()),
        *(Piece(f"tiles_{i + 1}", f"tile_{'abc'[i]}", solid) for i, solid in enumerate(tiles)),
    ]


def _six_ways(solid: Manifold) -> Manifold:
    """Join copies along both senses of each axis."""
    turns = [(0, 0, 0), (180, 0, 0), (90, 0, 0), (-90, 0, 0), (0, 90, 0), (0, -90, 0)]
    return shapes.union(solid.rotate(turn) for turn in turns)


def _tiles(side: float, turn: float) -> list[Manifold]:
    """Nine tiles on each face, by axis."""
    tile = shapes.slab(
        shapes.rounded_rectangle(0.86 * side, 0.86 * side, 0.1 * side), 1.5 * side, 1.53 * side
    )
    cells = [(i * side, j * side) for i in (-1, 0, 1) for j in (-1, 0, 1)]
    face = shapes.union(tile.translate((x, y, 0)) for x, y in cells)
    above = shapes.box((9 * side, 9 * side, 9 * side), (0, 0, 5 * side))
    solids = []
    for way in ((0.0, 0.0, 0.0), (90.0, 0.0, 0.0), (0.0, 90.0, 0.0)):
        pair = face.rotate(way) + face.rotate((180, 0, 0)).rotate(way)
        solids.append((pair - above) + (pair ^ above).rotate((0, 0, turn)))
    return solids


def stacking_rings(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Blown rings, the largest below, on a peg over a rocking foot with a weight in it."""
    count, foot = int(rng.integers(4, 7)), 0.16 * size_cm
    widest, wall = size_cm * rng.uniform(0.34, 0.38), 0.12
    tube, ball = 0.31 * size_cm / count, 0.11 * size_cm
    shrink = 0.45 * widest / (count - 1)
    pitch = np.sqrt((2 * tube - 0.01) ** 2 - shrink**2)  # each rests on the last, a hair sunk in
    rings = []
    for i in range(count):
        middle, z = widest - tube - i * shrink, foot + tube - 0.01 + i * pitch
        ring = fittings.ring(middle, tube, z) - fittings.ring(middle, tube - wall, z)
        rings.append(Piece(f"ring_{i + 1}", "ring_even" if i % 2 else "ring_odd", ring))
    top = size_cm - ball
    peg = shapes.cylinder(0.5 * (0.55 * widest - 2 * tube) + 0.4, foot, top, 0.4)
    bowl, room = (
        shapes.sphere(1.3 * widest - less, (0, 0, 1.3 * widest))
        ^ shapes.cylinder(0.95 * widest - less, 0.0, foot - less)
        for less in (0.0, 0.25)
    )
    knob = shapes.sphere(ball, (0, 0, top)) - shapes.sphere(ball - 0.2, (0, 0, top))
    return [
        Piece("weight", "weight", shapes.cut_above(room, 0.4 * foot)),
        Piece("peg", "peg", peg),
        *rings,
        Piece("knob", "knob", knob),
        Piece("foot", "foot", bowl - room),
    ]


def yo_yo(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Two cupped halves screwed on an axle with a ball bearing, a string wound on it, caps."""
    radius, gap = size_cm / 2, rng.uniform(0.3, 0.42)
    deep = radius * rng.uniform(0.5, 0.62)
    side = [(0.0, 0.0), (0.3, 0.0), (0.5, 0.1), (0.95, 0.4), (1.0, 0.7), (0.92, 1.0)]
    side += [(0.75, 0.95), (0.68, 0.45), (0.0, 0.4)]
    half = shapes.lathe(
        shapes.outline([(r * radius, gap / 2 + z * deep) for r, z in side], 0.06 * radius)
    )
    cap = shapes.cylinder(0.75 * radius, gap / 2 + 0.75 * deep, gap / 2 + 0.85 * deep)
    axle = shapes.thread(0.2, 0.16, 0.08, -gap / 2 - 0.39 * deep, gap / 2 + 0.39 * deep)
    race = shapes.tube(0.62, 0.5, -gap / 2, gap / 2) + shapes.tube(0.34, 0.2, -gap / 2, gap / 2)
    balls = shapes.around(shapes.sphere(0.081, (0.42, 0, 0)), 8)
    string = shapes.tube(rng.uniform(0.5, 0.7) * radius, 0.62, -0.42 * gap, 0.42 * gap)
    loose = fittings.bar(
        [(0, -0.62, 0), (0.7 * radius, -0.68 * radius, 0), (1.25 * radius, -0.3 * radius, -0.2)],
        0.06,
    )
    return [
        Piece("axle", "axle", axle),
        Piece("bearing", "bearing", race + balls),
        Piece("string", "string", string + loose),
        Piece("front", "half", half),
        Piece("back", "half", half.mirror((0, 0, 1))),
        Piece("front_cap", "cap", cap),
        Piece("back_cap", "cap", cap.mirror((0, 0, 1))),
    ]


ARCHETYPES: Final = {
    "building_brick": Archetype(building_brick, "brick_odd brick_even"),
    "puzzle_cube": Archetype(puzzle_cube, "screw spring core cubie tile_a tile_b tile_c"),
    "stacking_rings": Archetype(stacking_rings, "weight peg ring_odd ring_even knob foot"),
    "toy_car": Archetype(toy_car, "axle hub tyre gear spring motor case cell window floor shell"),
    "toy_train": Archetype(toy_train, "nail magnet dowel wheel trim boiler cab bed"),
    "yo_yo": Archetype(yo_yo, "axle bearing string half cap"),
}
