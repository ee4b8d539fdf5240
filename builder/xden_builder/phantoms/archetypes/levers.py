"""Tools of two arms: pliers of several kinds, tweezers, a nail clipper, a clamp."""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np
from manifold3d import Manifold

from xden_builder.phantoms import shapes, skins
from xden_builder.phantoms.pieces import Archetype, Piece, moved

__all__ = ["ARCHETYPES"]

Outline = list[tuple[float, float]]

_COMBINATION: Final[Outline] = [(0.0, 0.0), (1.0, 0.0), (1.0, 0.25), (0.55, 0.5), (0.0, 0.55)]
_NEEDLE: Final[Outline] = [(0.0, 0.0), (1.0, 0.0), (1.0, 0.04), (0.4, 0.12), (0.0, 0.22)]


def pliers(rng: np.random.Generator, size_cm: float, jaw: Outline, reach: float) -> list[Piece]:
    """Two crossing halves on a rivet, each jaw on the far side of its arm; elastic grips.

    ``jaw`` is the outline of one in units of its length, ``reach`` that length as a share.
    """
    joint, thick = size_cm * rng.uniform(0.065, 0.075), size_cm * rng.uniform(0.028, 0.034)
    length = size_cm * reach * rng.uniform(0.94, 1.06)
    arm, spread = size_cm - length - joint, size_cm * rng.uniform(0.1, 0.14)
    opening = rng.uniform(1.0, 6.0)
    inner = [(-0.2 * joint, -0.35 * joint, 0), (-1.1 * joint, -0.85 * joint, 0)]
    path = skins.smooth_path([*inner, (-0.5 * arm, -0.9 * spread, 0), (-arm, -spread, 0)], 28)
    beyond = np.concatenate([path[10:], [2 * path[-1] - path[-2]]])  # closed over the arm's end
    half = _half(jaw, length, joint, thick, path).rotate((0, 0, opening))
    grip = skins.pipe(beyond, 1.3 * thick, 1.15 * thick).rotate((0, 0, opening))
    rivet = shapes.cylinder(0.42 * joint, -1.1 * thick, 1.1 * thick)
    pieces = [Piece("rivet", "rivet", rivet), Piece("left_half", "half", half)]
    pieces += [Piece("right_half", "half", half.rotate((180, 0, 0)))]
    pieces += [
        Piece("left_grip", "grip", grip),
        Piece("right_grip", "grip", grip.rotate((180, 0, 0))),
    ]
    return moved(pieces, lambda solid: solid.translate((size_cm / 2 - length, 0, 0)))


def _half(jaw: Outline, length: float, joint: float, thick: float, path: np.ndarray) -> Manifold:
    """Jaw above y = 0, arm below it, joined by the upper half of the joint's disc."""
    points = [(x * length, y * length) for x, y in jaw]
    outline = shapes.polygon(points, 0.02 * length)
    solid = Manifold.extrude(outline, 2 * thick).translate((0, 0, -thick))
    solid += skins.pipe(path, 0.85 * thick, 0.75 * thick)
    solid -= shapes.cylinder(1.01 * joint, -2 * thick, 0.0)
    return solid + shapes.cylinder(joint, 0.0, thick)


