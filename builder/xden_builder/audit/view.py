"""How well a model image explains a radiograph: in transmission T, and in attenuation p = -ln T."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Float64

from xden1k.rays import PathLengths
from xden1k.values.arrays import Image, Mask
from xden1k.values.views import XRayView
from xden_builder.audit.air import border_air, corner_ratio, falls_off, uneven_air
from xden_builder.audit.sharpness import Blur, blur_of
from xden_builder.audit.unexplained import Unexplained, unexplained
from xden_builder.capture import Capture

__all__ = [
    "GOOD_CORRELATION",
    "ViewAudit",
    "audit_image",
    "audit_view",
    "noise_floor",
    "pixel_sets",
]

GOOD_CORRELATION = 0.9
"""Below this correlation of transmission on the object a view does not show these parts."""
FLOOR_SIGMAS = 3
"""Standard deviations of the dark image by which a transmission is told from none."""
SMALLEST_TRANSMISSION = 1 / 65535
"""One count of a 16-bit detector: the floor of T in -ln T where no dark image tells the noise."""


@dataclass(frozen=True, slots=True)
class ViewAudit:
    """Reprojection error of one view.

    Errors on the object are over valid pixels whose ray meets a part, those of the background
    over all others, where a saturated pixel errs by what the model is darker than it can be. A
    correlation is Pearson's; nan where either image is constant.

    Parameters
    ----------
    name
        The view's.
    fitted
        False for an audit view, which the fit has not seen.
    gain
        Open-field factor of the model: the fit's, or for an audit view the median transmission
        of the background over that of the model there, 1 if it has none.
    transmission_mae, transmission_corr
        On the object, in T.
    attenuation_mae, attenuation_corr
        On the object, in -ln T with T no smaller than the view's noise floor.
    background_transmission_mae, background_attenuation_mae
        Beside the object.
    object_pixels
        Number of pixels compared on the object.
    unexplained
        Content and shadow that no part accounts for.
    blur
        How much softer edges are than those of the meshes.
    uneven_air
        Whether air is brighter at one border than at the opposite one, by more than a tenth, or
        other in all corners than at the middles of borders, by :func:`.air.falls_off`.
    """

    name: str
    fitted: bool
    gain: float
    transmission_mae: float
    transmission_corr: float
    attenuation_mae: float
    attenuation_corr: float
    background_transmission_mae: float
    background_attenuation_mae: float
    object_pixels: int
    unexplained: Unexplained
    blur: Blur
    uneven_air: bool

    @property
    def verdict(self) -> Literal["good", "bad", "not seen"]:
        """Whether the parts are where the image shows them."""
        if not self.object_pixels:
            return "not seen"
        # what hardly varies, or is a pixel wide, correlates badly even where it is right
        explained = not (self.unexplained.content or self.unexplained.shadow)
        return "good" if explained or self.transmission_corr >= GOOD_CORRELATION else "bad"

    @property
    def good(self) -> bool:
        """Whether the parts are where the image shows them."""
        return self.verdict == "good"


def audit_view(
    view: XRayView,
    lengths: PathLengths,
    lac_per_cm: Float[np.ndarray, "parts"],
    *,
    gain: float | None,
    floor: float,
    saturated: Mask | None = None,
) -> ViewAudit:
    """Compare one radiograph with the model of one attenuation coefficient for each part.

    Parameters
    ----------
    view
        The measured image; a saturated pixel has the least transmission it can have.
    lengths
        Path lengths of the parts in this view.
    lac_per_cm
        Shape (parts,): the attenuation to check.
    gain
        Open-field factor; None for an audit view, which takes it from its background.
    floor
        Smallest transmission that is told from none: three times the noise of the dark image.
    saturated
        Shape (rows, columns): those pixels, if any.
    """
    fitted = gain is not None
    if gain is None:
        gain = _background_gain(view, lengths)
    model = lengths.image(lac_per_cm, gain)
    return audit_image(
        view, lengths, model, gain=gain, floor=floor, fitted=fitted, saturated=saturated
    )


def audit_image(
    view: XRayView,
    lengths: PathLengths,
    model: Image,
    *,
    gain: float,
    floor: float,
    fitted: bool = True,
    saturated: Mask | None = None,
) -> ViewAudit:
    """Compare one radiograph with a model image of it.

    Parameters
    ----------
    view
        As of :func:`audit_view`.
    lengths
        Path lengths of the parts in this view.
    model
        Shape (rows, columns): transmission.
    gain
        Open-field factor of the model.
    floor, saturated
        As of :func:`audit_view`.
    fitted
        Whether the model was fitted to this view.
    """
    on_object, background = pixel_sets(view, lengths)
    told = on_object
    if saturated is not None:
        view, told = _at_least(view, model, saturated), on_object & ~saturated
    inside = _errors(view.transmission[told], model[told], floor)
    beside = _pair(view.transmission[background], model[background])
    return ViewAudit(
        name=view.name,
        fitted=fitted,
        gain=gain,
        transmission_mae=inside[0],
        transmission_corr=inside[1],
        attenuation_mae=inside[2],
        attenuation_corr=inside[3],
        background_transmission_mae=_mae(beside),
        background_attenuation_mae=_mae(_attenuation(beside, floor)),
        object_pixels=int(told.sum()),
        unexplained=unexplained(view, on_object, background, model, gain, floor / FLOOR_SIGMAS),
        blur=blur_of(view.transmission, view.valid, told, model, gain),
        uneven_air=_is_uneven(view.transmission, background),
    )


def _is_uneven(transmission: Image, background: Mask) -> bool:
    """Whether air beside the object is brighter somewhere, as no open field leaves it."""
    seen = transmission, ~background, background
    return any(uneven_air(border_air(*seen))) or falls_off(corner_ratio(*seen))


def pixel_sets(
    view: XRayView, lengths: PathLengths
) -> tuple[Bool[np.ndarray, "rows columns"], Bool[np.ndarray, "rows columns"]]:
    """Split the valid pixels into those on the object and those beside it."""
    hit = np.zeros(view.transmission.shape, dtype=bool)
    hit.flat[lengths.pixels] = True
    broken = np.zeros_like(hit)
    broken.flat[lengths.pixels[lengths.broken]] = True
    return hit & view.valid & ~broken, ~hit & view.valid


def _at_least(view: XRayView, model: Image, saturated: Mask) -> XRayView:
    """Take saturated pixels for as bright as the model, where that is bright enough."""
    brighter = np.maximum(view.transmission, model)
    return replace(view, transmission=np.where(saturated, brighter, view.transmission))


def _background_gain(view: XRayView, lengths: PathLengths) -> float:
    """Median transmission beside the object; 1 where there is nothing beside it."""
    _, background = pixel_sets(view, lengths)
    return float(np.median(view.transmission[background])) if background.any() else 1.0


def _errors(
    measured: Float[np.ndarray, "n"], model: Float[np.ndarray, "n"], floor: float
) -> tuple[float, float, float, float]:
    """MAE and correlation in transmission, MAE and correlation in attenuation."""
    if not measured.size:
        return (np.nan,) * 4
    pair = _pair(measured, model)
    attenuation = _attenuation(pair, floor)
    return (_mae(pair), _correlation(pair), _mae(attenuation), _correlation(attenuation))


def _pair(
    measured: Float[np.ndarray, "n"], model: Float[np.ndarray, "n"]
) -> Float64[np.ndarray, "2 n"]:
    return np.stack([measured, model]).astype(np.float64)


def _attenuation(pair: Float64[np.ndarray, "2 n"], floor: float) -> Float64[np.ndarray, "2 n"]:
    return np.asarray(-np.log(np.maximum(pair, floor)))


def _mae(pair: Float[np.ndarray, "2 n"]) -> float:
    return float(np.abs(pair[0] - pair[1]).mean()) if pair.size else np.nan


def _correlation(pair: Float[np.ndarray, "2 n"]) -> float:
    if (np.ptp(pair, axis=1) < 1e-6).any():  # constant but for rounding to single precision
        return np.nan
    return float(np.corrcoef(pair)[0, 1])


def noise_floor(capture: Capture, view: str) -> float:
    """Smallest transmission that is told from none: three times the noise of the dark image."""
    return max(FLOOR_SIGMAS * capture.noise_sd.get(view, 0.0), SMALLEST_TRANSMISSION)
