"""What a panel makes of the photons that reach it: how many it stops, and what each then counts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.special import erfc

from xden1k.errors import DataError
from xden1k.values.materials import Composition
from xden_builder.physics.attenuation import k_fluorescence_cm2_g, mac_cm2_g
from xden_builder.physics.source import Detector

__all__ = [
    "PANELS",
    "SCINTILLATOR_G_CM2",
    "Panel",
    "absorbed_share",
    "panel",
    "panel_signal",
    "taken_up",
]

SCINTILLATOR_G_CM2: Final = 0.22
"""Areal density of a scintillator, such as 0.6 mm of columnar CsI: an assumption."""
THRESHOLD_SD_KEV: Final = 2.0
"""How far a counting sensor errs about a photon's energy (standard deviation, assumed)."""


@dataclass(frozen=True, slots=True)
class Panel:
    """The layer of a panel that stops photons.

    Parameters
    ----------
    composition
        Of the layer.
    areal_g_cm2
        Its density times thickness: assumed, as files do not tell it.
    counting
        Whether each photon that is stopped counts 1; else the energy that it leaves is summed.
    """

    composition: Composition
    areal_g_cm2: float
    counting: bool = False


PANELS: Final = {
    "CsI": Panel((("CsI", 1.0),), SCINTILLATOR_G_CM2),
    "GOS": Panel((("Gd2O2S", 1.0),), SCINTILLATOR_G_CM2),
    "CdTe-counting": Panel((("CdTe", 1.0),), 0.585, counting=True),  # 1 mm of 5.85 g/cm³
    "Si-counting": Panel((("Si", 1.0),), 0.105, counting=True),  # 0.45 mm of 2.33 g/cm³
}
"""By the name that ``detector.scintillator`` of a ``scanner.toml`` gives."""
ASSUMED: Final = "CsI"
"""Where it gives none."""


def panel(scintillator: str) -> Panel:
    """Return the panel of a name; without one that of caesium iodide, which is assumed then.

    Raises
    ------
    DataError
        If there is none.
    """
    name = scintillator or ASSUMED
    if name not in PANELS:
        raise DataError(f"unknown scintillator {name!r}; known are {list(PANELS)}")
    return PANELS[name]


def absorbed_share(
    energies_kev: Float[np.ndarray, "n"],
    scintillator: str = "CsI",
    areal_g_cm2: float | None = None,
) -> Float[np.ndarray, "n"]:
    """Share of photons that interact in a layer hit at right angles: 1 - exp(-m t).

    Parameters
    ----------
    energies_kev
        Shape (n,).
    scintillator
        A key of :data:`PANELS`.
    areal_g_cm2
        Of the layer; None: as assumed for it.

    Raises
    ------
    DataError
        If the scintillator is unknown.

    Examples
    --------
    >>> absorbed_share(np.array([30.0, 60.0])).round(2).tolist()
    [0.86, 0.82]
    """
    layer = panel(scintillator)
    areal = layer.areal_g_cm2 if areal_g_cm2 is None else areal_g_cm2
    return np.asarray(-np.expm1(-mac_cm2_g(layer.composition, energies_kev) * areal))


def taken_up(energies_kev: Float[np.ndarray, "n"], detector: Detector) -> Float[np.ndarray, "n"]:
    """Share that a panel takes up: of the energy that arrives, or of the photons if it counts them.

    What is stopped, less the K fluorescence that leaves a scintillator again, or the photons that a
    counting sensor takes for softer than its threshold; neither where the detector tells of none.

    Parameters
    ----------
    energies_kev
        Shape (n,).
    detector
        Without a scintillator's name: caesium iodide is assumed.

    Raises
    ------
    DataError
        If the scintillator is unknown.

    Examples
    --------
    >>> energies_kev = np.array([30.0, 60.0])
    >>> taken_up(energies_kev, Detector("CsI", escape=0.2)).round(2).tolist()
    [0.86, 0.76]
    >>> taken_up(energies_kev, Detector("CdTe-counting", threshold_kev=30.0)).round(2).tolist()
    [0.5, 0.98]
    """
    layer = panel(detector.scintillator)
    stopped = absorbed_share(energies_kev, detector.scintillator, detector.layer_g_cm2)
    if layer.counting and detector.threshold_kev is not None:
        below = (detector.threshold_kev - energies_kev) / THRESHOLD_SD_KEV
        return np.asarray(stopped * erfc(below / np.sqrt(2)) / 2)
    if not layer.counting and detector.escape is not None:
        sent_kev = k_fluorescence_cm2_g(layer.composition, energies_kev)
        sent_kev /= mac_cm2_g(layer.composition, energies_kev)
        return np.asarray(stopped * (1 - detector.escape * sent_kev / energies_kev))
    return stopped


def panel_signal(
    photons: Float[np.ndarray, "*rays n"],
    energies_kev: Float[np.ndarray, "n"],
    detector: Detector,
) -> Float[np.ndarray, "*rays n"]:
    """Return what a panel reads of arriving photons: how many it stops, or their energy in keV.

    Parameters
    ----------
    photons
        Shape (..., n): arriving at each energy.
    energies_kev
        Shape (n,).
    detector
        As of :func:`taken_up`.

    Examples
    --------
    >>> energies_kev = np.array([30.0, 60.0])
    >>> panel_signal(np.array([100.0, 100.0]), energies_kev, Detector("CsI")).round().tolist()
    [2590.0, 4950.0]
    >>> counting = Detector("CdTe-counting")
    >>> panel_signal(np.array([100.0, 100.0]), energies_kev, counting).round().tolist()
    [100.0, 98.0]
    """
    taken = photons * taken_up(energies_kev, detector)
    return np.asarray(taken if panel(detector.scintillator).counting else taken * energies_kev)