def tweezers(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Two springy arms welded at the back, bowed apart, their tips nearly touching."""
    bow, thick = size_cm * rng.uniform(0.06, 0.08), rng.uniform(0.1, 0.14)
    gap, wide = rng.uniform(0.1, 0.3), size_cm * rng.uniform(0.035, 0.05)
    back = [(0, 0, 0.5 * thick), (0.1 * size_cm, 0, 0.5 * thick), (0.5 * size_cm, 0, bow)]
    front = [(0.85 * size_cm, 0, 0.55 * bow), (size_cm, 0, 0.5 * (gap + thick))]
    upper = skins.smooth_path([*back, *front], 24)
    half = [(0.0, 0.7 * wide), (0.3 * size_cm, wide), (0.6 * size_cm, 0.8 * wide)]
    half += [(size_cm + 0.1, 0.1 * wide)]
    plan = shapes.polygon([*half, *((x, -y) for x, y in reversed(half))])
    across = np.array([[0.0, -wide, 0.0], [0.0, wide, 0.0]])
    up = np.array([0.0, 0.0, 0.5 * thick])
    corners = [across[0] - up, across[1] - up, across[1] + up, across[0] + up]
    strip = skins.skin(np.stack([upper + corner for corner in corners], axis=1))
    arm = strip ^ Manifold.extrude(plan, 4 * bow).translate((0, 0, -2 * bow))
    both = (
        arm
        + arm.mirror((0, 0, 1))
        + shapes.box((0.1 * size_cm, 1.3 * wide, thick), (0.05 * size_cm, 0, 0))
    )
    return moved([Piece("body", "body", both)], lambda solid: solid.rotate((90, 0, 0)))


def nail_clipper(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """Two bowed leaves with cutting lips, a post through them and a lever on it."""
    wide, thick = size_cm * rng.uniform(0.2, 0.24), 0.16
    post_x, lip = 0.82 * size_cm, 0.42
    side = [(0.0, 0.0), (0.1 * size_cm, 0.0), (0.9 * size_cm, lip), (size_cm, 0.02)]
    back = [(size_cm, 0.14), (0.9 * size_cm, lip + thick), (0.1 * size_cm, thick), (0.0, thick)]
    leaf = shapes.upright(shapes.polygon([*side, *back], 0.02), wide)
    top = lip + thick
    ramp = [(post_x + 0.5, top), (post_x + 0.5, top + 0.2), (post_x, top + 0.45)]
    ramp += [(0.1 * size_cm, top + 0.85), (0.1 * size_cm, top + 0.7), (post_x - 0.45, top + 0.15)]
    lever = shapes.upright(shapes.polygon([*ramp, (post_x - 0.2, top - 0.05)], 0.03), 0.85 * wide)
    post = shapes.cylinder(0.15, -top - 0.12, top + 0.3) + shapes.cylinder(
        0.3, -top - 0.12, -top + 0.12
    )
    pin = shapes.along_y(shapes.cylinder(0.06, -0.3, 0.3)).translate((0, 0, top + 0.24))
    return [
        Piece("post", "post", (post + pin).translate((post_x, 0, 0))),
        Piece("lever", "lever", lever),
        Piece("upper_leaf", "leaf", leaf),
        Piece("lower_leaf", "leaf", leaf.mirror((0, 0, 1))),
    ]


def clamp(rng: np.random.Generator, size_cm: float) -> list[Piece]:
    """C-shaped frame, a long screw through its end, a swivel pad and a sliding bar."""
    inside, throat = 0.52 * size_cm, size_cm * rng.uniform(0.3, 0.38)
    bar, thick = 0.075 * size_cm, 0.085 * size_cm
    frame = [(0, 0), (throat + bar, 0), (throat + bar, inside + 2 * bar), (0, inside + 2 * bar)]
    frame += [(0, inside + 0.9 * bar), (throat - 0.4 * bar, inside + 0.9 * bar)]
    frame += [(throat - 0.4 * bar, 1.1 * bar), (0, 1.1 * bar)]
    body = shapes.upright(shapes.polygon(frame, 0.25 * bar), 0.7 * thick)
    axis, top = 0.9 * bar, inside + 2 * bar
    boss = shapes.cylinder(0.85 * bar, inside + 0.7 * bar, top + 0.2 * bar).translate((axis, 0, 0))
    anvil = shapes.cylinder(bar, 0.6 * bar, 1.5 * bar).translate((axis, 0, 0))
    end, tip = size_cm, 1.5 * bar + inside * rng.uniform(0.1, 0.4)
    screw = shapes.thread(0.4 * bar, 0.32 * bar, 0.2 * bar, tip, end - 0.14 * size_cm)
    screw += shapes.cylinder(0.42 * bar, end - 0.15 * size_cm, end)
    pad = shapes.cylinder(0.9 * bar, tip - 0.5 * bar, tip + 0.35 * bar, 0.6 * bar)
    cross = shapes.along_y(shapes.cylinder(0.2 * bar, -1.1 * throat, 1.0 * throat * 0.6))
    knobs = shapes.union(
        shapes.sphere(0.32 * bar, (0, y, 0)) for y in (-1.1 * throat, 0.6 * throat)
    )
    handle = (cross + knobs).translate((axis, 0, end - 0.07 * size_cm))
    return moved(
        [
            Piece("bar", "bar", handle),
            Piece("screw", "screw", screw.translate((axis, 0, 0))),
            Piece("pad", "pad", pad.translate((axis, 0, 0))),
            Piece("frame", "frame", body + boss + anvil),
        ],
        lambda solid: shapes.along_x(solid.rotate((0, 0, 90))),
    )


_PLIERS: Final = "rivet half grip"
ARCHETYPES: Final = {
    "clamp": Archetype(clamp, "bar screw pad frame"),
    "nail_clipper": Archetype(nail_clipper, "post lever leaf"),
    "pliers:combination": Archetype(partial(pliers, jaw=_COMBINATION, reach=0.2), _PLIERS),
    "pliers:needle": Archetype(partial(pliers, jaw=_NEEDLE, reach=0.4), _PLIERS),
    "tweezers": Archetype(tweezers, "body"),
}
