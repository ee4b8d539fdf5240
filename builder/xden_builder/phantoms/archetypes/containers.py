"""Containers with a lid that stand and hold a liquid: a bottle, a jar."""

from __future__ import annotations

import numpy as np
from manifold3d import CrossSection, Manifold

from xden_builder.phantoms import shapes
from xden_builder.phantoms.pieces import Piece

__all__ = ["bottle", "jar"]


def bottle(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Bottle with a neck, a cap and a liquid; above the liquid is air."""
    radius = size_cm * rng.uniform(0.14, 0.18)
    wall = 0.1 * rng.uniform(0.8, 1.2) + 0.012 * radius
    neck, cap_wall = radius * rng.uniform(0.36, 0.46), 0.16
    rim, shoulder = size_cm - cap_wall, size_cm * rng.uniform(0.58, 0.68)
    dent, foot = 0.12 * radius, 0.75 * radius
    profile = [(0.0, dent), (foot, 0.0), (radius, 0.0), (radius, shoulder)]
    profile += [(neck, 0.86 * size_cm), (neck, rim), (0.0, rim)]
    outer = shapes.outline(profile, 0.3 * neck)
    hollow = shapes.inset(outer, wall) + _bore(neck - wall, 0.86 * size_cm, size_cm)
    glass = _cut_above(shapes.lathe(outer - hollow), rim - 0.3 * neck)
    glass += shapes.tube(neck, neck - wall, rim - 0.31 * neck, rim)
    fill = rng.uniform(0.35, 0.65) * (shoulder + 0.86 * size_cm) / 2
    return [
        Piece("shell", "shell", glass),
        Piece("liquid", "liquid", _filled(shapes.lathe(hollow), fill)),
        Piece("cap", "cap", _screw_cap(neck, 0.89 * size_cm, rim, cap_wall)),
    ]


def jar(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Wide-mouthed jar with a screw lid and something thick in it."""
    radius = size_cm * rng.uniform(0.3, 0.38)
    wall, neck, rim = 0.05 * radius + 0.15, 0.88 * radius, size_cm - 0.12
    profile = [(0.0, 0.1), (0.7 * radius, 0.0), (radius, 0.0), (radius, 0.8 * size_cm)]
    profile += [(neck, 0.87 * size_cm), (neck, rim + 1.0), (0.0, rim + 1.0)]
    outer = shapes.outline(profile, 0.12 * radius)
    hollow = shapes.inset(outer, wall) + _bore(neck - wall, 0.87 * size_cm, rim + 2.0)
    fill = rng.uniform(0.3, 0.8) * 0.87 * size_cm
    return [
        Piece("shell", "shell", _cut_above(shapes.lathe(outer - hollow), rim)),
        Piece("contents", "liquid", _filled(shapes.lathe(hollow), fill)),
        Piece("lid", "lid", _screw_cap(neck, 0.885 * size_cm, rim, 0.12)),
    ]


def _bore(radius: float, z0: float, z1: float) -> CrossSection:
    return CrossSection.square((2 * radius, z1 - z0)).translate((-radius, z0))


def _cut_above(solid: Manifold, z: float) -> Manifold:
    return solid.trim_by_plane((0.0, 0.0, -1.0), -z)


def _filled(cavity: Manifold, level: float) -> Manifold:
    """Liquid in an upright cavity."""
    return _cut_above(cavity, level)


def _screw_cap(neck: float, z0: float, rim: float, wall: float) -> Manifold:
    """Cap that sits on a rim and grips the neck, ribbed outside."""
    ribs = 4 * max(6, round(6 * neck))
    angles = 2 * np.pi * np.arange(2 * ribs) / (2 * ribs)
    radii = neck + wall + 0.02 * (-1.0) ** np.arange(2 * ribs)
    outside = CrossSection([radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)])
    block = Manifold.extrude(outside, rim + wall - z0).translate((0.0, 0.0, z0))
    return block - shapes.cylinder(neck, z0 - 1.0, rim)
