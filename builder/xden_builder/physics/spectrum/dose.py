"""Air kerma and half-value layer: what a dosimeter says of a beam."""

from __future__ import annotations

from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq

from xden_builder.physics.attenuation import mac_cm2_g
from xden_builder.physics.spectrum.spectrum import Spectrum

__all__ = ["air_kerma_mgy", "half_value_layer_mm_al"]

# Mass energy-absorption coefficient of dry air: Hubbell and Seltzer, NISTIR 5632 (1995), table 4
_AIR_KEV: Final = np.array([10.0, 15, 20, 30, 40, 50, 60, 80, 100, 150])
_AIR_CM2_G: Final = np.array(
    [4.742, 1.334, 0.5389, 0.1537, 0.06833, 0.04098, 0.03041, 0.02407, 0.02325, 0.02496]
)
_MGY_PER_KEV_G: Final = 1.602176634e-16 * 1e3 * 1e3
"""Joule per keV, grams per kilogram, milligray per gray."""
_ALUMINIUM_G_CM3: Final = 2.699


def _kerma_by_bin_mgy(spectrum: Spectrum) -> Float[np.ndarray, "n"]:
    absorption = np.exp(
        np.interp(np.log(spectrum.energies_kev), np.log(_AIR_KEV), np.log(_AIR_CM2_G))
    )
    return np.asarray(
        spectrum.photons_per_cm2 * spectrum.energies_kev * absorption * _MGY_PER_KEV_G
    )


def air_kerma_mgy(spectrum: Spectrum) -> float:
    """Kerma in air at 100 cm, whatever the detector."""
    return float(_kerma_by_bin_mgy(spectrum).sum())


def half_value_layer_mm_al(spectrum: Spectrum) -> float:
    """Thickness of aluminium that halves the air kerma."""
    kerma = _kerma_by_bin_mgy(spectrum)
    lac_per_mm = mac_cm2_g((("Al", 1.0),), spectrum.energies_kev) * _ALUMINIUM_G_CM3 / 10

    def excess(thickness_mm: float) -> float:
        return float(kerma @ np.exp(-lac_per_mm * thickness_mm) - kerma.sum() / 2)

    return float(brentq(excess, 0.0, 100.0))
