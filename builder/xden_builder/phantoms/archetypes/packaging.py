"""Thin-walled packages: a drink can, a bucket."""

from __future__ import annotations

from typing import Final

import numpy as np

from xden_builder.phantoms import fittings, shapes
from xden_builder.phantoms.pieces import Archetype, Piece

__all__ = ["ARCHETYPES"]


def drink_can(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Drawn can with a necked rim, a lid with a tab, and a drink."""
    radius, wall = size_cm * rng.uniform(0.24, 0.28), 0.03
    profile = [(0, 0.6), (0.6 * radius, 0.3), (0.72 * radius, 0.0), (0.8 * radius, 0.0)]
    profile += [(radius, 0.9), (radius, size_cm - 1.4), (0.83 * radius, size_cm - 0.3)]
    shell, room = fittings.vessel([*profile, (0.83 * radius, size_cm)], wall)
    lid = shapes.cylinder(0.83 * radius, size_cm - 0.22, size_cm - 0.18)
    tab = shapes.slab(shapes.rounded_rectangle(2.2, 1.4, 0.5), size_cm - 0.19, size_cm - 0.08)
    drink = shapes.cut_above(room, (size_cm - 1.5) * rng.uniform(0.2, 0.98))
    return [
        Piece("drink", "liquid", drink),
        Piece("shell", "shell", shell),
        Piece("lid", "lid", lid + tab),
    ]


def bucket(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Tapered bucket with a rim and a wire bail; some hold water."""
    top, wall = 0.44 * size_cm, rng.uniform(0.15, 0.25)
    low, high = top * rng.uniform(0.7, 0.8), 0.7 * size_cm
    shell, room = fittings.vessel([(0, 0), (low, 0), (top, high)], wall, 0.2)
    rim = shapes.tube(top + 0.3, top - wall, high - 0.8, high) - room
    half = [(top + 0.1, high - 0.4), (0.98 * top, high + 0.1 * size_cm)]
    half += [(0.6 * top, 0.93 * size_cm)]
    line = [*half, (0.0, size_cm - 0.2), *((-x, z) for x, z in half[::-1])]
    bail = fittings.bar([(x, 0.0, z) for x, z in line], 0.2, count=50) - room
    pieces = [Piece("bail", "bail", bail), Piece("shell", "shell", shell + rim)]
    water = shapes.cut_above(room, high * rng.uniform(0.2, 0.7))
    return [Piece("water", "liquid", water), *pieces] if rng.random() < 0.5 else pieces


ARCHETYPES: Final = {
    "bucket": Archetype(bucket, "bail shell liquid"),
    "drink_can": Archetype(drink_can, "liquid lid shell"),
}
