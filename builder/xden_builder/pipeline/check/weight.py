"""Whether a weighed mass can be that of parts of known volumes and materials."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from xden1k.values.materials import load_materials
from xden_builder.capture import CapturePart
from xden_builder.poly.materials.candidates import candidates

__all__ = ["possible_density_g_cm3", "weight_contradiction"]

LIGHTER: Final = 2.0
"""By this factor parts may be lighter than they can be: pores and hollows nobody drew."""
HEAVIER: Final = 1.5
"""By this factor they may be heavier: thin walls meshed too thin, or a part without a mesh."""


def possible_density_g_cm3(part: CapturePart) -> tuple[float, float]:
    """Return least and most density of what a part's label names; of anything without one.

    Examples
    --------
    >>> import trimesh
    >>> block = CapturePart("block", trimesh.creation.box(), "aluminium")
    >>> [round(each, 2) for each in possible_density_g_cm3(block)]
    [2.64, 2.77]
    """
    named = [
        each
        for each in candidates(part.material, hollow=part.hollow)
        if load_materials()[each.material].called(part.material) and (each.solid or part.hollow)
    ]
    return min(each.low_g_cm3 for each in named), max(each.high_g_cm3 for each in named)


def weight_contradiction(
    mass_g: float, parts: Sequence[CapturePart], volumes_cm3: Sequence[float]
) -> str | None:
    """Say that a mass is out of what the parts can weigh; None where it is not.

    Parameters
    ----------
    mass_g
        On the scale.
    parts
        With their labels.
    volumes_cm3
        Of the space that each part owns.
    """
    ranges = [possible_density_g_cm3(part) for part in parts]
    least, most = (
        sum(volume * each[end] for volume, each in zip(volumes_cm3, ranges, strict=True))
        for end in (0, 1)
    )
    least, most = least / LIGHTER, most * HEAVIER
    if least <= mass_g <= most:
        return None
    return (
        f"mass_g is {mass_g:g} g, but the parts' volumes and materials allow "
        f"{least:.3g} to {most:.3g} g: weigh again, or check labels, mesh_units, and whether every "
        "part has a mesh"
    )
