"""Compositions that are not quite the library's: pigments, fillers, alloying elements."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from xden1k.values.materials import load_materials
from xden_builder.phantoms.phantom import Phantom
from xden_builder.physics.attenuation import mac_cm2_g, scattering_cm2_g

__all__ = ["MOST_COMPOSITION_SD", "photoelectric_factors"]

MOST_COMPOSITION_SD = 0.05
"""Here plastics, which owe a twenty-fifth of their attenuation to absorption, have six tenths of it
in the median, and one in twenty three times as much."""


def photoelectric_factors(
    phantom: Phantom, composition_sd: float, energy_kev: float
) -> Float64[np.ndarray, "parts"]:
    """Draw the photoelectric coefficient of each part, over that of the library.

    What is added to a material or left out of it hardly changes how a gram of it scatters, which
    goes mostly by its electrons (coherent scatter is left as it is, too); what it absorbs goes by
    the third to fourth power of atomic numbers. All parts of one material in an object are of one
    composition. Factors are log-normal, since nothing absorbs less than nothing: in plastics,
    which absorb little, they are skewed as fillers are.

    Parameters
    ----------
    phantom
        The object.
    composition_sd
        Relative standard deviation of the whole mass attenuation coefficient, whose mean is the
        library's.
    energy_kev
        At this energy.
    """
    rng, factors = phantom.plan.rng("composition"), dict[str, float]()
    for name in dict.fromkeys(part.material for part in phantom.parts):
        composition = load_materials()[name].composition
        whole = float(mac_cm2_g(composition, energy_kev))
        absorbed = whole - float(scattering_cm2_g(composition, np.array(energy_kev)))
        variance = np.log1p((composition_sd * whole / absorbed) ** 2)
        factors[name] = float(rng.lognormal(-variance / 2, np.sqrt(variance)))
    return np.array([factors[part.material] for part in phantom.parts])
