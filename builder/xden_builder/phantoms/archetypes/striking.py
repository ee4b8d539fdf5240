"""Heads on a handle (mallet, axe) and blades with a tang (chisel, garden trowel)."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Final

import numpy as np
from manifold3d import Manifold

from xden_builder.phantoms import shapes, skins
from xden_builder.phantoms.pieces import Archetype, Piece, moved

__all__ = ["ARCHETYPES"]

Head = Callable[[np.random.Generator, float], Manifold]
"""Random numbers and a width to a head: the handle runs along x, the blow along y."""

Blade = Callable[[np.random.Generator, float, float], Manifold]
"""Random numbers, length and half width to a blade, upwards from z = 0, flat in y."""


# --- heads on a handle ----------------------------------------------------------------------------


def striker(rng: np.random.Generator, size_cm: float, head: Head, wide: float) -> list[Piece]:
    """Handle that fills the eye of a head, spread there by a wedge; ``wide`` is the head's half."""
    half = wide * size_cm * rng.uniform(0.92, 1.08)
    eye_z, eye_y = min(0.34 * half, 0.024 * size_cm), min(0.5 * half, 0.04 * size_cm)
    x_head = size_cm - half - 0.1
    handle = shapes.along_x(_haft(rng, size_cm, x_head - half, eye_z, eye_y))
    wedge = shapes.box((0.9 * half, 1.5 * eye_y, 0.12 * eye_z), (size_cm - 0.45 * half, 0, 0))
    return [
        Piece("wedge", "wedge", wedge),
        Piece("handle", "handle", handle),
        Piece("head", "head", head(rng, half).translate((x_head, 0.0, 0.0))),
    ]


def _haft(
    rng: np.random.Generator, length: float, neck: float, eye_z: float, eye_y: float
) -> Manifold:
    """Oval handle along z, a knob at its end, a plug for the eye at the other."""
    swell = rng.uniform(1.15, 1.35)
    stations = [(0.0, 0.85 * swell), (0.02, swell), (0.06, 1.1 * swell), (0.14, swell)]
    stations += [(0.35, 1.0), (0.6, 0.95)]
    ovals = [(z * neck, share * eye_z, share * eye_y) for z, share in stations]
    return skins.loft([*ovals, (neck, eye_z, eye_y), (length, eye_z, eye_y)], 2.3)


def _barrel_head(rng: np.random.Generator, half: float) -> Manifold:
    """Drum of rubber or wood, both faces alike."""
    long, bulge = half * rng.uniform(1.5, 1.8), half * rng.uniform(0.8, 0.95)
    profile = [(0.0, -long), (bulge, -long), (half, 0.0), (bulge, long), (0.0, long)]
    return shapes.along_y(shapes.lathe(shapes.outline(profile, 0.15 * half)))


def _axe_head(rng: np.random.Generator, half: float) -> Manifold:
    """Wedge whose bit flares out and bends back a little, a flat poll behind."""
    bit, flare = half * rng.uniform(3.0, 3.6), half * rng.uniform(1.25, 1.5)
    low = [(-half, -half), (-half, half), (-0.7 * half, 0.5 * bit), (-flare, 0.9 * bit)]
    high = [(flare, 0.88 * bit), (0.7 * half, 0.5 * bit), (half, half), (half, -half)]
    side = shapes.polygon([*low, (-0.5 * flare, bit), (0.4 * flare, bit), *high], 0.05 * half)
    wedge = [(-half, 0.6 * half), (0.4 * half, 0.6 * half), (1.02 * bit, 0.02 * half)]
    across = shapes.polygon([*wedge, *((y, -z) for y, z in reversed(wedge))])
    return Manifold.extrude(side, 2 * half).translate((0, 0, -half)) ^ shapes.upright_across(
        across, 4 * half
    )


# --- blades with a tang ---------------------------------------------------------------------------


