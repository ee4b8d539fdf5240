"""Tube spectra and what a panel makes of them: shared by the simulator and the fit.

A spectrum is a tungsten tube's (:mod:`tables`), behind filters, seen by a scintillator that sums
energy or a sensor that counts photons (:mod:`panels`, :mod:`spectrum`). The geometry of the
heel effect: the anode-cathode axis is perpendicular to the central ray, and the spectrum of a ray
depends on its slope along that axis.
"""

from xden_builder.physics.spectrum.dose import air_kerma_mgy, half_value_layer_mm_al
from xden_builder.physics.spectrum.panels import (
    SCINTILLATOR_G_CM2,
    absorbed_share,
    panel_signal,
)
from xden_builder.physics.spectrum.spectrum import (
    Spectrum,
    effective_energy_kev,
    effective_mac_cm2_g,
    tube_fluence,
    tube_spectrum,
)

__all__ = [
    "SCINTILLATOR_G_CM2",
    "Spectrum",
    "absorbed_share",
    "air_kerma_mgy",
    "effective_energy_kev",
    "effective_mac_cm2_g",
    "half_value_layer_mm_al",
    "panel_signal",
    "tube_fluence",
    "tube_spectrum",
]
