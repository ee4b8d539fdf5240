"""Containers with a lid that stand and hold a liquid: a bottle, a jar."""

from __future__ import annotations

from typing import Final

import numpy as np
from manifold3d import CrossSection, Manifold

from xden_builder.phantoms import shapes
from xden_builder.phantoms.pieces import Archetype, Piece

__all__ = ["ARCHETYPES"]


def bottle(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Bottle with a neck, a cap and a liquid; above the liquid is air."""
    radius = size_cm * rng.uniform(0.14, 0.18)
    wall = 0.1 * rng.uniform(0.8, 1.2) + 0.012 * radius
    neck, cap_wall = radius * rng.uniform(0.36, 0.46), 0.16
    rim, shoulder = size_cm - cap_wall, size_cm * rng.uniform(0.58, 0.68)
    profile = [(0.0, 0.12 * radius), (0.75 * radius, 0.0), (radius, 0.0), (radius, shoulder)]
    profile += [(neck, 0.86 * size_cm)]
    fill = rng.uniform(0.35, 0.65) * (shoulder + 0.86 * size_cm) / 2
    shell, liquid = _vessel(profile, wall, rim, fill, 0.3 * neck)
    return [
        Piece("shell", "shell", shell),
        Piece("liquid", "liquid", liquid),
        Piece("cap", "cap", _screw_cap(neck, 0.89 * size_cm, rim, cap_wall)),
    ]


def jar(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Wide-mouthed jar with a screw lid and something liquid in it."""
    radius = size_cm * rng.uniform(0.3, 0.38)
    wall, neck, rim = 0.05 * radius + 0.15, 0.88 * radius, size_cm - 0.12
    profile = [(0.0, 0.1), (0.7 * radius, 0.0), (radius, 0.0), (radius, 0.8 * size_cm)]
    profile += [(neck, 0.87 * size_cm)]
    fill = rng.uniform(0.3, 0.8) * 0.87 * size_cm
    shell, contents = _vessel(profile, wall, rim, fill, 0.12 * radius)
    return [
        Piece("shell", "shell", shell),
        Piece("contents", "liquid", contents),
        Piece("lid", "lid", _screw_cap(neck, 0.885 * size_cm, rim, 0.12)),
    ]


def _vessel(
    profile: list[tuple[float, float]], wall: float, rim: float, fill: float, fillet: float
) -> tuple[Manifold, Manifold]:
    """Shell of even wall whose neck goes straight up to an open rim, and its liquid."""
    neck, beyond = profile[-1][0], rim + 1.0  # closed beyond the rim, then cut open
    outside = shapes.outline([*profile, (neck, beyond), (0.0, beyond)], fillet)
    cavity = shapes.lathe(shapes.inset(outside, wall))
    shell = shapes.cut_above(shapes.lathe(outside) - cavity, rim)
    return shell, shapes.cut_above(cavity, fill)


def _screw_cap(neck: float, z0: float, rim: float, wall: float) -> Manifold:
    """Cap that sits on a rim and grips the neck, ribbed outside."""
    ribs = 4 * max(6, round(6 * neck))
    angles = 2 * np.pi * np.arange(2 * ribs) / (2 * ribs)
    radii = neck + wall + 0.02 * (-1.0) ** np.arange(2 * ribs)
    outside = CrossSection([radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)])
    block = Manifold.extrude(outside, rim + wall - z0).translate((0.0, 0.0, z0))
    return block - shapes.cylinder(neck, z0 - 1.0, rim)


ARCHETYPES: Final = {
    "bottle": Archetype(bottle, "shell liquid cap"),
    "jar": Archetype(jar, "shell liquid lid"),
}
