"""What a panel makes of the photons that reach it: how many it stops, and what each then counts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from xden1k.errors import DataError
from xden1k.values.materials import Composition
from xden_builder.physics.attenuation import mac_cm2_g

__all__ = ["PANELS", "SCINTILLATOR_G_CM2", "Panel", "absorbed_share", "panel", "panel_signal"]

SCINTILLATOR_G_CM2: Final = 0.22
"""Areal density of a scintillator, such as 0.6 mm of columnar CsI: an assumption."""


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


def panel(scintillator: str) -> Panel:
    """Return the panel of a name.

    Raises
    ------
    DataError
        If there is none.
    """
    if scintillator not in PANELS:
        raise DataError(f"unknown scintillator {scintillator!r}; known are {list(PANELS)}")
    return PANELS[scintillator]


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


def panel_signal(
    photons: Float[np.ndarray, "*rays n"], energies_kev: Float[np.ndarray, "n"], scintillator: str
) -> Float[np.ndarray, "*rays n"]:
    """Return what a panel reads of arriving photons: how many it stops, or their energy in keV.

    Neither escape of fluorescence nor a threshold: a counting panel is taken to count every photon
    that it stops.

    Parameters
    ----------
    photons
        Shape (..., n): arriving at each energy.
    energies_kev
        Shape (n,).
    scintillator
        A key of :data:`PANELS`.

    Examples
    --------
    >>> energies_kev = np.array([30.0, 60.0])
    >>> panel_signal(np.array([100.0, 100.0]), energies_kev, "CsI").round().tolist()
    [2590.0, 4950.0]
    >>> panel_signal(np.array([100.0, 100.0]), energies_kev, "CdTe-counting").round().tolist()
    [100.0, 98.0]
    """
    stopped = photons * absorbed_share(energies_kev, scintillator)
    return np.asarray(stopped if panel(scintillator).counting else stopped * energies_kev)
