"""The beam as the panel's rows meet it: energy groups, hardness and open field."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from jaxtyping import Float

from xden1k.values.materials import Composition
from xden_builder.physics.attenuation import mac_cm2_g, scattering_cm2_g
from xden_builder.physics.source import Detector, Tube
from xden_builder.physics.spectrum import Spectrum, absorbed_share, tube_fluence, tube_spectrum
from xden_builder.physics.spectrum.tables import TABLE_DISTANCE_CM

__all__ = ["Beam", "kept_beam", "make_beam"]


@dataclass(frozen=True, slots=True, eq=False)
class Beam:
    """A beam in energy groups, over the rows of a panel.

    Parameters
    ----------
    spectrum
        Of the central ray.
    groups
        How many energy groups stand for it.
    energies_kev
        Shape (groups,).
    row_weights
        Shape (rows, groups): share of each group in the open field's signal; rows add up to 1.
    open_field
        Shape (rows, columns): signal without object, 1 in the middle of the panel.
    kev_per_cm2
        Energy that the middle of the panel takes up without object; None where the exposure is
        not known, as for a monochromatic source.
    """

    spectrum: Spectrum
    groups: int
    energies_kev: Float[np.ndarray, "groups"]
    row_weights: Float[np.ndarray, "rows groups"]
    open_field: Float[np.ndarray, "rows columns"]
    kev_per_cm2: float | None

    def mac_cm2_g(self, composition: Composition) -> Float[np.ndarray, "groups"]:
        """Mass attenuation coefficient in each group."""
        mac = mac_cm2_g(composition, self.spectrum.energies_kev)
        return self.spectrum.group_means(mac, self.groups)

    def scattering_cm2_g(self, composition: Composition) -> Float[np.ndarray, "groups"]:
        """Coherent and incoherent part of it."""
        scattering = scattering_cm2_g(composition, self.spectrum.energies_kev)
        return self.spectrum.group_means(scattering, self.groups)


def make_beam(
    tube: Tube,
    *,
    groups: int,
    scintillator_g_cm2: float,
    heel: bool,
    size_px: int,
    panel_cm: float,
    distance_cm: float,
) -> Beam:
    """Spread a tube's beam over a panel.

    The anode-cathode axis is parallel to the panel's columns, the anode above: rows differ in
    hardness and intensity. Along a row only the inverse square of the distance and the slant of
    the panel act; the slight hardening towards its ends (0.04 keV at 15 cm) is neglected.

    Parameters
    ----------
    tube
        Monochromatic or not.
    groups
        Of energy, equally wide.
    scintillator_g_cm2
        Of caesium iodide.
    heel
        Whether rows differ at all; without, the open field is 1 everywhere.
    size_px, panel_cm, distance_cm
        The panel, and its distance from the source.
    """
    spectrum = tube_spectrum(tube, detector=Detector("CsI", layer_g_cm2=scintillator_g_cm2))
    grouped = spectrum.grouped(groups)
    weights = np.tile(grouped.weights, (size_px, 1))
    open_field = np.ones((size_px, size_px))
    if heel:
        offsets = ((np.arange(size_px) + 0.5) / size_px - 0.5) * panel_cm / distance_cm
        signal = _row_signal(tube, offsets, scintillator_g_cm2) / spectrum.signal_kev_per_cm2.sum()
        weights = spectrum.group_means(signal / spectrum.weights, groups) * grouped.weights
        along = 1 + offsets[:, None] ** 2
        slant = along + offsets**2
        # the rows' signal has the inverse square of its own slope; the rest, and the slant:
        open_field = weights.sum(axis=1, keepdims=True) * along / slant**1.5
        weights = weights / weights.sum(axis=1, keepdims=True)
    kev_per_cm2 = None
    if tube.mas is not None:
        kev_per_cm2 = float(
            spectrum.signal_kev_per_cm2.sum() * (TABLE_DISTANCE_CM / distance_cm) ** 2
        )
    return Beam(spectrum, groups, grouped.energies_kev, weights, open_field, kev_per_cm2)


def kept_beam(tube: Tube, **panel: Any) -> Beam:
    """Make a beam of :func:`make_beam`, or give the one made before."""
    filters_cm = tuple(tube.filtration_cm.items())
    return _kept_beam(tube.energy_kev, tube.kv, tube.mas, filters_cm, **panel)


@lru_cache(maxsize=16)
def _kept_beam(
    energy_kev: float | None,
    kv: float | None,
    mas: float | None,
    filters_cm: tuple[tuple[str, float], ...],
    **panel: Any,
) -> Beam:
    return make_beam(Tube(energy_kev, kv, mas, dict(filters_cm)), **panel)


def _row_signal(
    tube: Tube, slopes: Float[np.ndarray, "rows"], scintillator_g_cm2: float
) -> Float[np.ndarray, "rows energies"]:
    energies_kev, fluence = tube_fluence(tube, slopes)
    absorbed = absorbed_share(energies_kev, areal_g_cm2=scintillator_g_cm2)
    return np.asarray(fluence * absorbed * energies_kev)
