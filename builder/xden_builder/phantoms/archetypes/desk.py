"""Things on a desk: stapler, tape dispenser, paper punch, notebook, calculator and smaller ones."""

from __future__ import annotations

from typing import Final

import numpy as np
from manifold3d import CrossSection, Manifold

from xden_builder.phantoms import shapes, skins
from xden_builder.phantoms.pieces import Archetype, Piece, moved

__all__ = ["ARCHETYPES"]


def marker(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Fat barrel with an ink-soaked felt core, a bevelled nib, a plug and a clip-on cap."""
    radius, wall = size_cm * rng.uniform(0.055, 0.075), 0.12
    joint, nose = 0.68 * size_cm, 0.8 * size_cm
    body = shapes.slab(shapes.disc(radius), 0.0, joint, 0.08) + shapes.cylinder(
        0.85 * radius, joint, nose, 0.5 * radius
    )
    room = shapes.cylinder(radius - wall, 0.5, joint - 0.3)
    core = shapes.slab(shapes.disc(radius - wall), 0.6, joint - 0.4, 0.1)
    nib = shapes.cylinder(0.3 * radius, joint - 1.2, 0.88 * size_cm)
    nib -= shapes.box((9.0, 9.0, radius), (0, 0, 0.9 * size_cm)).rotate((0, 6, 0))
    hood = shapes.slab(shapes.disc(1.02 * radius), joint, size_cm, 0.12)
    hood -= shapes.cylinder(0.85 * radius, joint - 1.0, size_cm - 0.16)
    clip = shapes.box((0.18, 0.5, 0.26 * size_cm), (-1.02 * radius - 0.2, 0, 0.84 * size_cm))
    clip += shapes.box((0.5, 0.5, 0.3), (-1.02 * radius, 0, 0.95 * size_cm))
    pieces = [
        Piece("nib", "nib", nib),
        Piece("core", "core", core),
        Piece("plug", "cap", shapes.cylinder(radius - wall, 0.2, 0.6)),
        Piece("barrel", "barrel", body - room - shapes.cylinder(radius - wall, 0.2, 0.6)),
        Piece("cap", "cap", hood + clip),
    ]
    return moved(pieces, shapes.along_x)


def stapler(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Sprung arm on a base with an anvil, a rail with a row of staples, and a spring."""
    wide, open_deg = size_cm * rng.uniform(0.19, 0.24), rng.uniform(4.0, 9.0)
    base = shapes.slab(shapes.rounded_rectangle(size_cm, wide, 0.35 * wide), 0.0, 0.9, 0.2)
    base -= shapes.box((0.7 * size_cm, 0.6 * wide, 1.0), (0, 0, 0.0))
    anvil = shapes.box((1.6, 0.6 * wide, 0.12), (0.42 * size_cm, 0, 0.86))
    back, inner = -0.44 * size_cm, 0.62 * wide
    ears = shapes.box((1.6, wide, 2.4), (back + 0.6, 0, 1.8))
    ears -= shapes.box((9.0, inner + 0.02, 9.0), (0, 0, 5.4))
    long = 0.93 * size_cm
    rail = shapes.box((long, inner, 1.0), (long / 2, 0, 0.0))
    rail -= shapes.box((long, inner - 0.12, 1.0), (long / 2 + 0.1, 0, 0.06))
    filled = long * rng.uniform(0.25, 0.7)
    front = long - 0.1
    staples = shapes.box((filled, inner - 0.12, 0.6), (front - filled / 2, 0, -0.14))
    staples -= shapes.box((9 * filled, inner - 0.24, 0.54), (0, 0, -0.2))
    pusher = shapes.box((0.8, inner - 0.12, 0.6), (front - filled - 0.4, 0, -0.14))
    coil = shapes.along_x(skins.spring(0.2, 0.03, 1.0, front - filled - 0.8, 22.0)).translate(
        (0, 0, -0.2)
    )
    arm = [(-0.06, 0.1), (-0.06, 0.8), (0.1, 1.4), (0.75, 1.3), (1.0, 0.75), (1.0, 0.1)]
    section = shapes.polygon([(x * long, z * 1.6 + 0.2) for x, z in arm], 0.3)
    top = shapes.upright(section, 0.92 * wide)
    top -= shapes.upright(shapes.inset(section, 0.18), 0.92 * wide - 0.36)
    top -= shapes.box((long * 1.9, inner + 0.04, 1.2), (long / 2, 0, 0.1))
    blade = shapes.box((0.08, 0.5 * inner, 1.5), (long - 0.04, 0, 1.25))
    pin = shapes.along_y(shapes.cylinder(0.2, -0.55 * wide, 0.55 * wide)).translate(
        (back + 0.5, 0, 2.2)
    )
    placed = [
        solid.rotate((0, -open_deg, 0)).translate((back + 0.1, 0, 2.1))
        for solid in (rail, staples, pusher, coil, blade, top)
    ]
    return [
        Piece("pin", "pin", pin),
        Piece("anvil", "anvil", anvil),
        Piece("staples", "staples", placed[1]),
        Piece("pusher", "pusher", placed[2]),
        Piece("spring", "spring", placed[3]),
        Piece("rail", "rail", placed[0]),
        Piece("driver", "driver", placed[4]),
        Piece("base", "shell", base + ears),
        Piece("arm", "shell", placed[5]),
    ]


def tape_dispenser(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Heavy base with a reel of tape on a hub and a toothed cutter in front."""
    wide, roll = size_cm * rng.uniform(0.26, 0.34), size_cm * rng.uniform(0.24, 0.28)
    at = (-0.5 * size_cm + 1.15 * roll, 0.0, 1.25 * roll)
    side = [(-0.5, 0.0), (-0.5, 0.14), (-0.42, 0.3), (-0.05, 0.3), (0.2, 0.2), (0.4, 0.4)]
    side += [(0.46, 0.4), (0.5, 0.0)]
    outline = shapes.polygon([(x * size_cm, z * size_cm) for x, z in side], 0.04 * size_cm)
    body = shapes.upright(outline, wide)
    tape_wide = 0.55 * wide
    bay = shapes.along_y(shapes.cylinder(1.08 * roll, -0.36 * wide, 0.36 * wide)).translate(at)
    slope = shapes.box(
        (0.4 * size_cm, 0.72 * wide, 0.3 * size_cm), (0.2 * size_cm, 0, 0.39 * size_cm)
    )
    ballast = shapes.box((0.8 * size_cm, 0.8 * wide, 0.1 * size_cm), (0, 0, 0.075 * size_cm))
    ballast -= shapes.along_y(shapes.cylinder(1.12 * roll, -wide, wide)).translate(at)
    half = tape_wide / 2
    hub = shapes.along_y(shapes.tube(0.5 * roll, 0.2 * roll, -half, half)).translate(at)
    core = shapes.along_y(shapes.tube(0.56 * roll, 0.5 * roll, -half, half)).translate(at)
    tape = shapes.along_y(
        shapes.tube(roll * rng.uniform(0.75, 1.0), 0.56 * roll, -half, half)
    ).translate(at)
    axle = shapes.along_y(shapes.cylinder(0.2 * roll, -0.45 * wide, 0.45 * wide)).translate(at)
    teeth = [(-half, 0.0), (half, 0.0), (half, 0.5)]
    teeth += [(half - half * i / 8, 0.5 + 0.14 * (i % 2)) for i in range(1, 16)] + [(-half, 0.5)]
    cutter = shapes.upright_across(shapes.polygon(teeth), 0.08).rotate((0, 12, 0))
    cheeks = shapes.along_y(
        shapes.cylinder(0.42 * roll, -0.5 * wide, -0.3 * wide)
        + shapes.cylinder(0.42 * roll, 0.3 * wide, 0.5 * wide)
    ).translate(at)
    holders = shapes.box((0.84 * roll, wide, at[2]), (at[0], 0, at[2] / 2)) - bay
    return [
        Piece("cutter", "cutter", cutter.translate((0.43 * size_cm, 0, 0.37 * size_cm))),
        Piece("axle", "hub", axle),
        Piece("hub", "hub", hub),
        Piece("core", "core", core),
        Piece("tape", "tape", tape),
        Piece("ballast", "ballast", ballast),
        Piece("body", "shell", (body - bay - slope) + (holders + cheeks - bay)),
    ]


def paper_punch(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Lever over two sprung punches in a frame, a chip tray in the base."""
    deep, gap = size_cm * rng.uniform(0.75, 0.95), min(8.0, 0.72 * size_cm)
    base = shapes.slab(shapes.rounded_rectangle(size_cm, deep, 0.5), 0.0, 1.2, 0.15)
    base -= shapes.slab(shapes.rounded_rectangle(size_cm - 0.3, deep - 0.3, 0.4), -1.0, 0.9)
    tray = shapes.slab(shapes.rounded_rectangle(size_cm - 0.3, deep - 0.3, 0.4), 0.0, 0.15)
    stand = shapes.box((1.5, 1.8, 2.2), (0, 0.1 * deep, 2.5))
    stand -= shapes.box((9.0, 9.0, 0.2), (0, -4.5 + 0.1 * deep + 0.5, 1.5))
    punch = shapes.cylinder(0.3, 1.0, 4.0) - shapes.cylinder(0.2, 0.9, 1.6)
    well = shapes.cylinder(0.55, 2.2, 9.0) + shapes.cylinder(0.3, 0.0, 9.0)
    coil = skins.spring(0.5, 0.06, 2.2, 3.7, 4.5)
    tip = shapes.cylinder(0.5, 3.7, 4.0)
    pieces = []
    frame = Manifold()
    for name, x in (("left", -gap / 2), ("right", gap / 2)):
        place = (x, 0.1 * deep, 0.0)
        pieces.append(Piece(f"{name}_punch", "punch", (punch + tip).translate(place)))
        pieces.append(Piece(f"{name}_spring", "spring", coil.translate(place)))
        frame += (stand - well.translate((0, 0.1 * deep, 0))).translate((x, 0, 0))
    lever = [
        (-0.5, 4.3),
        (0.38, 3.6),
        (0.46, 2.3),
        (0.5, 2.5),
        (0.46, 4.0),
        (0.3, 4.4),
        (-0.5, 4.5),
    ]
    plate = shapes.upright_across(
        shapes.polygon([(y * deep, z) for y, z in lever], 0.04), 0.95 * size_cm
    )
    ears = shapes.box((0.16, 1.4, 2.4), (0, 0.42 * deep, 2.35))
    posts = ears.translate((-0.44 * size_cm, 0, 0)) + ears.translate((0.44 * size_cm, 0, 0))
    return [
        *pieces,
        Piece(
            "frame",
            "frame",
            frame + posts + shapes.box((0.96 * size_cm, 0.5 * deep, 0.2), (0, 0.2 * deep, 1.3)),
        ),
        Piece("lever", "lever", plate),
        Piece("tray", "tray", tray),
        Piece("base", "base", base),
    ]


def notebook(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Block of pages between two covers on a wire spiral."""
    wide, thick = size_cm * rng.uniform(0.66, 0.76), rng.uniform(0.5, 1.5)
    cover, wire = rng.uniform(0.06, 0.14), 0.06
    page = shapes.polygon([(0, 0), (wide, 0), (wide, size_cm), (0, size_cm)], 0.15)
    turns = int(size_cm / 0.8)
    coil = skins.spring(0.55 * thick + 0.35, wire, 0.4, size_cm - 0.4, turns)
    coil = coil.rotate((-90, 0, 0)).translate((0.1, 0, thick / 2))
    holes = shapes.union(
        shapes.cylinder(0.16, -9, 9).translate((0.45, 0.8 * (i + 0.5) + 0.2, 0))
        for i in range(turns)
    )
    return [
        Piece("spiral", "wire", coil),
        Piece("pages", "pages", shapes.slab(page, 0.0, thick) - holes),
        Piece("front", "cover", shapes.slab(page, thick, thick + cover) - holes),
        Piece("back", "cover", shapes.slab(page, -cover, 0.0) - holes),
    ]


def calculator(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Shell with a board, a coin cell, a display under a window and rows of keys."""
    wide, high, wall = size_cm * rng.uniform(0.55, 0.66), rng.uniform(1.1, 1.7), 0.16
    outside = shapes.slab(shapes.rounded_rectangle(size_cm, wide, 0.5), 0.0, high, 0.25)
    inside = shapes.slab(
        shapes.rounded_rectangle(size_cm - 2 * wall, wide - 2 * wall, 0.4), wall, high - wall
    )
    board_z = high - wall - 0.3
    board = shapes.box((size_cm - 0.9, wide - 0.9, 0.14), (0, 0, board_z - 0.07))
    cell = shapes.cylinder(1.0, board_z - 0.46, board_z - 0.14).translate((-0.25 * size_cm, 0, 0))
    glass = shapes.box((0.24 * size_cm, 0.74 * wide, 0.26), (0.32 * size_cm, 0, board_z + 0.13))
    window = shapes.box((0.26 * size_cm, 0.8 * wide, wall), (0.32 * size_cm, 0, high - wall / 2))
    columns, rows = 4, int(rng.integers(4, 6))
    mat = shapes.box((0.62 * size_cm, 0.86 * wide, 0.1), (-0.14 * size_cm, 0, board_z + 0.05))
    pitch = (0.62 * size_cm / rows, 0.86 * wide / columns)
    button = shapes.slab(
        shapes.rounded_rectangle(0.7 * pitch[0], 0.7 * pitch[1], 0.12), board_z, high + 0.15, 0.04
    )
    keys = mat + shapes.union(
        button.translate((-0.45 * size_cm + (i + 0.5) * pitch[0], (j - 1.5) * pitch[1], 0))
        for i in range(rows)
        for j in range(columns)
    )
    post = shapes.cylinder(0.2, wall - 0.01, board_z - 0.14)
    posts = shapes.union(
        post.translate((x * (size_cm / 2 - 1.0), y * (wide / 2 - 1.0), 0))
        for x in (-1, 1)
        for y in (-1, 1)
    )
    return [
        Piece("cell", "cell", cell),
        Piece("board", "board", board),
        Piece("display", "display", glass),
        Piece("window", "window", window),
        Piece("keys", "keypad", keys),
        Piece("shell", "shell", (outside - inside) + posts),
    ]


def ruler(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Strip with a bevelled edge, cut graduations and a hole to hang it."""
    wide, thick = rng.uniform(2.6, 3.6), rng.uniform(0.1, 0.28)
    side = [(0, 0), (wide, 0), (wide, thick), (0.7, thick), (0, 0.35 * thick)]
    strip = shapes.upright_across(shapes.polygon(side), size_cm).translate((size_cm / 2, 0, 0))
    marks = [
        shapes.box((0.06, 2 * length, 9.0), (0.5 + 0.5 * i, 0.0, 4.5 + 0.3 * thick))
        for i in range(int(2 * (size_cm - 1.0)) + 1)
        for length in [1.4 if i % 10 == 0 else 1.0 if i % 2 == 0 else 0.6]
    ]
    hole = shapes.cylinder(0.3, -1.0, 1.0).translate((size_cm - 0.7, 0.6 * wide, 0))
    return [Piece("body", "body", strip - shapes.union(marks) - hole)]


def sharpener(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Wedge with a tapered hole, ribbed cheeks, a blade and its screw."""
    wide, high = 0.62 * size_cm, size_cm * rng.uniform(0.42, 0.5)
    waist = [(0, 0.36), (0.2, 0.5), (0.35, 0.38), (0.65, 0.38), (0.8, 0.5), (1.0, 0.5)]
    points = [(x * size_cm, y * wide) for x, y in waist]
    plan = shapes.polygon([*points, *((x, -y) for x, y in reversed(points))])
    ramp = [(0, 0), (size_cm, 0), (size_cm, high), (0, 0.72 * high)]
    body = shapes.slab(plan, 0.0, high) ^ shapes.upright(shapes.polygon(ramp), 2 * wide)
    hole = shapes.cylinder(0.1, 0.0, 0.9 * size_cm, 0.4 * high)
    hole += shapes.cylinder(0.4 * high, 0.899 * size_cm, 2 * size_cm)
    body -= shapes.along_x(hole).translate((0.02, 0, 0.46 * high))
    slope = float(np.degrees(np.arctan2(0.28 * high, size_cm)))
    blade = shapes.box((0.75 * size_cm, 0.62 * wide, 0.06), (0.5 * size_cm, 0, 0.03))
    tilted = blade.rotate((0, -slope, 0)).translate((0, 0, 0.7 * high))
    screw = shapes.cylinder(0.11, -0.35, 0.0) + shapes.cylinder(0.24, 0.0, 0.14)
    at = (0.5 * size_cm, -0.12 * wide, 0.75 * high + 0.14 * high)
    return [
        Piece("screw", "screw", screw.rotate((0, -slope, 0)).translate(at)),
        Piece("blade", "blade", tilted),
        Piece("body", "body", body),
    ]


def eraser(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Worn block in a cardboard sleeve."""
    wide, high = size_cm * rng.uniform(0.35, 0.48), size_cm * rng.uniform(0.18, 0.26)
    block = shapes.rounded_box((size_cm, wide, high), 0.16 * high)
    worn = shapes.sphere(size_cm).translate((-1.42 * size_cm, 0, 0.4 * size_cm))
    block -= worn
    start, sleeve = -0.2 * size_cm, 0.05
    long = 0.55 * size_cm
    band = CrossSection.square((high + 2 * sleeve, wide + 2 * sleeve), center=True)
    band -= CrossSection.square((high, wide), center=True)
    wrap = shapes.along_x(shapes.slab(band, start, start + long))
    return [Piece("block", "block", block), Piece("sleeve", "sleeve", wrap)]


def stamp(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Knob on a mount, foam under it, a rubber face with raised lines."""
    side = size_cm * rng.uniform(0.5, 0.75)
    deep, foot = side * rng.uniform(0.45, 0.8), 0.3
    face = shapes.slab(CrossSection.square((0.9 * side, 0.9 * deep), center=True), 0.12, foot)
    face += shapes.union(
        shapes.box((0.8 * side * rng.uniform(0.6, 1.0), 0.09 * deep, 0.13), (0, y * deep, 0.065))
        for y in (-0.3, -0.1, 0.1, 0.3)
    )
    pad = shapes.slab(CrossSection.square((0.9 * side, 0.9 * deep), center=True), foot, foot + 0.3)
    top = foot + 0.3 + 0.12 * size_cm
    mount = shapes.slab(shapes.rounded_rectangle(side, deep, 0.2), foot + 0.3, top, 0.1)
    r, rise = 0.3 * deep + 0.4, size_cm - top
    knob = [(0.0, 0.0), (0.7, 0.0), (0.45, 0.3), (0.6, 0.55), (1.0, 0.8), (0.8, 1.0), (0.0, 1.0)]
    handle = shapes.lathe(shapes.outline([(x * r, z * rise) for x, z in knob], 0.12 * r))
    dowel = shapes.cylinder(0.25 * r, top - 0.06 * size_cm, top + 0.25 * rise)
    return [
        Piece("dowel", "dowel", dowel),
        Piece("handle", "handle", handle.translate((0, 0, top))),
        Piece("mount", "mount", mount),
        Piece("pad", "pad", pad),
        Piece("face", "face", face),
    ]


ARCHETYPES: Final = {
    "calculator": Archetype(calculator, "cell board display window keypad shell"),
    "eraser": Archetype(eraser, "block sleeve"),
    "marker": Archetype(marker, "nib core cap barrel"),
    "notebook": Archetype(notebook, "wire pages cover"),
    "paper_punch": Archetype(paper_punch, "punch spring frame lever tray base"),
    "ruler": Archetype(ruler, "body"),
    "sharpener": Archetype(sharpener, "screw blade body"),
    "stamp": Archetype(stamp, "dowel handle mount pad face"),
    "stapler": Archetype(stapler, "pin anvil staples pusher spring rail driver shell"),
    "tape_dispenser": Archetype(tape_dispenser, "cutter hub core tape ballast shell"),
}
