"""Toys to hold: a doll, a teddy bear."""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np
from manifold3d import Manifold

from xden_builder.phantoms import fittings, shapes, skins
from xden_builder.phantoms.pieces import Archetype, Piece

__all__ = ["ARCHETYPES"]


def doll(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Hollow head and trunk of vinyl, limbs on an elastic cord, rooted hair, a skirt."""
    wall, head = 0.1 + 0.004 * size_cm, size_cm * rng.uniform(0.112, 0.126)
    shoulder, hip, waist = 0.7 * size_cm, 0.42 * size_cm, 0.5 * size_cm
    bust = rng.uniform(0.76, 0.84)
    stations = [(hip, 0.75), (waist, 0.72), (0.64 * size_cm, bust), (shoulder, 0.62)]
    ovals = [(hip - 0.03, 0.4), *stations, (shoulder + 0.02 * size_cm, 0.3)]
    trunk = skins.loft([(z, head * s, 0.7 * head * s) for z, s in ovals], 2.3)
    room = skins.loft([(z, head * s - wall, 0.7 * head * s - wall) for z, s in stations], 2.3)
    elbow, hand = (0.02 * size_cm, 1.25 * head, 0.55 * size_cm), (0.07 * size_cm, 1.4 * head, hip)
    arm = _limb([(0.0, 0.74 * head, shoulder - 0.02 * size_cm), elbow, hand], 0.26 * head)
    knee, ankle = (0.0, 0.42 * head, 0.2 * size_cm), (0.0, 0.44 * head, 0.04 * size_cm)
    leg = _limb([(0.0, 0.36 * head, hip + 0.01), knee, ankle], 0.33 * head)
    shoe = shapes.rounded_box((0.8 * head, 0.6 * head, 0.08 * size_cm), 0.15 * head)
    shoe = shoe.translate((0.1 * head, 0.44 * head, 0.04 * size_cm))
    cord = shapes.along_y(shapes.cylinder(0.12, -0.76 * head, 0.76 * head))
    pairs = [("shoe", "shoe", shoe), ("arm", "limb", arm), ("leg", "limb", leg)]
    return [
        Piece("cord", "cord", cord.translate((0, 0, shoulder - 0.02 * size_cm))),
        *_face(head, wall, shoulder, size_cm),
        *(Piece(f"left_{name}", role, solid) for name, role, solid in pairs),
        *(Piece(f"right_{name}", role, solid.mirror((0, 1, 0))) for name, role, solid in pairs),
        Piece("trunk", "trunk", trunk - room),
        Piece("skirt", "cloth", _skirt(head, waist, rng.uniform(0.24, 0.34) * size_cm)),
    ]


def _limb(points: list[fittings.Point], radius: float) -> Manifold:
    """Tapered limb through its joints, a ball at each."""
    sizes = [radius, 0.85 * radius, 0.7 * radius]
    bones = zip(pairwise(points), pairwise(sizes), strict=True)
    return shapes.union(fittings.strut(*ends, *radii) for ends, radii in bones)


def _face(head: float, wall: float, shoulder: float, size: float) -> list[Piece]:
    """Eyes, the hollow head with its neck, and hair that leaves the face free."""
    middle = (0.0, 0.0, 0.86 * size)
    skull, inner = (
        fittings.ellipsoid((0.92 * head - less, 0.9 * head - less, head - less), middle)
        for less in (0.0, wall)
    )
    neck, bore = (
        shapes.cylinder(0.35 * head - less, shoulder - 0.02 * size - less, 0.78 * size + less)
        for less in (0.0, wall)
    )
    hair = fittings.ellipsoid(
        (1.06 * head, 1.06 * head, 1.12 * head), (-0.12 * head, 0, 0.875 * size)
    )
    hair -= shapes.box((2 * head, 4 * head, 1.5 * head), (1.3 * head, 0, 0.86 * size - 0.2 * head))
    eye = shapes.sphere(0.13 * head, (0.78 * head, 0.34 * head, 0.87 * size))
    return [
        Piece("eyes", "eye", eye + eye.mirror((0, 1, 0))),
        Piece("head", "head", (skull + neck) - inner - bore),
        Piece("hair", "hair", hair - skull),
    ]


def _skirt(head: float, waist: float, hem: float) -> Manifold:
    """Flared cloth that hangs from a band around the waist."""
    outside = shapes.cylinder(1.7 * head, hem, waist, 0.8 * head)
    inside = shapes.cylinder(1.7 * head - 0.15, hem - 1e-3, waist + 1e-3, 0.8 * head - 0.15)
    band = shapes.tube(0.85 * head, 0.5 * head, 0.96 * waist, waist)
    return (outside - inside) + band


def teddy_bear(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Plush that sits: stuffing in a cover, eyes and a nose on it, a voice box in its belly."""
    shape = (rng.uniform(0.94, 1.06), rng.uniform(0.94, 1.06))
    cloth = 0.25 + 0.006 * size_cm
    outside, stuffing = (_bear(size_cm, shape, less) for less in (0.0, cloth))
    eye = shapes.sphere(0.028 * size_cm, (0.19 * size_cm, 0.075 * size_cm, 0.82 * size_cm))
    nose = fittings.ellipsoid(
        (0.035 * size_cm, 0.045 * size_cm, 0.032 * size_cm), (0.275 * size_cm, 0, 0.765 * size_cm)
    )
    radius, centre = 0.09 * size_cm, 0.3 * size_cm
    box = shapes.slab(shapes.disc(radius), -0.06 * size_cm, 0.06 * size_cm, 0.02 * size_cm)
    room = shapes.cylinder(radius - 0.2, 0.2 - 0.06 * size_cm, 0.06 * size_cm - 0.2)
    reed = shapes.tube(0.35 * radius, 0.2 * radius, 0.2 - 0.06 * size_cm, 0.02 * size_cm)
    weight = shapes.cylinder(0.7 * radius, 0.02 * size_cm, 0.06 * size_cm - 0.2)
    voice = {"reed": ("reed", reed), "weight": ("weight", weight), "voice": ("box", box - room)}
    return [
        *(
            Piece(name, role, solid.translate((0, 0, centre)))
            for name, (role, solid) in voice.items()
        ),
        Piece("eyes", "eye", eye + eye.mirror((0, 1, 0))),
        Piece("nose", "eye", nose),
        Piece("stuffing", "stuffing", stuffing - (box).translate((0, 0, centre))),
        Piece("cover", "cover", outside - stuffing),
    ]


def _bear(size: float, shape: tuple[float, float], less: float) -> Manifold:
    """Sitting bear that looks along x, shrunk by ``less``."""
    fat, big = shape
    balls = [
        ((0.2 * fat, 0.21 * fat, 0.33), (0.0, 0.0, 0.31)),
        ((0.19 * big, 0.21 * big, 0.185), (0.02, 0.0, 0.76)),
        ((0.1, 0.1, 0.08), (0.19, 0.0, 0.73)),
    ]
    pairs = [
        ((0.05, 0.085, 0.085), (0.0, 0.17 * big, 0.915)),
        ((0.2, 0.095, 0.095), (0.2, 0.15, 0.1)),
        ((0.055, 0.1, 0.11), (0.4, 0.17, 0.13)),
        ((0.085, 0.08, 0.18), (0.09, 0.22 * fat, 0.36)),
    ]
    balls += [(radii, (x, s * y, z)) for radii, (x, y, z) in pairs for s in (-1, 1)]
    solids = (
        fittings.ellipsoid(
            (a * size - less, b * size - less, c * size - less), (x * size, y * size, z * size)
        )
        for (a, b, c), (x, y, z) in balls
    )
    return shapes.union(solids).trim_by_plane((0, 0, 1), 0.012 * size + less)


ARCHETYPES: Final = {
    "doll": Archetype(doll, "cord eye shoe limb trunk head hair cloth"),
    "teddy_bear": Archetype(teddy_bear, "reed weight box eye stuffing cover"),
}
