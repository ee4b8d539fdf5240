"""Tools that turn or pry: spanners, an adjustable spanner, a hexagon key, a crowbar."""

from __future__ import annotations

from typing import Final

import numpy as np
from manifold3d import CrossSection, Manifold

from xden_builder.phantoms import shapes, skins
from xden_builder.phantoms.pieces import Archetype, Piece

__all__ = ["ARCHETYPES"]


def wrench(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Spanner with an open jaw at one end, a ring at the other, and a panelled shank."""
    flats = size_cm * rng.uniform(0.07, 0.09)
    ring, jaw = 0.85 * flats, 1.12 * flats
    thick, x_ring, x_jaw = 0.42 * flats, size_cm / 2 - ring, jaw - size_cm / 2
    shank = CrossSection.square((x_ring - x_jaw, 0.85 * flats), center=True)
    shank = shank.translate(((x_ring + x_jaw) / 2, 0.0))
    panel = shapes.rounded_rectangle(0.55 * (x_ring - x_jaw), 0.4 * flats, 0.15 * flats)
    body = shapes.slab(shank, -0.7 * thick, 0.7 * thick, 0.12 * flats)
    for side in (-1, 1):
        low, high = sorted((side * 0.45 * thick, side * 2 * thick))
        body -= shapes.slab(panel, low, high)
    body += shapes.slab(shapes.disc(jaw), -thick, thick, 0.1 * flats).translate((x_jaw, 0, 0))
    body += shapes.slab(shapes.disc(ring), -1.25 * thick, 1.25 * thick, 0.1 * flats).translate(
        (x_ring, 0, 0)
    )
    hexagon = shapes.regular_polygon(6, flats)
    star = hexagon + hexagon.rotate(30.0)
    throat = CrossSection.square((3 * flats, flats), center=True).translate((-1.5 * flats, 0.0))
    mouth = (throat + shapes.regular_polygon(6, flats)).rotate(15.0)
    for opening, x in ((star, x_ring), (mouth, x_jaw)):
        body -= shapes.slab(opening, -4 * thick, 4 * thick).translate((x, 0, 0))
    return [Piece("body", "body", body)]


def adjustable_spanner(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Handle with a fixed jaw, and a sliding one whose rack a worm drives, turning on a pin."""
    head, thick = size_cm * rng.uniform(0.13, 0.15), 0.035 * size_cm
    gap = head * rng.uniform(0.25, 0.6)
    front = size_cm - 0.9 * head
    handle = [(0.0, -0.4), (0.0, 0.4), (0.3, 0.34), (1.0, 0.5), (1.0, -0.5), (0.3, -0.34)]
    outline = shapes.polygon([(x * front, y * head) for x, y in handle], 0.2 * head)
    outline += shapes.polygon([(x * head + front, y * head) for x, y in _SPANNER_HEAD], 0.12 * head)
    eye = shapes.disc(0.2 * head, (0.35 * head, 0.0))
    fixed = shapes.slab(outline - eye, -thick, thick)
    slot = shapes.box((0.2 * head, 3 * head, 0.9 * thick), (front - 0.02 * head, -0.3 * head, 0.0))
    bay = shapes.box((0.62 * head, 0.62 * head, 4 * thick), (front - 0.52 * head, -0.2 * head, 0))
    jaw = [(0.0, -gap - 0.75 * head), (0.75 * head, -gap - 0.6 * head), (0.85 * head, -gap)]
    jaw += [(0.0, -gap)]
    mover = shapes.slab(shapes.polygon(jaw, 0.05 * head), -thick, thick).translate(
        (front + 0.1 * head, 0.5 * head, 0)
    )
    rail = shapes.box(
        (0.2 * head, 1.5 * head, 0.88 * thick), (front - 0.0, -0.25 * head - gap / 2, 0)
    )
    worm = shapes.along_y(
        shapes.thread(0.22 * head, 0.16 * head, 0.1 * head, -0.28 * head, 0.28 * head)
    ).translate((front - 0.34 * head, -0.2 * head, 0))
    pin = shapes.along_y(shapes.cylinder(0.06 * head, -0.5 * head, 0.4 * head))
    return [
        Piece("pin", "pin", pin.translate((front - 0.34 * head, -0.2 * head, 0))),
        Piece("worm", "worm", worm),
        Piece("jaw", "jaw", mover + rail),
        Piece("body", "body", fixed - slot - bay),
    ]


_SPANNER_HEAD: Final = [
    (-0.9, -0.45),
    (-0.9, 0.5),
    (-0.2, 0.95),
    (0.85, 1.0),
    (0.8, 0.5),
    (0.1, 0.5),
    (0.1, -0.75),
    (-0.3, -0.9),
]


def hex_key(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Hexagonal bar with one bend."""
    flats = size_cm * rng.uniform(0.045, 0.08)
    bend, short = 1.6 * flats, size_cm * rng.uniform(0.28, 0.4)
    hexagon = shapes.regular_polygon(6, flats)
    corner = Manifold.revolve(hexagon.translate((bend, 0.0)), 48, 90.0)
    long = Manifold.extrude(hexagon, size_cm - bend).rotate((90, 0, 0)).translate((bend, 0, 0))
    arm = Manifold.extrude(hexagon.rotate(90.0), short - bend).rotate((0, -90, 0))
    body = corner + long + arm.translate((0, bend, 0))
    return [Piece("body", "body", body.rotate((0, 0, 90)))]


def crowbar(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Bar with a hooked claw at one end and a flat chisel at the other."""
    bar, hook = size_cm * rng.uniform(0.022, 0.028), size_cm * rng.uniform(0.1, 0.13)
    top = size_cm - hook
    arc = np.linspace(np.pi, 0.15 * np.pi, 22)
    bend = np.stack([hook / 2 * (1 + np.cos(arc)), 0 * arc, top + hook * np.sin(arc)], axis=1)
    straight = np.array([[0, 0, z] for z in np.linspace(0.12 * size_cm, 0.99 * top, 6)])
    path = np.concatenate([straight, bend])
    body = skins.pipe(path, bar)
    foot = skins.loft([(0.0, 0.12 * bar, 1.6 * bar), (0.125 * size_cm, bar, bar)], 2.6)
    tip = bend[-1]
    claw = skins.loft(
        [
            (0.0, 0.15 * bar, 1.9 * bar),
            (0.09 * size_cm, 0.8 * bar, 1.5 * bar),
            (0.12 * size_cm, 0.9 * bar, bar),
        ],
        2.6,
    )
    claw -= shapes.upright_across(
        shapes.polygon([(-0.9 * bar, -0.1), (0.9 * bar, -0.1), (0.0, 0.07 * size_cm)]), 9 * bar
    )
    claw = claw.translate((0, 0, -0.11 * size_cm)).rotate((0, -25, 0)).translate(tuple(tip))
    laid = (body + foot + claw).rotate((90, 0, 0))
    return [Piece("body", "body", laid.rotate((0, 0, 90)))]


ARCHETYPES: Final = {
    "adjustable_spanner": Archetype(adjustable_spanner, "pin worm jaw body"),
    "crowbar": Archetype(crowbar, "body"),
    "hex_key": Archetype(hex_key, "body"),
    "wrench": Archetype(wrench, "body"),
}
