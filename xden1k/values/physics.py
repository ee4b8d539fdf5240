"""Attenuation and density: the constants and conversions, each with its source.

Symbols: LAC, the linear attenuation coefficient, 1/cm; MAC, the mass attenuation coefficient
LAC / density, cm²/g; transmission T = I / I0 = exp(-sum LAC * path) (Beer-Lambert; Eq. 1 and 2
of the XDen-1K paper, arXiv 2512.10668).
"""

from typing import Final, TypeVar

import numpy as np

__all__ = ["PAPER_MAC_CM2_G", "apparent_density_g_cm3"]

PAPER_MAC_CM2_G: Final = 0.17
"""The single MAC of the paper's density rule (Eq. 4): water at 100 keV, where NIST XCOM has
0.1707 cm²/g."""

Values = TypeVar("Values", float, np.ndarray)


def apparent_density_g_cm3(lac_per_cm: Values) -> Values:
    """Density by the paper's rule, LAC / 0.17 (Eq. 4).

    Right for water-like matter at 100 keV only: with a 100 kV tube it reads aluminium 1.8 to 3.2
    and steel 3 to 16 times too dense.

    Examples
    --------
    >>> round(apparent_density_g_cm3(0.34), 6)
    2.0
    """
    return lac_per_cm / PAPER_MAC_CM2_G
