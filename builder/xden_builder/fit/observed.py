"""What each view tells: pixels on the object one by one, all air as three numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float32, Float64
from scipy.ndimage import binary_dilation

from xden1k.errors import DataError
from xden1k.rays import PathLengths
from xden1k.values.arrays import Mask
from xden1k.values.views import XRayView
from xden_builder.capture.saturation import GainBounds
from xden_builder.fit import kernels
from xden_builder.fit.crops import Crop
from xden_builder.fit.values import FitSettings

__all__ = ["Air", "ViewData"]

NOISE_FLOOR: Final = 1e-5
"""Least standard deviation of a transmission: half a step of 16 bits."""
NOISE_WITHOUT_AIR: Final = 0.01
"""Assumed at T = 1 where no air shows the noise."""
READOUT_SHARE: Final = 0.02
"""Share of the noise variance at T = 1 that is readout, where the dark noise is not known."""

MEDIAN_SAMPLE: Final = 1 << 16


@dataclass(frozen=True, slots=True)
class Air:
    """Pixels beside the object: how many, their mean transmission and its scatter."""

    count: int
    mean: float
    sd: float


@dataclass(frozen=True, eq=False)
class ViewData:
    """What one view tells.

    Parameters
    ----------
    name
        The view's.
    lengths
        Its path lengths.
    ways
        The same, of the parts that a pixel meets alone.
    measured
        Shape (n,): transmission of the pixels of the path lengths; 1 where not usable.
    usable
        Shape (n,): valid, and no mesh is open there.
    air
        What lies beside the object.
    dark_sd
        Noise at transmission 0.
    gain_bounds
        Least and most gain where the air is saturated; None where the air tells the gain.
    """

    name: str
    lengths: PathLengths
    ways: kernels.Ways
    measured: Float64[np.ndarray, "n"]
    usable: Bool[np.ndarray, "n"]
    air: Air
    dark_sd: float
    gain_bounds: GainBounds | None = None

    @classmethod
    def of(
        cls,
        lengths: PathLengths,
        view: XRayView,
        settings: FitSettings,
        dark_sd: float | None,
        gain_bounds: GainBounds | None = None,
    ) -> ViewData:
        """Take the used pixels out of the frame; without ``dark_sd`` it is guessed from the air.

        Raises
        ------
        DataError
            If image and path lengths differ in shape, or the air is dark.
        """
        if lengths.shape != view.transmission.shape:
            raise DataError(
                f"view {view.name}: path lengths are for {lengths.shape} rows and columns, "
                f"the image has {view.transmission.shape}"
            )
        usable = view.valid.ravel()[lengths.pixels] & ~lengths.broken
        measured = np.where(usable, view.transmission.ravel()[lengths.pixels], 1.0)
        if gain_bounds is None:
            air = _air(view, _beside(lengths, settings.air_margin_px) & view.valid, settings)
        else:
            air = Air(0, gain_bounds[0], NOISE_WITHOUT_AIR)
        if not air.mean > 0:
            raise DataError(
                f"view {view.name}: the air beside the object must be bright, "
                f"its mean transmission is {air.mean:.3g}"
            )
        guessed = air.sd * READOUT_SHARE**0.5
        dark = max(guessed if dark_sd is None else dark_sd, NOISE_FLOOR)
        values = measured.astype(np.float64)
        ways = kernels.ways_of(lengths.lengths_cm)
        return cls(view.name, lengths, ways, values, usable, air, dark, gain_bounds)

    @property
    def parts(self) -> int:
        """Number of parts K."""
        return int(self.lengths.lengths_cm.shape[2])

    def noise_variance(self, transmission: Float64[np.ndarray, "*n"]) -> Float64[np.ndarray, "*n"]:
        """Variance of a pixel's noise: readout, and quanta in proportion to the transmission."""
        quanta = max(self.air.sd**2 - self.dark_sd**2, 0.0)
        return np.asarray(self.dark_sd**2 + quanta * np.clip(transmission, 0.0, 1.0))


def _beside(lengths: PathLengths, margin_px: int) -> Mask:
    """Where no part is near."""
    hit = np.zeros(lengths.shape, dtype=bool)
    hit.flat[lengths.pixels] = True
    if margin_px and len(lengths.pixels):
        box = Crop.around(lengths.pixels, lengths.shape, margin_px).box
        hit[box] = binary_dilation(hit[box], np.ones((3, 3), dtype=bool), margin_px)
    return ~hit


def _air(view: XRayView, chosen: Mask, settings: FitSettings) -> Air:
    """Air without what is too far off its median to be air."""
    transmission, mine = view.transmission.ravel(), chosen.ravel()
    centre, reach = 1.0, np.inf
    if np.isfinite(settings.air_clip_sd):
        centre, robust_sd = _middle(transmission, mine)
        reach = settings.air_clip_sd * max(robust_sd, NOISE_FLOOR)
    count, total, squares = kernels.air_sums(transmission, mine, centre, reach)
    if not count:
        return Air(0, 1.0, NOISE_WITHOUT_AIR)
    off = total / count
    return Air(count, centre + off, float(np.sqrt(max(squares / count - off**2, 0.0))))


def _middle(
    transmission: Float32[np.ndarray, "pixels"], chosen: Bool[np.ndarray, "pixels"]
) -> tuple[float, float]:
    """Median and robust standard deviation of the chosen pixels, of a regular sample if many."""
    every = max(int(chosen.sum()) // MEDIAN_SAMPLE, 1)
    values = transmission[np.flatnonzero(chosen)[::every]].astype(np.float64)
    if not len(values):
        return 1.0, 0.0
    median = float(np.median(values))
    return median, 1.4826 * float(np.median(np.abs(values - median)))
