"""Hardware: a bolt with washer and nut, a padlock."""

from __future__ import annotations

from math import pi
from typing import Final

import numpy as np
from manifold3d import Manifold

from xden_builder.phantoms import shapes, skins
from xden_builder.phantoms.pieces import Archetype, Piece, moved

__all__ = ["ARCHETYPES"]


def bolt(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Hexagon-head bolt with a washer and a nut somewhere on its thread."""
    major = size_cm * rng.uniform(0.07, 0.1)
    head, pitch = 1.3 * major, 0.36 * major  # about ISO 4014 with a coarse thread
    plain = head + (size_cm - head) * rng.uniform(0.15, 0.4)
    hexagon = shapes.regular_polygon(6, 3.2 * major).rotate(90.0)
    rod = shapes.thread(major, major - 0.6 * pitch, pitch, plain, size_cm)
    cone = shapes.cylinder(major + size_cm - plain, plain, size_cm, 0.75 * major)
    body = shapes.slab(hexagon, 0.0, head, 0.12 * major) + shapes.cylinder(major, head, plain)
    washer_z = plain + (size_cm - plain) * rng.uniform(0.15, 0.5)
    nut_z, nut = washer_z + 0.3 * major, 1.6 * major
    nut_body = shapes.slab(hexagon, nut_z, nut_z + nut, 0.15 * major)
    washer = shapes.tube(2.0 * major, major, washer_z, nut_z)
    pieces = [
        Piece("bolt", "bolt", body + (rod ^ cone)),
        Piece("washer", "washer", washer),
        Piece("nut", "nut", nut_body),
    ]
    return moved(pieces, shapes.along_x)


def padlock(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Body with a shackle in two holes, one deep and one shallow, and a plug with pins."""
    high, wide = 0.56 * size_cm, size_cm * rng.uniform(0.5, 0.6)
    thick, bar = size_cm * rng.uniform(0.24, 0.32), size_cm * rng.uniform(0.05, 0.065)
    leg = wide / 2 - 1.9 * bar
    outside = shapes.rounded_box((wide, thick, high), 0.06 * size_cm, (0, 0, high / 2))
    hollows = shapes.union(  # under the legs, whose holes they end
        shapes.cylinder(0.9 * bar, z, z + 0.06 * high).translate((x, 0, 0))
        for x, z in ((-leg, 0.4 * high), (leg, 0.68 * high))
    )
    plug_radius = 0.3 * thick
    plug, pins = _plug(plug_radius, 0.62 * high, thick)
    shackle = _shackle(leg, bar, high, size_cm)
    return [
        Piece("shackle", "shackle", shackle),
        *(Piece(f"pin_{i + 1}", "pin", pin) for i, pin in enumerate(pins)),
        Piece("plug", "plug", plug),
        Piece("body", "shell", outside - hollows - _keyway(plug_radius, 0.5 * high)),
    ]


def _shackle(leg: float, bar: float, high: float, size: float) -> Manifold:
    """Bent bar whose legs end in the holes, each a little above the ground of its own."""
    rise = size - bar - leg
    arc = np.linspace(pi, 0.0, 28)
    bend = np.stack([leg * np.cos(arc), 0 * arc, rise + leg * np.sin(arc)], axis=1)
    starts = np.array([[-leg, 0.0, 0.45 * high], [-leg, 0.0, rise - 0.02]])
    ends = np.array([[leg, 0.0, rise - 0.02], [leg, 0.0, 0.73 * high]])
    return skins.pipe(np.concatenate([starts, bend, ends]), bar)


def _plug(radius: float, high: float, thick: float) -> tuple[Manifold, list[Manifold]]:
    """Cylinder to be turned, with a keyway, and the pins that cross its edge."""
    plug = shapes.cylinder(radius, 0.02, high) - _keyway(radius, 0.8 * high)
    pin = shapes.along_y(shapes.cylinder(0.18 * radius, 0.25 * radius, 0.42 * thick))
    return plug, [pin.translate((0, 0, high * z)) for z in (0.25, 0.4, 0.55, 0.7)]


def _keyway(radius: float, high: float) -> Manifold:
    """Slot for the key, from below."""
    return shapes.box((0.3 * radius, 1.3 * radius, high), (0, -0.2 * radius, high / 2 - 0.01))


ARCHETYPES: Final = {
    "bolt": Archetype(bolt, "bolt washer nut"),
    "padlock": Archetype(padlock, "shackle pin plug shell"),
}
