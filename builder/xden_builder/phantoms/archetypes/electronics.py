"""Battery-powered devices with shell, board and cells: a remote control, a flashlight."""

from __future__ import annotations

from typing import Final

import numpy as np
from manifold3d import Manifold

from xden_builder.phantoms import shapes, skins
from xden_builder.phantoms.pieces import Archetype, Piece, moved

__all__ = ["ARCHETYPES"]

AAA_CM = (0.525, 4.45)
"""Radius and length of an AAA cell, IEC 60086-2 (LR03)."""


def remote_control(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Shell with two cells at one end, and a board under a keypad at the other."""
    wide, high, wall = rng.uniform(4.0, 5.2), rng.uniform(1.7, 2.1), rng.uniform(0.15, 0.22)
    inner = (size_cm - 2 * wall, wide - 2 * wall, high - 2 * wall)
    outside = shapes.slab(shapes.rounded_rectangle(size_cm, wide, 1.0), 0.0, high, 0.35)
    inside = shapes.slab(shapes.rounded_rectangle(*inner[:2], 0.8), wall, high - wall, 0.2)
    radius, length = AAA_CM
    cells_from = -inner[0] / 2 + 0.5
    rib_x = cells_from + length + 0.12
    rib = shapes.box((0.16, *inner[1:]), (rib_x, 0.0, high / 2)) ^ inside
    board_x = (rib_x + 0.3, inner[0] / 2 - 0.25)
    board_z = high - wall - 0.32
    posts = _posts(board_x, inner[1], wall, board_z)
    return [
        *_cells(cells_from, length, radius, wall),
        *_board(rng, board_x, inner[1] - 0.4, board_z),
        Piece("keypad", "keypad", _keypad(rng, board_x, inner[1] - 0.8, board_z, high)),
        Piece("lamp", "lamp", _lamp(board_x[1] - 0.2, size_cm / 2, board_z)),
        Piece("shell", "shell", (outside - inside) + rib + posts),
    ]


def _cells(start: float, length: float, radius: float, floor: float) -> list[Piece]:
    """Two cells, head to tail, on the floor, between a spring and metal strips."""
    nub = 0.09
    cell = shapes.cylinder(radius, 0.0, length - nub) + shapes.cylinder(0.17, 0.0, length)
    coil = skins.spring(0.3, 0.04, -0.5, 0.0, 3.5)
    pair = [shapes.along_x(solid) for solid in (cell, coil)]
    there = (start, radius + 0.02, floor + radius)
    back = (start + length, -radius - 0.02, floor + radius)
    cells = [pair[0].translate(there), pair[0].rotate((0, 0, 180)).translate(back)]
    springs = pair[1].translate(there)
    strip = shapes.box((0.04, 4 * radius, radius), (start + length + 0.02, 0, floor + radius))
    strip += shapes.box((0.5, 0.4, 0.05), (start - 0.25, -radius - 0.02, floor + radius))
    return [
        Piece("cell_1", "cell", cells[0]),
        Piece("cell_2", "cell", cells[1]),
        Piece("spring", "spring", springs),
        Piece("contact", "contact", strip),
    ]


def _board(rng: np.random.Generator, x: tuple[float, float], wide: float, z: float) -> list[Piece]:
    """Circuit board whose upper face is at z, chips hanging under it."""
    middle, long = (x[0] + x[1]) / 2, x[1] - x[0]
    board = shapes.box((long, wide, 0.16), (middle, 0.0, z - 0.08))
    chips = shapes.union(
        shapes.box(
            (rng.uniform(0.4, 1.1), rng.uniform(0.4, 1.0), 0.2),
            (x[0] + long * share, wide * rng.uniform(-0.22, 0.22), z - 0.26),
        )
        for share in (0.25, 0.5, 0.75)
    )
    return [Piece("board", "board", board), Piece("chips", "chip", chips)]


def _keypad(
    rng: np.random.Generator, x: tuple[float, float], wide: float, z: float, top: float
) -> Manifold:
    """Elastic mat on the board with rows of buttons that stick out of the shell."""
    mat = shapes.box((x[1] - x[0] - 0.6, wide, 0.12), ((x[0] + x[1]) / 2, 0.0, z + 0.06))
    columns, pitch = 3, wide / 3
    rows = int((x[1] - x[0] - 0.8) / pitch)
    radius, height = pitch * rng.uniform(0.25, 0.36), top + rng.uniform(0.08, 0.16) - z
    button = shapes.slab(shapes.disc(radius), z, z + height, 0.05)
    spots = [
        ((x[0] + x[1]) / 2 + (row - (rows - 1) / 2) * pitch, (column - 1) * pitch, 0.0)
        for row in range(rows)
        for column in range(columns)
    ]
    return mat + shapes.union(button.translate(spot) for spot in spots)


def _lamp(board_end: float, front: float, z: float) -> Manifold:
    """Infrared diode at the board's edge that looks out of the front."""
    return shapes.along_x(shapes.capsule(0.22, board_end, front + 0.08)).translate((0, 0, z - 0.3))


def _posts(x: tuple[float, float], wide: float, floor: float, top: float) -> Manifold:
    """Pegs of the shell that carry the board's corners."""
    post = shapes.cylinder(0.16, floor - 0.05, top - 0.1)
    return shapes.union(
        post.translate((end, side * (wide / 2 - 0.45), 0.0))
        for end in (x[0] + 0.3, x[1] - 0.5)
        for side in (-1, 1)
    )


def flashlight(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Tube with two cells in a row, a spring behind them, and a head with lamp and lens."""
    cell = 0.29 * size_cm
    radius, wall = cell * rng.uniform(0.16, 0.26), rng.uniform(0.12, 0.2)
    bore, head = radius + 0.04, radius * rng.uniform(1.5, 1.8) + wall
    floor, tail, front = 0.05 * size_cm, 0.1 * size_cm, 0.95 * size_cm
    seat = tail + 2 * cell + 0.02 * size_cm
    cup = shapes.outline(
        [(0, 0), (bore + 2 * wall, 0), (bore + 2 * wall, 1.6 * tail), (0, 1.6 * tail)], 0.1
    )
    pieces = [
        Piece("cell_1", "cell", _torch_cell(radius, tail, tail + cell)),
        Piece("cell_2", "cell", _torch_cell(radius, tail + cell, tail + 2 * cell)),
        Piece("spring", "spring", skins.spring(0.7 * radius, 0.05, floor, tail, 4.5)),
        Piece("contact", "contact", shapes.cylinder(0.3 * radius, tail + 2 * cell, seat)),
        Piece("board", "board", shapes.cylinder(bore + 0.1, seat, seat + 0.16)),
        Piece("lamp", "lamp", shapes.cylinder(0.3 * radius, seat + 0.16, seat + 0.4)),
        Piece("reflector", "reflector", _reflector(0.3 * radius, head - wall, seat + 0.16, front)),
        Piece("lens", "lens", shapes.cylinder(head - wall, front, front + 0.2)),
        Piece("button", "button", _button(radius, floor)),
        Piece("body", "shell", _torch_body(size_cm, bore, wall, head, seat)),
        Piece("tail_cap", "shell", shapes.lathe(cup) - shapes.cylinder(bore, floor, size_cm)),
    ]
    return moved(pieces, shapes.along_x)


def _torch_cell(radius: float, z0: float, z1: float) -> Manifold:
    nub = 0.03 * (z1 - z0)
    return shapes.cylinder(radius, z0, z1 - nub) + shapes.cylinder(0.35 * radius, z0, z1)


def _button(radius: float, floor: float) -> Manifold:
    """Elastic cap through the tail's floor, with a rim inside."""
    return shapes.slab(shapes.disc(0.5 * radius), -0.5 * floor, 1.3 * floor, 0.08)


def _reflector(inner: float, outer: float, z0: float, z1: float) -> Manifold:
    """Thin parabolic bowl."""
    rise = np.linspace(0.0, 1.0, 10)
    radii, z = inner + (outer - inner - 0.08) * np.sqrt(rise), z0 + (z1 - z0) * rise
    inside = list(zip(radii.tolist(), z.tolist(), strict=True))
    return shapes.lathe(shapes.polygon([*inside, *((r + 0.08, up) for r, up in inside[::-1])]))


def _torch_body(length: float, bore: float, wall: float, head: float, seat: float) -> Manifold:
    """Tube that widens to the head; a shoulder carries the board, a rim holds the lens."""
    tube, opening = bore + wall, head - wall
    outer = [(0, 0.055), (tube, 0.055), (tube, 0.62), (head, 0.78), (head, 1.0), (0, 1.0)]
    body = shapes.lathe(shapes.outline([(r, z * length) for r, z in outer], 0.1))
    lens_z = 0.95 * length
    cavity = shapes.cylinder(bore, 0.0, seat) + shapes.cylinder(bore + 0.1, seat, seat + 0.16)
    cavity += shapes.cylinder(bore + 0.1, seat + 0.16, 0.8 * length, opening)
    cavity += shapes.cylinder(opening, 0.8 * length, lens_z + 0.2)
    return body - cavity - shapes.cylinder(0.92 * opening, lens_z, 2 * length)


ARCHETYPES: Final = {
    "flashlight": Archetype(
        flashlight, "cell spring contact board lamp reflector lens button shell"
    ),
    "remote_control": Archetype(remote_control, "cell spring contact board chip keypad lamp shell"),
}
