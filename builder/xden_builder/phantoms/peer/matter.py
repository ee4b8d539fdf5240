"""Attenuation coefficients of xraylib (Schoonjans et al. 2011, doi:10.1016/j.sab.2011.09.011)."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from jaxtyping import Float

from xden1k.errors import require
from xden1k.values.materials import Composition

__all__ = ["EXTRA", "compton_cm2_g", "mac_cm2_g", "xraylib"]

EXTRA: Final = "peers"
"""The extra that installs the other simulators."""


def xraylib() -> Any:
    """Import the library.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    return require("xraylib", EXTRA)


def mac_cm2_g(
    composition: Composition, energies_kev: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n"]:
    """Mass attenuation coefficient of a mixture: photoelectric, coherent and incoherent."""
    total = xraylib().CS_Total_CP
    return np.array(
        [sum(share * total(formula, kev) for formula, share in composition) for kev in energies_kev]
    )


def compton_cm2_g(composition: Composition, energy_kev: float) -> float:
    """Incoherent part of it."""
    compton = xraylib().CS_Compt_CP
    return float(sum(share * compton(formula, energy_kev) for formula, share in composition))
