"""What decides how light falls off with thickness: tube and panel, and what is unknown of both.

All of it is *effective*: a steeper anode hardens a beam as filters do, and copper and aluminium
trade for each other. What they do together is what steps tell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float64

from xden1k.values.materials import Composition
from xden_builder.physics.attenuation import mac_cm2_g
from xden_builder.physics.source import Detector, Tube
from xden_builder.physics.spectrum import tube_spectrum
from xden_builder.physics.spectrum.panels import panel
from xden_builder.physics.spectrum.tables import TABLE_KV

__all__ = ["PROBES", "Probe", "Response", "Term", "terms_of"]

LAYER_SHARE: Final = 0.5
"""How far a panel's layer is from what is assumed of it: 0.4 to 0.9 mm of CsI are sold, and screens
of GOS of 0.03 to 0.15 g/cm²."""
ESCAPE: Final = 0.2
THRESHOLD_KEV: Final = 20.0
"""Where nothing is told: of layers of 0.2 g/cm², and of counting panels as they are usually set."""


@dataclass(frozen=True, slots=True)
class Probe:
    """Something whose transmission is said with its standard deviation.

    Parameters
    ----------
    name
        What it is.
    composition, areal_g_cm2
        Of it.
    """

    name: str
    composition: Composition
    areal_g_cm2: float


PROBES: Final = (
    Probe("40 mm Al", (("Al", 1.0),), 2.70 * 4.0),
    Probe("5 mm Fe", (("Fe", 1.0),), 7.87 * 0.5),
    Probe("10 mm Fe", (("Fe", 1.0),), 7.87 * 1.0),
)


@dataclass(frozen=True, slots=True)
class Term:
    """One unknown.

    Parameters
    ----------
    name
        How files call it.
    mean, sd
        What is believed before any step.
    low, high
        What it can be.
    unit, times
        For people, and how many of it one is.
    """

    name: str
    mean: float
    sd: float
    low: float
    high: float
    unit: str
    times: float = 1.0


@dataclass(frozen=True, slots=True)
class Response:
    """Tube and panel.

    Parameters
    ----------
    tube
        Polychromatic.
    detector
        Its panel.
    """

    tube: Tube
    detector: Detector

    def known(self, terms: Sequence[Term]) -> Float64[np.ndarray, "terms"]:
        """Values of the unknowns; what is not told is as it is usually."""
        tube, detector = self.tube, self.detector
        told = {
            "kv": tube.kv,
            "Al": tube.filtration_cm.get("Al", 0.0),
            "Cu": tube.filtration_cm.get("Cu", 0.0),
            "layer": detector.layer_g_cm2,
            "escape": detector.escape,
            "threshold": detector.threshold_kev,
        }
        return np.array([term.mean if (v := told[term.name]) is None else v for term in terms])

    def having(self, terms: Sequence[Term], values: Float64[np.ndarray, "terms"]) -> Response:
        """Return it with other values of the unknowns; a filter of nothing is left out."""
        found = dict(zip((term.name for term in terms), values.tolist(), strict=True))
        filters = {**self.tube.filtration_cm, "Al": found["Al"], "Cu": found["Cu"]}
        kept = {name: cm for name, cm in filters.items() if cm > 0}
        return Response(
            replace(self.tube, kv=found["kv"], filtration_cm=kept),
            replace(
                self.detector,
                layer_g_cm2=found["layer"],
                escape=found.get("escape"),
                threshold_kev=found.get("threshold"),
            ),
        )

    def log_transmission(self, probe: Probe) -> float:
        """Logarithm of the share of the signal that comes through something."""
        spectrum = tube_spectrum(self.tube, detector=self.detector)
        mac = mac_cm2_g(probe.composition, spectrum.energies_kev)
        return float(np.log(spectrum.transmission(mac * probe.areal_g_cm2)))


def terms_of(told: Response) -> tuple[Term, ...]:
    """Return what is unknown of a tube and its panel.

    Generators err by some kV, tubes and their housings filter by themselves, and plates are there
    that nobody told of. Layers differ in thickness; fluorescence escapes from scintillators, and
    sensors that count do not count soft photons.
    """
    tube, detector = told.tube, told.detector
    assert tube.kv is not None
    layer = panel(detector.scintillator)
    areal = detector.layer_g_cm2 or layer.areal_g_cm2
    al, cu = (tube.filtration_cm.get(name, 0.0) for name in ("Al", "Cu"))
    if layer.counting:
        threshold = detector.threshold_kev or THRESHOLD_KEV
        last = Term("threshold", threshold, 8.0, 1.0, 60.0, "keV")
    else:
        escape = ESCAPE if detector.escape is None else detector.escape
        last = Term("escape", escape, 0.15, 0.0, 1.0, "% of fluorescence", 100.0)
    return (
        Term("kv", tube.kv, 3.0, TABLE_KV[0], TABLE_KV[-1], "kV"),
        Term("Al", al, 0.3, 0.0, np.inf, "mm Al", 10.0),
        Term("Cu", cu, 0.03, 0.0, np.inf, "mm Cu", 10.0),
        Term("layer", areal, LAYER_SHARE * areal, 0.1 * areal, np.inf, "mg/cm² of layer", 1000.0),
        last,
    )
