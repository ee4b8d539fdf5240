"""From attenuation to density, by what is known of the source and of the material.

====================  ==============================  =========================================
source                material                        density
====================  ==============================  =========================================
monochromatic         a name of the library           LAC / MAC(E), ``xray``
monochromatic         a family, or unknown            LAC / 0.17, ``xray``, ``apparent_density``
tube (a spectrum)     any                             the polychromatic fit's; with ``paper``
                                                      LAC / 0.17, ``xray``, ``apparent_density``
unknown               any                             none, ``attenuation_only``
====================  ==============================  =========================================

A part that the X-rays do not tell (no ray meets it, or monochromatic and with a coefficient that
is ``uncertain`` or at the upper bound while the material's range says more) takes the density its
material usually has, ``prior``. Hidden and of no known material, it has none: ``no_density``. A
density that does not go with the material's range is kept as measured and flagged
``unlike_material``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from xden1k.values.materials import Material, load_materials
from xden1k.values.physics import PAPER_MAC_CM2_G, apparent_density_g_cm3
from xden1k.values.types import DensitySource
from xden_builder.capture import CapturePart
from xden_builder.fit import LacFit
from xden_builder.physics.attenuation import mac_cm2_g
from xden_builder.physics.source import Tube

__all__ = ["PartDensity", "part_densities"]

MAC_SD_SHARE: Final = 0.01
"""Relative standard deviation of a tabulated coefficient: 1 to 2 % between 5 keV and a few MeV
(Hubbell, 1999, doi:10.1088/0031-9155/44/1/001)."""
FAR_SD: Final = 3.0
HOLLOW_LEAST: Final = 0.05
HOLLOW_USUAL: Final = 0.8
HOLLOW_SD: Final = 0.35
"""A hollow part's mean density as shares of its material's: least, usual, and its spread."""


@dataclass(frozen=True, slots=True)
class PartDensity:
    """What is known of one part's density.

    Parameters
    ----------
    density_g_cm3, sd_g_cm3
        Mean over the part's mesh and its standard deviation; nan where unknown.
    source
        ``xray``, ``prior`` or ``none``.
    flags
        Sorted: those of the fit and of the conversion.
    """

    density_g_cm3: float
    sd_g_cm3: float
    source: DensitySource
    flags: tuple[str, ...]


def part_densities(
    fit: LacFit, parts: Sequence[CapturePart], tube: Tube | None
) -> tuple[PartDensity, ...]:
    """Density of each part, by the table above.

    Parameters
    ----------
    fit
        The coefficients, in the order of the parts.
    parts
        Their materials, and which are hollow: those may be less dense than their material.
    tube
        The X-ray source; None where it is not known.

    Raises
    ------
    DataError
        If the photon energy lies outside the tables.
    """
    return tuple(
        _part_density(float(lac), float(sd), flags, part, tube)
        for lac, sd, flags, part in zip(
            fit.lac_per_cm, fit.lac_sd_per_cm, fit.flags, parts, strict=True
        )
    )


def _part_density(
    lac_per_cm: float, sd_per_cm: float, flags: frozenset[str], part: CapturePart, tube: Tube | None
) -> PartDensity:
    material = load_materials().get(part.material)
    if tube is None:
        return _unknown(flags | {"attenuation_only"})
    if "hidden" in flags:
        return (
            _unknown(flags | {"no_density"}) if material is None else _prior(part, material, flags)
        )
    if tube.energy_kev is None or material is None:
        return _apparent(lac_per_cm, sd_per_cm, flags)
    measured = _measured(lac_per_cm, sd_per_cm, flags, part, material, tube.energy_kev)
    prior = _prior(part, material, flags)
    starved = "uncertain" in flags or ("at_bound" in flags and lac_per_cm > 0)
    return prior if starved and prior.sd_g_cm3 < measured.sd_g_cm3 else measured


def _unknown(flags: frozenset[str]) -> PartDensity:
    return PartDensity(math.nan, math.nan, "none", tuple(sorted(flags)))


def _apparent(lac_per_cm: float, sd_per_cm: float, flags: frozenset[str]) -> PartDensity:
    return PartDensity(
        apparent_density_g_cm3(lac_per_cm),
        sd_per_cm / PAPER_MAC_CM2_G,
        "xray",
        tuple(sorted(flags | {"apparent_density"})),
    )


def _measured(
    lac_per_cm: float,
    sd_per_cm: float,
    flags: frozenset[str],
    part: CapturePart,
    material: Material,
    energy_kev: float,
) -> PartDensity:
    mac = float(mac_cm2_g(material.composition, energy_kev))
    density = lac_per_cm / mac
    sd = math.hypot(sd_per_cm / mac, MAC_SD_SHARE * density)
    low, high = material.density_low_g_cm3, material.density_high_g_cm3
    if part.hollow:
        low = HOLLOW_LEAST * material.density_nominal_g_cm3
    if not low - FAR_SD * sd <= density <= high + FAR_SD * sd:
        flags |= {"unlike_material"}
    return PartDensity(density, sd, "xray", tuple(sorted(flags)))


def _prior(part: CapturePart, material: Material, flags: frozenset[str]) -> PartDensity:
    nominal, sd = material.density_nominal_g_cm3, material.density_sd_g_cm3
    if part.hollow:
        nominal, sd = HOLLOW_USUAL * nominal, HOLLOW_SD * nominal
    return PartDensity(nominal, sd, "prior", tuple(sorted(flags)))
