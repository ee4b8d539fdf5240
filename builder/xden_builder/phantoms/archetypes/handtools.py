"""Hand tools: a screwdriver with a tang in its handle, a hammer, scissors."""

from __future__ import annotations

from math import pi
from typing import Final

import numpy as np
from manifold3d import CrossSection, Manifold

from xden_builder.phantoms import shapes, skins
from xden_builder.phantoms.pieces import Archetype, Piece, moved

__all__ = ["ARCHETYPES"]


def screwdriver(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Metal shaft whose winged tang sits in a fluted handle, every other one with a sleeve."""
    grip = size_cm * rng.uniform(0.36, 0.46)
    radius = float(np.clip(size_cm * rng.uniform(0.055, 0.072), 0.8, 1.7))
    shaft_radius = radius * rng.uniform(0.2, 0.27)
    tang = grip * rng.uniform(0.55, 0.85)
    shaft = shapes.cylinder(shaft_radius, grip - tang, size_cm)
    wings = (3.2 * shaft_radius, 0.7 * shaft_radius, 0.25 * tang)
    shaft += shapes.box(wings, (0.0, 0.0, grip - 0.82 * tang))
    grind = _slotted if rng.random() < 0.5 else _cross_head
    pieces = [Piece("shaft", "shaft", shaft - grind(shaft_radius, size_cm))]
    handle = _fluted_handle(rng, grip, radius)
    if rng.random() < 0.5:
        band = shapes.tube(2 * radius, 0.68 * radius, 0.22 * grip, grip * rng.uniform(0.6, 0.7))
        pieces.append(Piece("sleeve", "sleeve", handle ^ band))
        handle -= band
    pieces.append(Piece("handle", "handle", handle))
    return moved(pieces, shapes.along_x)


def _fluted_handle(rng: np.random.Generator, grip: float, radius: float) -> Manifold:
    waist = rng.uniform(0.78, 0.9)
    profile = [(0.0, 0.0), (0.8, 0.0), (1.0, 0.12), (0.97, 0.5), (waist, 0.78)]
    profile += [(waist + 0.08, 0.86), (0.62, 0.97), (0.62, 1.0), (0.0, 1.0)]
    body = shapes.lathe(shapes.outline([(r * radius, z * grip) for r, z in profile], 0.2 * radius))
    flute = shapes.capsule(0.24 * radius, 0.1 * grip, 0.8 * grip).translate((1.1 * radius, 0, 0))
    return body - shapes.around(flute, int(rng.integers(5, 8)))


def _slotted(radius: float, tip: float) -> Manifold:
    """Give what is ground off a rod to leave a flat blade."""
    start, end = tip - 5 * radius, tip + radius
    ground = [(radius, start), (0.22 * radius, tip), (0.22 * radius, end)]
    ground += [(2 * radius, end), (2 * radius, start)]
    side = shapes.upright_across(shapes.polygon(ground), 4 * radius)
    return shapes.around(side, 2)


def _cross_head(radius: float, tip: float) -> Manifold:
    """Give what is ground off a rod to leave a cross-head tip."""
    cone = shapes.cylinder(1.02 * radius, tip - 1.8 * radius, tip, 0.3 * radius)
    ground = shapes.cylinder(2 * radius, tip - 1.8 * radius, tip + radius) - cone
    groove = shapes.box((radius, radius, 3 * radius), (0.68 * radius, 0.68 * radius, tip))
    return ground + shapes.around(groove, 4)


def hammer(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Steel head on a handle that fills its eye, spread there by a wedge."""
    face = size_cm * rng.uniform(0.042, 0.05)
    eye_z, eye_y, cheek = 0.5 * face, 0.75 * face, rng.uniform(0.8, 0.95) * face
    x_head = size_cm - 1.02 * face
    handle = shapes.along_x(_hammer_handle(size_cm, x_head - cheek, eye_z, eye_y))
    peen = _cross_peen if rng.random() < 0.5 else _claw
    head = _poll(face) + _cheek(cheek, face) + peen(cheek, face)
    wedge = skins.loft([(0.0, 0.04, 0.8 * eye_y), (1.3 * cheek, 0.16, 0.8 * eye_y)], 8.0)
    wedge = shapes.along_x(wedge).translate((size_cm - 1.3 * cheek, 0.0, 0.0))
    return [
        Piece("wedge", "wedge", wedge),
        Piece("handle", "handle", handle),
        Piece("head", "head", head.translate((x_head, 0.0, 0.0))),
    ]


def _hammer_handle(length: float, neck: float, eye_z: float, eye_y: float) -> Manifold:
    """Oval handle along z, x its thin side, that ends as a plug for the eye."""
    thick, wide = 0.036 * length, 0.05 * length
    stations = [(0.0, 0.7, 0.75), (0.012, 0.85, 0.88), (0.04, 1.0, 1.0), (0.12, 1.0, 1.0)]
    stations += [(0.3, 0.86, 0.84), (0.5, 0.8, 0.72), (0.66, 0.68, 0.62)]
    ovals = [(z * length, thick * x, wide * y) for z, x, y in stations]
    return skins.loft([*ovals, (neck, eye_z, eye_y), (length, eye_z, eye_y)], 2.3)


def _cheek(cheek: float, face: float) -> Manifold:
    """Block around the eye; the handle runs along x, the blow along y."""
    return shapes.rounded_box((2 * cheek, 2.4 * face, 1.9 * face), 0.22 * face)


def _poll(face: float) -> Manifold:
    """Neck and striking face, towards +y."""
    profile = [(0.0, 0.0), (0.8, 0.0), (0.7, 1.6), (1.0, 2.1), (1.0, 2.8), (0.85, 3.0), (0.0, 3.0)]
    section = shapes.outline([(r * face, z * face) for r, z in profile], 0.12 * face)
    return shapes.along_y(shapes.lathe(section))


def _cross_peen(cheek: float, face: float) -> Manifold:
    """Wedge-shaped end whose edge is square to the handle, towards -y."""
    root = shapes.rounded_box((1.7 * cheek, 0.6 * face, 1.7 * face), 0.2 * face)
    edge = shapes.capsule(0.16 * face, -0.8 * face, 0.8 * face).translate((0, -3.4 * face, 0))
    return (root.translate((0, -0.9 * face, 0)) + edge).hull()


def _claw(cheek: float, face: float) -> Manifold:
    """Two tines that bend down towards the handle's end, towards -y."""
    top = [(-0.8, cheek / face), (-2.0, 0.85), (-3.2, 0.25), (-4.3, -0.8)]
    low = [(-4.25, -1.0), (-3.0, -0.3), (-1.9, -0.05), (-0.8, -0.9 * cheek / face)]
    side = shapes.polygon([(x * face, y * face) for y, x in [*top, *low]], 0.08 * face)
    claw = Manifold.extrude(side, 1.7 * face).translate((0, 0, -0.85 * face))
    slit = shapes.polygon([(y * face, z * face) for y, z in ((-1.9, 0), (-5, 0.42), (-5, -0.42))])
    return claw - shapes.upright_across(slit, 8 * face)


def scissors(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Two steel blades on a rivet, their tangs moulded into finger loops."""
    blade, thick = size_cm * rng.uniform(0.5, 0.56), 0.1 * rng.uniform(1.2, 2.0)
    opening = rng.uniform(4.0, 12.0)
    head = shapes.cylinder(0.03 * size_cm, thick, thick + 0.09)
    rivet = shapes.cylinder(0.016 * size_cm, -thick, thick) + head + head.mirror((0, 0, 1))
    steel = _scissor_blade(blade, size_cm - blade, thick).rotate((0, 0, opening / 2))
    loop = _finger_loop(size_cm - blade, size_cm).rotate((0, 0, opening / 2))
    other = (steel.rotate((180, 0, 0)), loop.rotate((180, 0, 0)))
    pieces = [
        Piece("rivet", "rivet", rivet),
        Piece("upper_blade", "blade", steel),
        Piece("lower_blade", "blade", other[0]),
        Piece("upper_handle", "handle", loop),
        Piece("lower_handle", "handle", other[1]),
    ]
    return moved(pieces, lambda solid: solid.translate((size_cm / 2 - blade, 0, 0)))


def _scissor_blade(blade: float, tang: float, thick: float) -> Manifold:
    """Blade towards +x above the plane z = 0, with its tang towards -x and -y."""
    wide = 0.13 * blade
    edge = [(0.0, -0.5), (1.0, 0.0), (0.95, 0.12), (0.5, 0.62), (0.1, 0.8), (-0.08, 0.3)]
    section = shapes.polygon([(x * blade, y * wide) for x, y in edge], 0.006 * blade)
    root = shapes.disc(0.6 * wide)
    tip = shapes.disc(0.25 * wide, (-0.42 * tang, -0.1 * tang))
    section += CrossSection.batch_hull([root, tip])
    return Manifold.extrude(section, thick)


def _finger_loop(tang: float, size_cm: float) -> Manifold:
    """Ring for a finger with the arm that holds the tang."""
    bar = 0.027 * size_cm
    angles = 2 * pi * np.arange(40) / 40
    long, wide = 0.36 * tang - bar, 0.072 * size_cm
    x = -tang + bar + long + long * np.cos(angles)
    y = -0.12 * size_cm + wide * np.sin(angles)
    ring = skins.pipe(np.stack([x, y, 0 * x], axis=1), bar, 1.15 * bar, closed=True)
    arm = [(-0.14 * tang, -0.045 * tang, 0.0), (-0.5 * tang, -0.14 * tang, 0.0)]
    return ring + skins.pipe(skins.smooth_path(arm, 6), 0.9 * bar, 1.1 * bar)


ARCHETYPES: Final = {
    "hammer": Archetype(hammer, "wedge handle head"),
    "scissors": Archetype(scissors, "rivet blade handle"),
    "screwdriver": Archetype(screwdriver, "shaft handle sleeve"),
}
