"""What holds, tips and slides by statics alone: a check of the simulator that needs none.

Lengths in cm, masses in g, forces in N, moments in N·m. ``lever`` is always horizontal, and seen
along the axis about which the weight turns the object.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, degrees, hypot

from xden1k.export.si import KG_PER_G, M_PER_CM

__all__ = [
    "GRAVITY_M_S2",
    "Push",
    "edge_margin_cm",
    "push",
    "slip_ratio",
    "tipping_angle_deg",
    "toppling_energy_j",
    "weight_n",
]

GRAVITY_M_S2 = 9.81


def weight_n(mass_g: float) -> float:
    """Weight of a mass.

    Examples
    --------
    >>> weight_n(500.0)
    4.905
    """
    return KG_PER_G * mass_g * GRAVITY_M_S2


def slip_ratio(
    mass_g: float, grip_force_n: float, friction: float, lever_cm: float, patch_radius_cm: float
) -> float:
    """Load of two pads over what their friction holds: the grasp slips from 1 on.

    The limit surface of a contact patch taken for an ellipse of force and moment (Howe and
    Cutkosky, 1996, doi:10.1177/027836499601500603): ``hypot(Mg / 2μN, MgL / 2μNr)``.

    Parameters
    ----------
    mass_g
        Of the object.
    grip_force_n
        Of each pad, N.
    friction
        Coefficient μ.
    lever_cm
        L: from the pads to the centre of mass, across the closing axis.
    patch_radius_cm
        Effective r: torsion is held up to μNr at each pad. A uniform disc of radius R has 2R/3.

    Examples
    --------
    >>> round(slip_ratio(1000, 9.81, 1.0, 2.0, 1.0), 4)  # half the force, as much moment as held
    1.118
    """
    share = weight_n(mass_g) / (2 * friction * grip_force_n)
    return hypot(share, share * lever_cm / patch_radius_cm)


def tipping_angle_deg(com_height_cm: float, edge_distance_cm: float) -> float:
    """Tilt below which an object released from rest comes back: the centre is above the edge.

    Parameters
    ----------
    com_height_cm
        Of the centre of mass above the support.
    edge_distance_cm
        Of its projection from the nearest edge of the support.

    Examples
    --------
    >>> tipping_angle_deg(3.0, 3.0)
    45.0
    """
    return degrees(atan2(edge_distance_cm, com_height_cm))


def toppling_energy_j(mass_g: float, com_height_cm: float, edge_distance_cm: float) -> float:
    """Work that lifts the centre of mass over the edge.

    Examples
    --------
    >>> round(toppling_energy_j(1000, 3.0, 4.0), 6)  # up by 2 cm
    0.1962
    """
    rise_cm = hypot(edge_distance_cm, com_height_cm) - com_height_cm
    return weight_n(mass_g) * rise_cm * M_PER_CM


def edge_margin_cm(true_cm: float, assumed_cm: float, inside_cm: float) -> float:
    """How far inside a table's edge a centre of mass lies; the object falls where it is negative.

    Parameters
    ----------
    true_cm, assumed_cm
        Of the centre of mass, along the direction that leads off the table.
    inside_cm
        The object is laid down with the assumed centre that far inside the edge.

    Examples
    --------
    >>> edge_margin_cm(3.0, 1.0, 0.5)
    -1.5
    """
    return inside_cm - (true_cm - assumed_cm)


@dataclass(frozen=True, slots=True)
class Push:
    """What a horizontal force does to an object that stands.

    Parameters
    ----------
    normal_force_at_cm
        Where the table bears it, from below the centre of mass towards where the force points.
    tips
        Whether that is outside the support.
    slides
        Whether friction gives way.
    """

    normal_force_at_cm: float
    tips: bool
    slides: bool


def push(
    mass_g: float,
    force_n: float,
    friction: float,
    heights_cm: tuple[float, float],
    reaches_cm: tuple[float, float],
) -> Push:
    """Say whether a horizontal push tips or slides an object.

    Moments about the centre of mass: ``x = (F (h_push - h_com) + f h_com) / Mg`` with the friction
    ``f = min(F, μMg)``.

    Parameters
    ----------
    mass_g, force_n, friction
        Of the object, of the push, of the table.
    heights_cm
        Of the push and of the centre of mass above the table.
    reaches_cm
        How far the support goes ahead of the centre of mass and behind it.

    Examples
    --------
    >>> push(1000, 3.0, 0.5, (10.0, 5.0), (2.0, 2.0)).tips  # the table bears it 3 cm ahead
    True
    """
    push_height_cm, com_height_cm = heights_cm
    ahead_cm, behind_cm = reaches_cm
    weight = weight_n(mass_g)
    held = min(force_n, friction * weight)
    at_cm = (force_n * (push_height_cm - com_height_cm) + held * com_height_cm) / weight
    return Push(at_cm, not -behind_cm <= at_cm <= ahead_cm, force_n > friction * weight)
