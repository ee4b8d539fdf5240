"""From cm and g to m and kg: the one place where units change on the way to a simulator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from xden1k.values.arrays import Vec3
from xden1k.values.mass import MassProperties

__all__ = [
    "KG_M2_PER_G_CM2",
    "KG_M3_PER_G_CM3",
    "KG_PER_G",
    "MM_PER_CM",
    "M_PER_CM",
    "SIX",
    "Inertial",
    "Matrix",
]

M_PER_CM: Final = 1e-2
MM_PER_CM: Final = 10.0
KG_PER_G: Final = 1e-3
KG_M3_PER_G_CM3: Final = 1e3
KG_M2_PER_G_CM2: Final = KG_PER_G * M_PER_CM**2

Matrix = Float[np.ndarray, "3 3"]

SIX: Final = {
    **{"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2)},
    **{"iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)},
}
"""Names of the entries of a symmetric tensor, as URDF and SDF have them."""


@dataclass(frozen=True, slots=True, eq=False)
class Inertial:
    """Mass, centre of mass and inertia of a rigid body, in SI.

    Parameters
    ----------
    mass_kg
        Total mass.
    com_m
        Shape (3,): centre of mass in the object frame.
    inertia_kg_m2
        Shape (3, 3): inertia tensor about the centre of mass, along the object frame's axes.
    """

    mass_kg: float
    com_m: Vec3
    inertia_kg_m2: Matrix

    @classmethod
    def of(cls, mass: MassProperties) -> Inertial:
        """Convert.

        Examples
        --------
        >>> Inertial.of(MassProperties(16.0, np.ones(3), np.eye(3))).mass_kg
        0.016
        """
        return cls(
            KG_PER_G * mass.mass_g, M_PER_CM * mass.com_cm, KG_M2_PER_G_CM2 * mass.inertia_g_cm2
        )

    @classmethod
    def of_principal(cls, mass_kg: float, com_m: Vec3, moments: Vec3, axes: Matrix) -> Inertial:
        """Put together from principal moments and their axes, the columns of ``axes``."""
        return cls(mass_kg, com_m, axes @ np.diag(moments) @ axes.T)

    def principal(self) -> tuple[Vec3, Matrix]:
        """Principal moments in ascending order, and a right-handed frame of their axes as columns.

        Examples
        --------
        >>> moments, axes = Inertial(1.0, np.zeros(3), np.diag([3.0, 1.0, 2.0])).principal()
        >>> moments.tolist(), float(np.linalg.det(axes).round(9))
        ([1.0, 2.0, 3.0], 1.0)
        """
        moments, axes = np.linalg.eigh(self.inertia_kg_m2)
        return moments, axes * np.sign(np.linalg.det(axes))