def tanged(rng: np.random.Generator, size_cm: float, blade: Blade, grip: float) -> list[Piece]:
    """Blade whose pointed tang sits in a turned handle, held by a ferrule; ``grip`` is a share."""
    length = size_cm * grip * rng.uniform(0.92, 1.08)
    radius = float(np.clip(0.12 * length, 0.9, 1.7)) * rng.uniform(0.95, 1.1)
    tang = length * rng.uniform(0.5, 0.75)
    neck = 0.42 * radius
    spike = shapes.cylinder(0.25 * neck, length - tang, length + 0.1, 0.8 * neck)
    metal = blade(rng, size_cm - length, radius).translate((0, 0, length))
    profile = [(0.0, 0.0), (0.75, 0.0), (1.0, 0.1), (0.9, 0.35), (1.0, 0.65), (0.72, 0.85)]
    profile += [(0.72, 1.0), (0.0, 1.0)]
    body = shapes.lathe(shapes.outline([(r * radius, z * length) for r, z in profile], 0.2))
    band = (0.86 * length, length)
    pieces = [
        Piece("blade", "blade", spike + metal),
        Piece("ferrule", "ferrule", shapes.tube(0.78 * radius, 0.66 * radius, *band)),
        Piece("handle", "handle", body.trim_by_plane((0, 0, -1), -length + 1e-3)),
    ]
    return moved(pieces, shapes.along_x)


def _flat(points: shapes.Profile, thick: float, fillet: float = 0.0) -> Manifold:
    """Plate in x and z that lies flat once the tool is laid down."""
    return shapes.upright_across(shapes.polygon(points, fillet), thick)


def _neck(length: float, radius: float) -> Manifold:
    """Bolster between handle and blade."""
    return shapes.cylinder(0.4 * radius, 0.0, length)


def _chisel_blade(rng: np.random.Generator, length: float, radius: float) -> Manifold:
    wide, thick = radius * rng.uniform(0.5, 1.1), 0.32 * radius
    blade = _flat([(-wide, 0.2 * length), (wide, 0.2 * length), (wide, length), (-wide, length)], 2)
    bevel = [(-thick, 0.0), (thick, 0.0), (thick, length - 3.2 * thick), (-0.9 * thick, length)]
    plate = blade ^ shapes.upright(shapes.polygon([*bevel, (-thick, length)]), 4 * wide)
    stem = (
        shapes.cylinder(0.45 * radius, 0.0, 0.04 * length)
        + shapes.box((1.8 * thick, 1.2 * wide, 0.01), (0, 0, 0.22 * length))
    ).hull()
    return plate + stem + _neck(0.2, radius)


def _scoop_blade(rng: np.random.Generator, length: float, radius: float) -> Manifold:
    """Gutter of sheet that ends in a rounded point, as for planting."""
    wide = length * rng.uniform(0.2, 0.25)
    half = [(-0.8 * wide, 0.22 * length), (-wide, 0.35 * length), (-wide, 0.7 * length)]
    points = [*half, (-0.5 * wide, 0.92 * length), (0.0, length)]
    sheet = _flat([*points, *((-y, z) for y, z in reversed(points[:-1]))], 8 * wide, 0.1)
    gutter = shapes.tube(1.5 * wide, 1.5 * wide - 0.16, 0.0, length).translate((-1.4 * wide, 0, 0))
    front = shapes.box((3 * wide, 4 * wide, 4 * length), (1.1 * wide, 0, 0))
    return (gutter ^ sheet ^ front) + shapes.cylinder(0.42 * radius, 0.0, 0.42 * length)


ARCHETYPES: Final = {
    "striker:mallet": Archetype(partial(striker, head=_barrel_head, wide=0.1), "wedge handle head"),
    "striker:axe": Archetype(partial(striker, head=_axe_head, wide=0.065), "wedge handle head"),
    "tanged:chisel": Archetype(
        partial(tanged, blade=_chisel_blade, grip=0.48), "blade ferrule handle"
    ),
    "tanged:scoop": Archetype(
        partial(tanged, blade=_scoop_blade, grip=0.4), "blade ferrule handle"
    ),
}
