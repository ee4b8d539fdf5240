"""What sends the X-rays out and what takes them in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

__all__ = ["Detector", "Tube"]


@dataclass(frozen=True)
class Tube:
    """The X-ray source: monochromatic (``energy_kev``) or a tube (``kv``).

    Parameters
    ----------
    energy_kev
        Photon energy of a monochromatic source.
    kv, mas
        Voltage and charge of a polychromatic tube.
    filtration_cm
        Thickness of each filter, by the symbol of an element or a name of the material library.
    """

    energy_kev: float | None = None
    kv: float | None = None
    mas: float | None = None
    filtration_cm: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Detector:
    """The X-ray detector.

    Parameters
    ----------
    scintillator
        Its name; empty where it is not known.
    bits
        Of the converter; without it no pixel is called saturated.
    """

    scintillator: str = ""
    bits: int | None = None
