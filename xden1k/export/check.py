"""Whether a file says what the object is: run on every export, before the file is in its place."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from xden1k.errors import DataError
from xden1k.export.si import Inertial

__all__ = ["TOLERANCE", "Deviation", "compare", "deviation"]

TOLERANCE: Final = 1e-5
"""Largest relative deviation of what is read back: where a surface touches itself its sides are
drawn apart by roundings, which in a mesh of 700,000 triangles add up to 4e-6."""
ROUNDING: Final = 1e-6
"""By how much, relative, principal moments may miss the triangle inequality: a thin plate has
equality, and single precision rounds."""


@dataclass(frozen=True, slots=True)
class Deviation:
    """How far what was read back is from the object, relative.

    Parameters
    ----------
    mass
        Of the mass.
    com
        Of the centre of mass, over the radius of gyration.
    inertia
        Of the inertia tensor's worst entry, over the largest principal moment.
    """

    mass: float
    com: float
    inertia: float

    @property
    def largest(self) -> float:
        """Whichever is the largest."""
        return max(self.mass, self.com, self.inertia)


def compare(path: Path, found: Inertial, wanted: Inertial) -> Deviation:
    """Compare what was read back with what it should be.

    Raises
    ------
    DataError
        If the inertia is that of no rigid body, or one of the deviations is above 1e-5.
    """
    _check_physical(path, found)
    off = deviation(found, wanted)
    if not off.largest <= TOLERANCE:
        raise DataError(
            f"{path}: read back, mass, centre and inertia are off by {off.mass:.1e}, "
            f"{off.com:.1e} and {off.inertia:.1e}, expected at most {TOLERANCE:g}"
        )
    return off


def deviation(found: Inertial, wanted: Inertial) -> Deviation:
    """Say how far one inertial is from another."""
    largest = float(np.linalg.eigvalsh(wanted.inertia_kg_m2)[-1])
    gyration = np.sqrt(largest / wanted.mass_kg)
    return Deviation(
        abs(found.mass_kg - wanted.mass_kg) / wanted.mass_kg,
        float(np.linalg.norm(found.com_m - wanted.com_m) / gyration),
        float(np.abs(found.inertia_kg_m2 - wanted.inertia_kg_m2).max() / largest),
    )


def _check_physical(path: Path, found: Inertial) -> None:
    """Raise unless a body can have it: symmetric, positive definite, triangle inequality."""
    tensor = found.inertia_kg_m2
    if not (np.isfinite(tensor).all() and found.mass_kg > 0 and np.isfinite(found.com_m).all()):
        raise DataError(f"{path}: read back, mass, centre or inertia is no number, or no mass")
    largest = float(np.abs(tensor).max())
    if np.abs(tensor - tensor.T).max() > ROUNDING * largest:
        raise DataError(f"{path}: its inertia is not symmetric: {tensor.tolist()}")
    moments = np.linalg.eigvalsh(tensor)
    if not moments[0] > 0 or moments[0] + moments[1] < moments[2] * (1 - ROUNDING):
        raise DataError(f"{path}: no body has the principal moments {moments.tolist()} kg·m²")
