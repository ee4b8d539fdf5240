"""What chance decides in a trial, keyed so that no draw depends on another, nor on its order."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from math import pi

import numpy as np

from xden_bench.manip.closed_forms import weight_n

__all__ = ["Draw", "Regime", "between", "draw_of", "keyed_generator"]


@dataclass(frozen=True, slots=True)
class Regime:
    """How slippery things are and how hard the gripper presses: uniform between two ends each.

    Parameters
    ----------
    friction
        Coefficient of the object's surface.
    grip_force_n
        Of each finger.
    """

    friction: Sequence[float]
    grip_force_n: Sequence[float]

    @property
    def most_friction_n(self) -> float:
        """Friction of two pads at best."""
        return 2 * self.friction[1] * self.grip_force_n[1]


@dataclass(frozen=True, slots=True)
class Draw:
    """One trial's conditions, the same for every method.

    Parameters
    ----------
    friction, grip_force_n
        Of the regime.
    shake_rad
        Amplitude of the shake.
    shake_azimuth_rad
        Direction of the horizontal axis about which it shakes.
    redrawn
        How many draws went before that the weight alone would have lost.
    """

    friction: float
    grip_force_n: float
    shake_rad: float
    shake_azimuth_rad: float
    redrawn: int


def keyed_generator(*key: str | int) -> np.random.Generator:
    """Random numbers of a key alone: of SHA-256 of its JSON.

    Examples
    --------
    >>> one, same, other = (keyed_generator(7, name).random() for name in ("ab", "ab", "ba"))
    >>> one == same, one == other
    (True, False)
    """
    digest = hashlib.sha256(json.dumps(key).encode()).digest()
    return np.random.default_rng(int.from_bytes(digest, "little"))


def draw_of(
    regime: Regime,
    shake_rad: Sequence[float],
    mass_g: float,
    max_load: float,
    key: Sequence[str | int],
) -> Draw:
    """Draw a trial's conditions, anew as long as the weight alone would lose it.

    Parameters
    ----------
    regime
        Whose ends hold; at best it must hold more than the weight over ``max_load``.
    shake_rad
        Ends of the amplitude.
    mass_g
        Of the object.
    max_load
        Weight over the pads' friction ``2μF``, at most.
    key
        Seed, object, regime and trial.
    """
    generator, weight = keyed_generator(*key), weight_n(mass_g)
    assert weight < max_load * regime.most_friction_n, "no draw of this regime holds the object"
    redrawn = 0
    while True:
        friction = between(generator, regime.friction)
        force_n = between(generator, regime.grip_force_n)
        if weight <= max_load * 2 * friction * force_n:
            break
        redrawn += 1
    shake = between(generator, shake_rad)
    return Draw(friction, force_n, shake, between(generator, (0, 2 * pi)), redrawn)


def between(generator: np.random.Generator, ends: Sequence[float]) -> float:
    """Draw a number, uniform between two ends."""
    low, high = ends
    return generator.uniform(low, high)
