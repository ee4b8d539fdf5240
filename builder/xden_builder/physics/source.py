"""What sends the X-rays out and what takes them in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

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
    name
        Which tube it is, such as its serial number; empty where nothing is told.
    """

    energy_kev: float | None = None
    kv: float | None = None
    mas: float | None = None
    filtration_cm: Mapping[str, float] = field(default_factory=dict)
    name: str = ""

    def behind(self, name: str, thickness_cm: float) -> Tube:
        """Return the tube with one more filter; a negative thickness takes some away.

        Examples
        --------
        >>> Tube(kv=100.0, filtration_cm={"Al": 0.25}).behind("Cu", 0.01).filtration_cm
        {'Al': 0.25, 'Cu': 0.01}
        """
        if not thickness_cm:
            return self
        before = self.filtration_cm.get(name, 0.0)
        return replace(self, filtration_cm={**self.filtration_cm, name: before + thickness_cm})


@dataclass(frozen=True)
class Detector:
    """The X-ray detector.

    Parameters
    ----------
    scintillator
        Name of what stops the photons, a scintillator or a counting sensor; empty where it is not
        known.
    bits
        Of the converter, whose top is saturation; None where it is not told.
    layer_g_cm2
        Density times thickness of what stops the photons; None: as assumed for it.
    escape
        Share of a scintillator's K fluorescence that leaves it; None: none.
    threshold_kev
        A counting sensor counts photons above it; None: every photon that it stops.
    """

    scintillator: str = ""
    bits: int | None = None
    layer_g_cm2: float | None = None
    escape: float | None = None
    threshold_kev: float | None = None
