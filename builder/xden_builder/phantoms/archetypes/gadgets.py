"""Electronics in a flat case: phone, mouse, keyboard, power bank, charger, multimeter, router..."""

from __future__ import annotations

from typing import Final

import numpy as np
from manifold3d import Manifold, OpType

from xden_builder.phantoms import fittings, shapes, skins
from xden_builder.phantoms.pieces import Archetype, Piece

__all__ = ["ARCHETYPES"]


def smartphone(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Glass, display, battery and board stacked in a frame, with cameras at the back."""
    wide, high = 0.48 * size_cm, rng.uniform(0.75, 0.95)
    outline = shapes.rounded_rectangle(size_cm, wide, 0.9)
    inner = shapes.inset(outline, 0.22)
    frame, room = shapes.slab(outline, 0.0, high, 0.12), shapes.slab(inner, 0.12, high)
    split = size_cm * rng.uniform(0.12, 0.2)
    long, y = split + 0.44 * size_cm, 0.36 * wide
    battery = shapes.rounded_box((long, wide - 0.8, 0.42), 0.1, (split - long / 2, 0, 0.33))
    x = (split + 0.46 * size_cm) / 2 + 0.15
    board = fittings.board(rng, (0.42 * size_cm - split, wide - 0.8), 0.12, (x, 0.0))
    lens = shapes.cylinder(0.3, -0.12, 0.12)
    spots = [(0.42 * size_cm - 0.9 * i, -y + 0.45, 0.0) for i in range(int(rng.integers(1, 4)))]
    return [
        Piece("battery", "cell", battery),
        *board,
        Piece("cameras", "lens", shapes.union(lens.translate(spot) for spot in spots)),
        Piece("display", "screen", shapes.slab(inner, high - 0.18, high - 0.08)),
        Piece("glass", "glass", shapes.slab(inner, high - 0.08, high)),
        Piece("frame", "shell", frame - room),
    ]


def computer_mouse(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Humped shell with a wheel between two buttons, a board, and a cell if it has no cable."""
    wide, high = size_cm * rng.uniform(0.52, 0.6), size_cm * rng.uniform(0.3, 0.38)
    hull = _hump(size_cm, wide, high) - _hump(size_cm - 0.5, wide - 0.5, high - 0.25)
    hull += _hump(size_cm, wide, high) ^ shapes.box((99, 99, 0.5))
    slit = shapes.box((0.42 * size_cm, 0.15, high), (0.33 * size_cm, 0, 0.5 * high + 0.9))
    x = 0.27 * size_cm
    slot = shapes.box((2.4, 0.8, high), (x, 0, 0.5 * high + 0.9))
    wheel = shapes.cylinder(0.37 * high, -0.3, 0.3) + shapes.cylinder(0.1, -0.9, 0.9)
    wheel = wheel.rotate((90, 0, 0)).translate((x, 0, 0.62 * high))
    post = shapes.box((0.3, 0.25, 0.62 * high), (x, 0.75, 0.31 * high))
    stand = post + post.mirror((0, 1, 0)) - shapes.box((99, 99, 0.5))
    pieces = [
        Piece("wheel", "wheel", wheel),
        Piece("posts", "shell", stand),
        *fittings.board(rng, (0.6 * size_cm, 0.62 * wide), 0.25, (0.05 * size_cm, 0.0)),
    ]
    if rng.random() < 0.5:
        cell = shapes.along_x(fittings.cell(0.52, -0.32 * size_cm, -0.32 * size_cm + 4.4))
        pieces.append(Piece("cell", "cell", cell.translate((0, -0.12 * wide, 0.41 + 0.52 + 0.1))))
        rest = shapes.box((2.5, 0.3, 0.55), (-0.15 * size_cm, -0.12 * wide, 0.66))
        pieces.append(Piece("cradle", "shell", rest))
    return [*pieces, Piece("shell", "shell", hull - slit - slot)]


def _hump(long: float, wide: float, high: float) -> Manifold:
    """Half an egg that is highest under the palm, flat below; its front towards +x."""
    shares = [(-0.5, 0.3, 0.2), (-0.47, 0.6, 0.5), (-0.38, 0.86, 0.8), (-0.2, 1.0, 1.0)]
    shares += [(0.0, 0.96, 0.97), (0.2, 0.9, 0.82), (0.38, 0.86, 0.6), (0.47, 0.7, 0.4)]
    ovals = [(x * long, high * z, wide / 2 * y) for x, y, z in [*shares, (0.5, 0.4, 0.2)]]
    return shapes.along_x(skins.loft(ovals, 2.6)).trim_by_plane((0.0, 0.0, 1.0), 0.0)


def keyboard(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Rows of keys on a switch sheet over a steel plate and a board, in a tray."""
    rows, pitch = int(rng.integers(5, 7)), 1.9
    wide = rows * pitch + 1.4
    columns = int((size_cm - 1.4) / pitch)
    tray, room = fittings.case(shapes.rounded_rectangle(size_cm, wide, 0.6), 0.0, 1.9, 0.25, 0.2)
    inner = (size_cm - 0.5, wide - 0.5)
    cap = shapes.slab(shapes.rounded_rectangle(0.88 * pitch, 0.88 * pitch, 0.15), 1.2, 2.4, 0.1)
    opening = shapes.box((columns * pitch, rows * pitch, 3.0), (0, 0, 2.7))
    sites = [
        ((i - (columns - 1) / 2) * pitch, (j - (rows - 1) / 2) * pitch, 0.0)
        for i in range(columns)
        for j in range(rows)
        if j or not 0.3 * columns < i < 0.65 * columns
    ]
    bar = ((0.35 * columns) * pitch - 0.1, 0.88 * pitch, 1.2)
    space = shapes.rounded_box(bar, 0.15, (-0.02 * size_cm, -2 * pitch, 1.8))
    sheet = shapes.box((*inner, 0.2), (0, 0, 1.1)) ^ room
    keys = Manifold.batch_boolean([cap.translate(site) for site in sites], OpType.Add)
    return [
        Piece("keys", "button", (keys + space) + sheet),
        Piece("plate", "plate", shapes.box((*inner, 0.12), (0, 0, 0.94)) ^ room),
        *fittings.board(rng, (0.9 * inner[0], 0.8 * inner[1]), 0.5),
        Piece("shell", "shell", (tray - opening) + (_feet(inner, 0.5) ^ room)),
    ]


def _feet(inner: tuple[float, float], z: float) -> Manifold:
    """Pegs that carry a board."""
    return shapes.union(
        shapes.cylinder(0.2, 0.1, z).translate((x * inner[0], y * inner[1], 0.0))
        for x in (-0.4, 0.4)
        for y in (-0.3, 0.3)
    ) + shapes.box((0.4, 0.8 * inner[1], 0.88 - 0.1), (0.48 * inner[0], 0, 0.49))


def power_bank(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Row of round lithium cells, or one flat pouch, beside a board with sockets."""
    wide = size_cm * rng.uniform(0.44, 0.56)
    if rng.random() < 0.5:
        count, radius = max(2, int((wide - 0.4) / 1.9)), 0.9
        high, wide = 2.4, count * 1.82 + 0.6
        cell = shapes.along_x(fittings.cell(radius, -0.42 * size_cm, -0.42 * size_cm + 6.5))
        rows = [(i - (count - 1) / 2) * 1.81 for i in range(count)]
        cells = [cell.translate((0, y, 0.25 + radius)) for y in rows]
        start = -0.42 * size_cm + 6.5
    else:
        high = rng.uniform(1.2, 1.6)
        long = 0.66 * size_cm
        pouch = (long, wide - 0.8, high - 0.5)
        cells = [shapes.rounded_box(pouch, 0.2, (long / 2 - 0.46 * size_cm, 0, high / 2))]
        start = 0.21 * size_cm
    outline = shapes.rounded_rectangle(size_cm, wide, 0.5)
    shell, room = fittings.case(outline, 0.0, high, 0.25, 0.35)
    long = size_cm / 2 - 0.3 - start - 0.3
    board = fittings.board(rng, (long, 0.8 * wide), 0.25, (start + 0.3 + long / 2, 0.0))
    socket = shapes.box((1.4, 1.3, 0.6), (size_cm / 2 - 0.7, 0.0, 0.41 + 0.3))
    plug_hole = shapes.box((2.0, 1.1, 0.4), (size_cm / 2 + 0.1, 0.0, 0.71))
    return [
        *(Piece(f"cell_{i + 1}", "cell", one ^ room) for i, one in enumerate(cells)),
        Piece("socket", "contact", socket - plug_hole),
        *board,
        Piece("shell", "shell", shell - plug_hole),
    ]


def charger(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Mains adapter: two pins, a transformer, capacitors and a board in a block."""
    body, wide = size_cm - 1.9, size_cm * rng.uniform(0.5, 0.62)
    high = wide * rng.uniform(0.6, 0.95)
    outline = shapes.rounded_rectangle(body, wide, 0.4)
    shell, room = fittings.case(outline, -high / 2, high / 2, 0.22, 0.3)
    pin = shapes.along_x(shapes.capsule(0.2, -body / 2 - 1.9, -body / 2 + 0.7))
    floor = -high / 2 + 0.22
    low = floor + 0.16
    core = shapes.box((0.34 * body, 0.5 * wide, 0.5 * high), (0, 0.1 * wide, low + 0.25 * high))
    coil = shapes.cylinder(0.14 * body, low, low + 0.36 * high).translate((0, 0.1 * wide, 0))
    can = shapes.cylinder(0.11 * body, low, low + 0.55 * high)
    socket = shapes.box((1.2, 1.3, 0.6), (body / 2 - 0.6, 0.0, floor + 0.46))
    hole = shapes.box((1.9, 1.1, 0.4), (body / 2 + 0.15, 0.0, floor + 0.46))
    board = shapes.box((body - 0.5, wide - 0.5, 0.16), (0, 0, floor + 0.08))
    return [
        Piece("pins", "contact", shapes.union(pin.translate((0, y, 0)) for y in (-0.95, 0.95))),
        Piece("socket", "contact", socket - hole),
        Piece("core", "core", core - coil),
        Piece("coil", "coil", coil),
        Piece("capacitor", "can", can.translate((0.3 * body, -0.28 * wide, 0))),
        Piece("board", "board", board ^ room),
        Piece("shell", "shell", shell - hole),
    ]


def usb_stick(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Plug with a tongue and contacts, a board with two chips, a shell."""
    wide, high = rng.uniform(1.6, 2.0), rng.uniform(0.7, 0.9)
    body = size_cm - 1.25
    shell, room = fittings.case(
        shapes.rounded_rectangle(body, wide, 0.3), -high / 2, high / 2, 0.12, 0.15
    )
    end = body / 2
    plug = shapes.box((1.65, 1.2, 0.45), (end + 1.25 - 0.825, 0, 0))
    hollow = shapes.box((1.9, 1.12, 0.37), (end + 1.25 - 0.825, 0, 0))
    board_end = end + 1.1
    board = shapes.box((board_end + end - 0.3, 1.1, 0.14), ((board_end - end + 0.3) / 2, 0, -0.115))
    pad = shapes.box((0.7, 0.12, 0.02), (board_end - 0.4, 0.0, -0.035))
    pads = shapes.union(pad.translate((0, y, 0)) for y in (-0.35, -0.12, 0.12, 0.35))
    chip = shapes.box((0.4 * body, 0.9, 0.12), (-0.15 * body, 0, 0.015))
    block = shapes.box((1.0, wide - 0.24, 0.3), (-end + 0.55, 0, -0.215)) ^ room
    return [
        Piece("pads", "contact", pads),
        Piece("chip", "chip", chip),
        Piece("board", "board", board),
        Piece("plug", "plug", plug - hollow),
        Piece("shell", "shell", shell + block),
    ]


def multimeter(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Instrument with a display, buttons, a dial, two cells and a board."""
    depth, breadth = 0.2 * size_cm, 0.5 * size_cm * rng.uniform(0.92, 1.08)
    outline = shapes.rounded_rectangle(size_cm, breadth, 0.12 * breadth)
    shell, _ = fittings.case(outline, 0.0, depth, 0.25, 0.2)
    top, level = depth - 0.25, depth - 0.9
    screen = (0.26 * size_cm, 0.7 * breadth)
    glass = shapes.box((*screen, 0.25), (0.28 * size_cm, 0, depth - 0.125))
    crystal = shapes.box((screen[0] + 0.4, screen[1] + 0.4, 0.3), (0.28 * size_cm, 0, top - 0.15))
    knob = shapes.slab(shapes.disc(0.22 * breadth + 0.3), top, depth + 0.5, 0.15)
    knob += shapes.cylinder(0.25, level + 0.16, depth)
    button = shapes.slab(shapes.disc(0.07 * breadth), level + 0.16, depth + 0.12, 0.05)
    spots = [(0.07 * size_cm, i * 0.85 / 3 * breadth, 0) for i in (-1, 0, 1)]
    cell = shapes.along_x(fittings.cell(0.52, -0.4 * size_cm, -0.4 * size_cm + 4.4))
    peg = shapes.cylinder(0.2, 0.1, level)
    pegs = [peg.translate((0.4 * size_cm, s * 0.36 * breadth, 0.0)) for s in (-1, 1)]
    plate = shapes.box((0.84 * size_cm, 0.84 * breadth, 0.16), (0.02 * size_cm, 0, level + 0.08))
    return [
        Piece("screen", "screen", crystal),
        Piece("glass", "glass", glass),
        Piece("dial", "button", knob.translate((-0.2 * size_cm, 0, 0))),
        Piece("buttons", "button", shapes.union(button.translate(spot) for spot in spots)),
        Piece("board", "board", plate),
        *(
            Piece(f"cell_{i + 1}", "cell", cell.translate((0, (i - 0.5) * 1.1, 0.25 + 0.53 - 0.01)))
            for i in range(2)
        ),
        Piece("chip", "chip", shapes.box((1.5, 1.5, 0.2), (0.25 * size_cm, 0, level - 0.1))),
        Piece("shell", "shell", shell + shapes.union(pegs)),
    ]


def router(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Flat box with a board, shielded chips, sockets at the back and aerials that stand up."""
    wide, high = size_cm * rng.uniform(0.55, 0.7), rng.uniform(2.6, 3.4)
    shell, room = fittings.case(shapes.rounded_rectangle(size_cm, wide, 1.0), 0, high, 0.22, 0.6)
    z = 0.8
    board = fittings.board(rng, (0.8 * size_cm, 0.78 * wide), z, (0, 0.02 * wide))
    pegs = _pegs(0.36 * size_cm, 0.3 * wide, z)
    count = int(rng.integers(3, 6))
    socket = shapes.box((1.5, 1.9, 1.3), (0, wide / 2 - 0.95, z + 0.16 + 0.65))
    hole = shapes.box((1.2, 1.5, 1.0), (0, wide / 2 - 0.5, z + 0.16 + 0.65))
    slots = [(1.8 * (i - (count - 1) / 2), 0, 0) for i in range(count)]
    holes = shapes.union(hole.translate(s) for s in slots)
    aerial = shapes.capsule(0.5, 0.6 * high, 0.6 * high + 0.55 * size_cm)
    aerial = aerial.translate((0, wide / 2 + 0.45, 0))
    wire = shapes.cylinder(0.1, 0.6 * high + 0.5, 0.5 * high + 0.5 * size_cm)
    wire = wire.translate((0, wide / 2 + 0.45, 0))
    spots = [(x * size_cm, 0, 0) for x in (-0.42, 0.42)]
    can = shapes.box((0.2 * size_cm, 0.3 * wide, 0.3), (-0.2 * size_cm, -0.1 * wide, z + 0.31))
    can -= shapes.box((0.2 * size_cm - 0.08, 0.3 * wide - 0.08, 0.3)).translate(
        (-0.2 * size_cm, -0.1 * wide, z + 0.27)
    )
    return [
        Piece("shield", "contact", can),
        Piece("aerial_wires", "contact", shapes.union(wire.translate(s) for s in spots)),
        Piece("aerials", "shell", shapes.union(aerial.translate(s) for s in spots)),
        Piece("sockets", "socket", shapes.union((socket - hole).translate(s) for s in slots)),
        *board,
        Piece("shell", "shell", (shell - holes) + (pegs ^ room)),
    ]


def _pegs(x: float, y: float, top: float) -> Manifold:
    """Four pegs of a shell that carry a board."""
    peg = shapes.cylinder(0.2, 0.1, top)
    return shapes.union(peg.translate((a * x, b * y, 0)) for a in (-1, 1) for b in (-1, 1))


def game_controller(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Two-handed shell with sticks, a cross, buttons, rumble motors, a battery and a board."""
    high, wall = rng.uniform(3.2, 3.8), 0.25
    body, cavity = (_wings(size_cm, high, w) for w in (0.0, wall))
    x, z = 0.2 * size_cm, high / 2
    ground = -0.1 * high
    stick = shapes.cylinder(0.3, ground + 0.16, z + 0.9)
    stick += shapes.slab(shapes.disc(0.85), z + 0.75, z + 1.2, 0.1)
    stick += shapes.cylinder(0.9, ground + 0.16, ground + 0.7)
    sticks = stick.translate((-0.1 * size_cm, -1.2, 0)) + stick.translate((0.1 * size_cm, -1.2, 0))
    arm = shapes.box((1.9, 0.6, 1.6), (0, 0, z - 0.45))
    cross = arm + arm.rotate((0, 0, 90)) + shapes.cylinder(0.3, ground + 0.16, z)
    button = shapes.capsule(0.38, ground + 0.16, z + 0.3).translate((0.85, 0, 0))
    pads = cross.translate((-x - 0.6, 0.8, 0))
    pads += shapes.around(button, 4).translate((x + 0.6, 0.8, 0))
    motor = shapes.along_x(shapes.cylinder(0.8, -0.9, 0.9)).translate((0, -1.4, ground - 0.8))
    board = shapes.box((0.68 * size_cm, 3.6, 0.16), (0, 0, ground + 0.08))
    bay = shapes.box((3.6, 2.6, 0.6), (0, 0, ground - 0.3))
    rib = shapes.box((0.5, 2.0, 0.5 * high), (1.95, 0, -0.38 * high))
    return [
        Piece("sticks", "button", sticks),
        Piece("buttons", "button", pads),
        Piece("battery", "cell", bay),
        Piece("left_motor", "motor", motor.translate((-0.27 * size_cm, 0, 0)) ^ cavity),
        Piece("right_motor", "motor", motor.translate((0.27 * size_cm, 0, 0)) ^ cavity),
        Piece("board", "board", board ^ cavity),
        Piece("shell", "shell", body - (cavity - rib)),
    ]


def _wings(size: float, high: float, wall: float) -> Manifold:
    """Pad with two horns, shrunk by a wall."""
    pad = shapes.rounded_box(
        (0.7 * size - 2 * wall, 5.2 - 2 * wall, high - 2 * wall), 0.45 * high - wall
    )
    thick, tip = 0.46 * high - wall, 0.08 * size - wall
    horns = [
        fittings.strut((s * 0.33 * size, 0.2, 0), (s * 0.42 * size, -5.0, -0.5), thick, tip)
        for s in (-1, 1)
    ]
    return pad + shapes.union(horns)


ARCHETYPES: Final = {
    "charger": Archetype(charger, "contact core coil can board shell"),
    "computer_mouse": Archetype(computer_mouse, "wheel cell board chip shell"),
    "game_controller": Archetype(game_controller, "button cell motor board shell"),
    "keyboard": Archetype(keyboard, "button plate board chip shell"),
    "multimeter": Archetype(multimeter, "screen glass button board cell chip shell"),
    "power_bank": Archetype(power_bank, "cell contact board chip shell"),
    "router": Archetype(router, "contact socket board chip shell"),
    "smartphone": Archetype(smartphone, "cell board chip lens screen glass shell"),
    "usb_stick": Archetype(usb_stick, "contact chip board plug shell"),
}
