"""Stationery: a pencil, a ballpoint pen, a glue stick."""

from __future__ import annotations

from typing import Final

import numpy as np
from manifold3d import Manifold

from xden_builder.phantoms import shapes, skins
from xden_builder.phantoms.pieces import Archetype, Piece, moved

__all__ = ["ARCHETYPES"]


def pencil(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Sharpened hexagonal wood around a lead, an eraser held by a ferrule."""
    across, lead = rng.uniform(0.66, 0.76), rng.uniform(0.1, 0.16)
    cone, end = rng.uniform(1.8, 2.6), size_cm - 0.9
    tip = shapes.cylinder(0.02, 0.0, cone, across) + shapes.cylinder(2 * across, cone, size_cm)
    wood = Manifold.extrude(shapes.regular_polygon(6, across).rotate(90.0), end) ^ tip
    wood -= shapes.cylinder(2 * lead, -1.0, lead * cone / across)  # bare lead at the point
    ferrule = shapes.tube(across / 2 + 0.05, across / 2 - 0.04, end - 0.6, end + 0.45)
    grooves = shapes.union(
        shapes.tube(across, across / 2 + 0.02, end + z, end + z + 0.1) for z in (-0.4, -0.2, 0.2)
    )
    eraser = shapes.slab(shapes.disc(across / 2 - 0.04), end, size_cm, 0.08)
    pieces = [
        Piece("ferrule", "ferrule", ferrule - grooves),
        Piece("lead", "lead", shapes.cylinder(lead, 0.0, end - 0.05) ^ tip),
        Piece("eraser", "eraser", eraser),
        Piece("wood", "wood", wood),
    ]
    return moved(pieces, shapes.along_x)


def pen(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Ballpoint pen: barrel, refill with some of its ink, brass point, spring, button, clip."""
    radius, wall = rng.uniform(0.48, 0.62), 0.13
    top, flange = 0.88 * size_cm, 0.26 * size_cm
    level = rng.uniform(0.3, 0.95)
    return moved(_refill(flange, 0.8 * size_cm, level), shapes.along_x) + moved(
        [
            Piece("spring", "spring", skins.spring(0.24, 0.025, 1.25, flange, 9.0)),
            Piece("button", "button", _push_button(0.8 * size_cm, size_cm)),
            Piece("clip", "clip", _clip(radius, 0.6 * size_cm, top)),
            Piece("barrel", "barrel", _barrel(radius, wall, top)),
        ],
        shapes.along_x,
    )


def _refill(flange: float, end: float, level: float) -> list[Piece]:
    """Point at z = 0, tube behind it, ink up to a share of the tube."""
    point = [(0, 0.0), (0.04, 0.0), (0.11, 0.9), (0.11, 1.5), (0.08, 1.5), (0.08, 2.0), (0, 2.0)]
    full = 2.0 + level * (end - 2.5)
    tube = shapes.tube(0.14, 0.08, 1.5, end)
    ring = shapes.tube(0.26, 0.1, flange, flange + 0.25)
    return [
        Piece("point", "point", shapes.lathe(shapes.outline(point))),
        Piece("ink", "ink", shapes.cylinder(0.08, 2.0, full)),
        Piece("refill", "refill", tube + ring),
    ]


def _barrel(radius: float, wall: float, top: float) -> Manifold:
    """Tapered tube; the refill's point sticks out of its nose, the button out of its end."""
    nose = 0.55
    outer = [(0, nose), (0.2, nose), (0.75 * radius, 2.4), (radius, 4.5), (radius, top), (0, top)]
    body = shapes.lathe(shapes.outline(outer, 0.05))
    cavity = shapes.cylinder(0.12, 0.0, 1.3) + shapes.cylinder(0.27, 1.25, 2.5)
    cavity += shapes.cylinder(0.27, 2.4, 4.5, radius - wall)
    cavity += shapes.cylinder(radius - wall, 4.5, top - 0.3)
    return body - cavity - shapes.cylinder(0.3, top - 0.5, top + 1.0)


def _push_button(refill_end: float, end: float) -> Manifold:
    """Plunger that holds the refill's end."""
    rod = shapes.slab(shapes.disc(0.3), refill_end - 0.5, end, 0.08)
    return rod - shapes.cylinder(0.14, 0.0, refill_end)


def _clip(radius: float, low: float, top: float) -> Manifold:
    """Strip along the barrel, hung on a ring under its end; up when the pen lies."""
    strip = shapes.box((0.08, 0.35, top - low), (-radius - 0.16, 0, (top + low) / 2))
    bridge = shapes.box((0.22, 0.35, 0.12), (-radius - 0.09, 0, top - 0.06))
    ball = shapes.sphere(0.12, (-radius - 0.1, 0, low + 0.15))
    return strip + bridge + ball + shapes.tube(radius + 0.04, radius - 0.05, top - 0.3, top)


def glue_stick(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Stick on a platform that a screw drives, in a tube with base knob and cap."""
    radius, wall = size_cm * rng.uniform(0.11, 0.15), rng.uniform(0.1, 0.14)
    bore, joint = radius - wall, 0.62 * size_cm
    knob = 0.12 * size_cm
    screw = shapes.thread(0.24, 0.15, 0.25, 0.4 * knob, 0.55 * size_cm)
    platform = knob + (joint - knob) * rng.uniform(0.15, 0.5)
    holder = shapes.cylinder(bore, platform, platform + 0.15)
    holder += shapes.tube(bore, bore - 0.08, platform, platform + 0.5)
    glue = shapes.slab(shapes.disc(bore - 0.001), platform + 0.15, joint + 0.6, 0.15)
    tube = shapes.tube(radius, bore, knob + 0.03, joint)
    lip = shapes.tube(radius - 0.5 * wall, bore, joint, joint + 0.8)
    foot = shapes.slab(shapes.disc(radius), 0.0, knob, 0.06)
    hood = shapes.slab(shapes.disc(radius), joint + 0.02, size_cm, 0.1)
    hood -= shapes.cylinder(radius - 0.5 * wall, joint, size_cm - wall)
    return [
        Piece("screw", "screw", screw),
        Piece("holder", "holder", holder),
        Piece("glue", "glue", glue),
        Piece("knob", "knob", foot),
        Piece("tube", "shell", tube + lip),
        Piece("cap", "cap", hood),
    ]


ARCHETYPES: Final = {
    "glue_stick": Archetype(glue_stick, "screw holder glue knob shell cap"),
    "pen": Archetype(pen, "point ink refill spring button clip barrel"),
    "pencil": Archetype(pencil, "ferrule lead eraser wood"),
}
