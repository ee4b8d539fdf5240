"""What a panel makes of a photon: scintillators whose K fluorescence escapes, photon counting."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.special import expn

from xden_builder.phantoms.peer.matter import mac_cm2_g, xraylib

__all__ = ["SCREENS", "Screen", "draw_screen"]

Energies = Float[np.ndarray, "n"]
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(48)


@dataclass(frozen=True, slots=True)
class Screen:
    """A layer that stops photons.

    Parameters
    ----------
    formula
        Of the layer.
    areal_g_cm2
        Density times thickness.
    threshold_kev
        Photon counting: every photon above it counts 1. 0: the energy left in the layer counts.
    told
        What ``scanner.toml`` calls it.
    """

    formula: str
    areal_g_cm2: float
    threshold_kev: float
    told: str

    def absorbed(self, energies_kev: Energies) -> Energies:
        """Share of photons that are stopped."""
        return np.asarray(-np.expm1(-self._mac(energies_kev) * self.areal_g_cm2))

    def signal(self, energies_kev: Energies) -> Energies:
        """Mean signal of an arriving photon."""
        absorbed = self.absorbed(energies_kev)
        if self.threshold_kev:
            return np.asarray(np.where(energies_kev > self.threshold_kev, absorbed, 0.0))
        return np.asarray(absorbed * energies_kev - self.escaping_kev(energies_kev))

    def signal_squared(self, energies_kev: Energies) -> Energies:
        """Mean square of the signal of an arriving photon; escape neglected."""
        absorbed, signal = self.absorbed(energies_kev), self.signal(energies_kev)
        square = np.zeros_like(signal)
        np.divide(signal**2, absorbed, out=square, where=absorbed > 0)
        return square

    def escaping_kev(self, energies_kev: Energies) -> Energies:
        """Mean energy that leaves again as K fluorescence, for an arriving photon.

        Photons interact at depth z with density exp(-m z); half of the fluorescence goes to either
        face and, being isotropic, passes E2(m' x) of it over the areal distance x.
        """
        total = np.zeros_like(energies_kev)
        mac = self._mac(energies_kev)
        depth = self.areal_g_cm2 * (_NODES + 1) / 2
        arriving = np.exp(-np.outer(mac, depth))
        for line_kev, yield_cm2_g in self._lines(energies_kev):
            own = float(self._mac(np.array([line_kev]))[0])
            out = (expn(2, own * depth) + expn(2, own * (self.areal_g_cm2 - depth))) / 2
            passed = arriving @ (_WEIGHTS * out) * self.areal_g_cm2 / 2
            total += line_kev * yield_cm2_g * passed
        return total

    def _mac(self, energies_kev: Energies) -> Energies:
        return mac_cm2_g(((self.formula, 1.0),), energies_kev)

    def _lines(self, energies_kev: Energies) -> Iterator[tuple[float, Energies]]:
        """Energy of each K line, and how many of it arise per photon and g/cm²."""
        lib = xraylib()
        parsed = lib.CompoundParser(self.formula)
        for number, share in zip(parsed["Elements"], parsed["massFractions"], strict=True):
            edge_kev = lib.EdgeEnergy(number, lib.K_SHELL)
            if edge_kev < _LEAST_EDGE_KEV:
                continue
            photo = np.array([lib.CS_Photo(number, kev) for kev in energies_kev])
            in_k = photo * (1 - 1 / lib.JumpFactor(number, lib.K_SHELL))
            made = share * np.where(energies_kev > edge_kev, in_k, 0.0)
            made *= lib.FluorYield(number, lib.K_SHELL)
            for line in (lib.KA_LINE, lib.KB_LINE):
                yield lib.LineEnergy(number, line), made * lib.RadRate(number, line)


_LEAST_EDGE_KEV: Final = 15.0
"""Fluorescence of lighter elements does not come far."""

SCREENS: Final = ("csi", "gos", "counting")


def draw_screen(rng: np.random.Generator, kind: str) -> Screen:
    """Draw a screen: caesium iodide, gadolinium oxysulphide, or a counting CdTe sensor.

    Examples
    --------
    >>> draw_screen(np.random.default_rng(0), "gos").told
    'GOS'
    """
    share = rng.random()
    return {
        "csi": Screen("CsI", round(0.15 + 0.15 * share, 3), 0.0, "CsI"),
        "gos": Screen("Gd2O2S", round(0.07 + 0.08 * share, 3), 0.0, "GOS"),
        "counting": Screen("CdTe", 0.585, round(15.0 + 15.0 * share, 1), "CdTe-counting"),
    }[kind]
