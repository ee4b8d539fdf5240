"""Balls and weights: a plain ball, solid or hollow; a cored ball; a dumbbell."""

from __future__ import annotations

from typing import Final

import numpy as np

from xden_builder.phantoms import shapes, skins
from xden_builder.phantoms.pieces import Archetype, Piece, moved

__all__ = ["ARCHETYPES"]


def ball(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Ball of one material; two of three are hollow, which nothing outside tells."""
    radius = size_cm / 2
    body = shapes.sphere(radius)
    if rng.random() < 2 / 3:
        body -= shapes.sphere(radius * rng.uniform(0.82, 0.94))
    return [Piece("body", "body", body)]


def cored_ball(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Core, winding and cover, as a baseball has, with a raised seam."""
    radius = size_cm / 2
    cover, core = radius * rng.uniform(0.03, 0.05), radius * rng.uniform(0.35, 0.55)
    angle = 2 * np.pi * np.arange(120) / 120
    # the usual tennis-ball curve: a closed line on the sphere with two lobes
    x, y = np.cos(angle) + 0.32 * np.cos(3 * angle), np.sin(angle) - 0.32 * np.sin(3 * angle)
    seam = np.stack([x, y, 2 * np.sqrt(0.32) * np.sin(2 * angle)], axis=1)
    seam *= (radius - 0.05) / np.linalg.norm(seam, axis=1, keepdims=True)
    return [
        Piece("core", "core", shapes.sphere(core)),
        Piece("winding", "winding", shapes.sphere(radius - cover)),
        Piece("cover", "cover", shapes.sphere(radius - 0.04) + skins.pipe(seam, 0.09, closed=True)),
    ]


def dumbbell(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Bar with a swollen grip and two hexagonal iron heads in an elastic coat."""
    head, across = size_cm * rng.uniform(0.24, 0.29), size_cm * rng.uniform(0.36, 0.46)
    coat, bar = rng.uniform(0.25, 0.45), max(0.75, 0.055 * size_cm)
    middle = size_cm / 2
    grip = [(0, 0.9), (head, 0.9), (head + 0.4, 1.0), (middle, 1.25)]
    grip += [(size_cm - z, r) for z, r in reversed(grip[:-1])]
    profile = [(r * bar, z) for z, r in grip]
    shaft = shapes.lathe(shapes.outline([(0, 0), *profile, (0, size_cm)], 0.2))
    shaft = shaft.trim_by_plane((0, 0, 1), 0.3 * head).trim_by_plane(
        (0, 0, -1), 0.3 * head - size_cm
    )
    hexagon, core = (shapes.regular_polygon(6, width) for width in (across, across - 2 * coat))
    iron = shapes.slab(core, coat, head - coat, 0.3 * coat).rotate((0, 0, 90))
    cover = shapes.slab(hexagon, 0.0, head, 0.15 * head).rotate((0, 0, 90))
    pieces = [Piece("bar", "bar", shaft)]
    for end, solids in (("left", (iron, cover)), ("right", (iron, cover))):
        if end == "right":
            solids = tuple(s.mirror((0, 0, 1)).translate((0, 0, size_cm)) for s in solids)
        pieces.append(Piece(f"{end}_weight", "weight", solids[0]))
        pieces.append(Piece(f"{end}_coat", "coat", solids[1]))
    return moved(pieces, shapes.along_x)


ARCHETYPES: Final = {
    "ball": Archetype(ball, "body"),
    "cored_ball": Archetype(cored_ball, "core winding cover"),
    "dumbbell": Archetype(dumbbell, "bar weight coat"),
}
