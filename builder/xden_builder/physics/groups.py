"""A source's spectrum in few groups of energy, and what matter does to each of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from jaxtyping import Float, Float64

from xden1k.values.materials import Composition
from xden_builder.physics.attenuation import mac_cm2_g, scattering_cm2_g
from xden_builder.physics.source import Detector, Tube
from xden_builder.physics.spectrum import Spectrum, panel_signal, tube_fluence, tube_spectrum
from xden_builder.physics.spectrum.tables import TABLE_SLOPES

__all__ = ["GROUPS", "EnergyGroups", "energy_groups"]

GROUPS: Final = 24


@dataclass(frozen=True, slots=True, eq=False)
class EnergyGroups:
    """A tube's spectrum, as the panel takes it in, in few groups of energy.

    Parameters
    ----------
    spectrum
        Of the central ray, ungrouped.
    count
        How many groups were asked for.
    slopes
        Shape (nodes,): offset of a ray towards the cathode, per distance along the central ray.
    weights
        Shape (nodes, groups): share of each group in the open field's signal at that slope.
    """

    spectrum: Spectrum
    count: int
    slopes: Float64[np.ndarray, "nodes"]
    weights: Float64[np.ndarray, "nodes groups"]

    def mac_cm2_g(self, composition: Composition) -> Float64[np.ndarray, "groups"]:
        """Mass attenuation coefficient in each group."""
        return _group_mac(self, composition)

    def scattering_cm2_g(self, composition: Composition) -> Float64[np.ndarray, "groups"]:
        """Coherent and incoherent part of it."""
        return _group_scattering(self, composition)

    def weights_at(self, slopes: Float[np.ndarray, "n"]) -> Float64[np.ndarray, "n groups"]:
        """Shares of the groups at any slopes, those beyond the table taken at its end."""
        place = np.interp(slopes, self.slopes, np.arange(len(self.slopes)))
        below = np.minimum(place.astype(np.int64), max(len(self.slopes) - 2, 0))
        share = (place - below)[:, None]
        above = np.minimum(below + 1, len(self.slopes) - 1)
        return np.asarray((1 - share) * self.weights[below] + share * self.weights[above])


@lru_cache(maxsize=1024)
def _group_mac(groups: EnergyGroups, composition: Composition) -> Float64[np.ndarray, "groups"]:
    mac = mac_cm2_g(composition, groups.spectrum.energies_kev)
    return groups.spectrum.group_means(mac, groups.count)


@lru_cache(maxsize=1024)
def _group_scattering(
    groups: EnergyGroups, composition: Composition
) -> Float64[np.ndarray, "groups"]:
    scattering = scattering_cm2_g(composition, groups.spectrum.energies_kev)
    return groups.spectrum.group_means(scattering, groups.count)


def energy_groups(tube: Tube, detector: Detector, count: int = GROUPS) -> EnergyGroups:
    """Pool a source's spectrum into groups, on the central ray and beside it.

    Parameters
    ----------
    tube
        A tube, or a monochromatic source, which is one group.
    detector
        What takes the photons up.
    count
        Of groups, equally wide.

    Raises
    ------
    DataError
        If the voltage lies outside the tables, or a filter or the scintillator is unknown.
    """
    return _energy_groups(
        tube.energy_kev, tube.kv, tuple(tube.filtration_cm.items()), detector, count
    )


@lru_cache(maxsize=64)
def _energy_groups(
    energy_kev: float | None,
    kv: float | None,
    filters_cm: tuple[tuple[str, float], ...],
    detector: Detector,
    count: int,
) -> EnergyGroups:
    tube = Tube(energy_kev=energy_kev, kv=kv, filtration_cm=dict(filters_cm))
    spectrum = tube_spectrum(tube, detector=detector)
    central = spectrum.grouped(count).weights
    if energy_kev is not None:
        return EnergyGroups(spectrum, count, np.zeros(1), central[None])
    slopes = np.array(TABLE_SLOPES)
    energies_kev, fluence = tube_fluence(tube, slopes)
    signal = panel_signal(fluence, energies_kev, detector)
    relative = spectrum.group_means(signal / spectrum.signal_per_cm2, count)
    weights = relative * central
    return EnergyGroups(spectrum, count, slopes, weights / weights.sum(axis=1, keepdims=True))
