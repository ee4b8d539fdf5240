"""The panel: quanta, electronics, converter, dead pixels and calibration images.

Noise: the quanta that stop in the scintillator follow Poisson's law and each adds its energy. A
pixel's signal is then a compound Poisson variable; it is drawn as a Poisson number of equal quanta
of the signal's mean energy, which has the same mean and variance (the second moment of the
deposited energy). Not modelled: spread of the light yield, and noise that blur shares between
pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt16

from xden1k.values.arrays import Image, Mask
from xden_builder.capture.calibration import LEAST_OPEN_FIELD

__all__ = ["Calibration", "Panel"]

Counts = Float[np.ndarray, "rows columns"]
Stored = UInt16[np.ndarray, "rows columns"]


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """Reference images of one view: without object and without beam, as the panel stores them."""

    flat: Stored
    dark: Stored


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """The panel of one view.

    Parameters
    ----------
    open_counts, dark_counts, readout_sd_counts, quantum_noise, bits
        As of :class:`Scanner`.
    counts_per_kev
        Signal of one quantum, by its energy; None where each quantum counts 1.
    dead
        Pixels that do not see light.
    """

    open_counts: float
    dark_counts: float
    readout_sd_counts: float
    quantum_noise: bool
    bits: int
    counts_per_kev: float | None
    dead: Mask

    def read(self, share: Counts, mean_kev: Image, frames: int, rng: np.random.Generator) -> Stored:
        """Read the mean of some frames in which each pixel gets a share of the open beam."""
        per_quantum = 1.0 if self.counts_per_kev is None else self.counts_per_kev * mean_kev
        light = frames * self.open_counts * np.where(self.dead, 0.0, share) / per_quantum
        if self.quantum_noise:
            light = rng.poisson(light).astype(np.float64)
        electronic = rng.normal(0.0, self.readout_sd_counts / np.sqrt(frames), share.shape)
        counts = light * per_quantum / frames + self.dark_counts + electronic
        return np.asarray(counts.round().clip(0, 2**self.bits - 1), dtype=np.uint16)

    def corrected(self, raw: Stored, calibration: Calibration) -> tuple[Image, Mask]:
        """Transmission and valid pixels of a radiograph, as the builder finds them on reading."""
        flat, dark = (image.astype(np.float64) for image in (calibration.flat, calibration.dark))
        full, light = 2**self.bits - 1, flat - dark
        valid = (raw < full) & (calibration.flat < full)
        valid &= light > LEAST_OPEN_FIELD * np.median(light)
        transmission = np.full_like(light, np.nan)
        np.divide(raw - dark, light, out=transmission, where=valid)
        return transmission.astype(np.float32), valid
