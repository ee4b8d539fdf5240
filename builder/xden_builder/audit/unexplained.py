"""What a radiograph shows and the parts do not: content inside their outline, shadow beside it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float64
from scipy.ndimage import (
    binary_dilation,
    binary_opening,
    find_objects,
    label,
    maximum_filter,
    minimum_filter,
    uniform_filter,
)

from xden1k.values.arrays import Image, Mask
from xden1k.values.views import ViewGeometry, XRayView
from xden_builder.fit.crops import Crop

__all__ = ["MOST_CONTENT", "MOST_SHADOW", "Unexplained", "unexplained"]

MOST_CONTENT: Final = 0.05
"""Share of an object's pixels that sound objects stay below: 39 of 40 simulated ones, whose labels
and meshes err as usual; of 68 that lack one of their two largest parts, 60 exceed this or the
other."""
MOST_DARKENING: Final = 0.05
"""The same of the object's attenuation, in places as wide as the window: a lead weight in a wooden
block is a twentieth of its pixels and half of what these attenuate. Of 1000 simulated objects two
have content at all, a hundredth of their pixels."""
MOST_SHADOW: Final = 0.02
"""Largest shadow beside the parts, as a share of the object's pixels."""
WINDOW_PX: Final = 5
"""Side of the square over which residuals are averaged on the object."""
FEW_PX: Final = 3
"""The same beside it, where a shadow is fainter the less it is averaged."""
SIGMAS: Final = 3.0
"""A mean residual of more standard deviations is not explained on the object."""
BESIDE_SIGMAS: Final = 5.0
"""The same beside it."""
FAINTEST_SHADOW: Final = 0.02
"""Of the open field: scatter is modelled no better than that."""
EDGE_ERROR_CM: Final = 0.03
"""How far the image of a surface may be off, on the panel; at most a pixel."""
MARGIN_CM: Final = 0.1
"""Beside the outline, on the panel: there a shadow may be the object's own."""
MARGIN_PX: Final = (2, 5)
"""The same, at least and at most."""
MODEL_SHARE: Final = 0.03
"""Error of -ln T that composition, spectrum and scale leave, as a share of it."""
FLOOR: Final = 0.004
"""Error of T that is left anywhere."""
WATER_CM2_G: Final = 0.19
"""MAC of water in the middle of a 100 kV beam, at 70 keV (NIST, doi:10.18434/T4D01F)."""
DARKEST: Final = 1e-4

Box = tuple[int, int, int, int]
Values = Float64[np.ndarray, "rows columns"]


@dataclass(frozen=True, slots=True)
class Unexplained:
    """What the parts do not explain in one view.

    Parameters
    ----------
    content_share
        Of the object's pixels, those whose mean residual is beyond the model's error.
    content_darkening
        Attenuation of those, where they are as wide as the square of the mean, beyond what the
        model has there; as a share of that of all the object's pixels by the model. Negative where
        they are brighter.
    content_box
        Rows and columns that the largest connected area of them spans: first row, first column,
        last row, last column. None where there is none.
    content_g
        Mass of water that would darken those pixels as much; negative where they are brighter than
        the model. Of the same effect at 70 keV (NIST, coefficients over water's 0.19 cm²/g)
        aluminium weighs four fifths, steel a quarter, copper and zinc a sixth, lead a twentieth.
    shadow_share
        The largest connected shadow beside the parts, as a share of the object's pixels.
    shadow_box, shadow_g
        Of that shadow, likewise.
    """

    content_share: float
    content_darkening: float
    content_box: Box | None
    content_g: float
    shadow_share: float
    shadow_box: Box | None
    shadow_g: float

    @property
    def content(self) -> bool:
        """Whether more of the object is unexplained than of sound ones."""
        strong = abs(self.content_darkening) > MOST_DARKENING
        return strong or self.content_share > MOST_CONTENT

    @property
    def shadow(self) -> bool:
        """Whether a shadow lies outside of all parts."""
        return self.shadow_share > MOST_SHADOW


def unexplained(
    view: XRayView, on_object: Mask, background: Mask, model: Image, gain: float, noise_sd: float
) -> Unexplained:
    """Look for what a model image of the parts leaves out.

    On the object: squares whose mean residual exceeds three standard deviations of the model,
    which are taken as alike over a square, for such errors are. Beside it: connected pixels that
    are darker than the model by more than five times the spread of those beside it.

    Parameters
    ----------
    view
        The radiograph.
    on_object, background
        Shape (rows, columns): as of :func:`xden_builder.audit.view.pixel_sets`.
    model
        Shape (rows, columns): transmission.
    gain
        Open-field factor of the model.
    noise_sd
        Of the transmission behind something opaque.
    """
    pixel_cm = float(np.linalg.norm(view.geometry.column_step_cm))
    residual = np.where(view.valid, view.transmission - model, 0.0).astype(np.float64)
    around, content = _around(on_object, WINDOW_PX), np.zeros_like(on_object)
    sd = _model_sd(model[around], gain, pixel_cm, noise_sd)
    content[around] = _content(residual[around], on_object[around], sd)
    shadow = _shadow(residual, on_object, background, pixel_cm)
    size = max(int(on_object.sum()), 1)
    largest_shadow, shadow_box = _largest(shadow)
    _, content_box = _largest(content)
    area_cm2 = _area_cm2(view.geometry)
    wide = binary_opening(content, np.ones((WINDOW_PX, WINDOW_PX))) if content.any() else content
    attenuated = float(np.log(gain / model[on_object].clip(min=DARKEST)).sum())
    return Unexplained(
        content_share=float(content.sum()) / size,
        content_darkening=_darkening(view, model, wide, FAINTEST_SHADOW) / max(attenuated, DARKEST),
        content_box=content_box,
        content_g=area_cm2 * _darkening(view, model, content) / WATER_CM2_G,
        shadow_share=float(largest_shadow.sum()) / size,
        shadow_box=shadow_box,
        shadow_g=area_cm2 * _darkening(view, model, largest_shadow) / WATER_CM2_G,
    )


def _around(mask: Mask, margin_px: int) -> tuple[slice, slice]:
    """Rows and columns of the marked pixels, with so many on either side; none where none is."""
    if not mask.any():
        return slice(0), slice(0)
    return Crop.around(np.flatnonzero(mask), mask.shape, margin_px).box


def _darkening(view: XRayView, model: Image, mask: Mask, least: float = DARKEST) -> float:
    """Sum of -ln of measured over model transmission, 0 where nothing was measured.

    What is darker than the least transmission counts as that: stray light is as bright.
    """
    told = mask & view.valid
    pair = np.stack([model[told], view.transmission[told]]).clip(min=least).astype(np.float64)
    return float(np.log(pair[0] / pair[1]).sum())


def _model_sd(model: Image, gain: float, pixel_cm: float, noise_sd: float) -> Values:
    """Estimate how far the model may be off at each pixel: edges, attenuation, floor and noise."""
    share = (model / gain).clip(DARKEST, 1.0).astype(np.float64)
    steps = maximum_filter(model, 3) - minimum_filter(model, 3)
    edge = min(EDGE_ERROR_CM / pixel_cm, 1.0) * steps
    attenuation = MODEL_SHARE * model * -np.log(share)
    return np.asarray(np.sqrt(edge**2 + attenuation**2 + FLOOR**2 + noise_sd**2))


def _content(residual: Values, on_object: Mask, sd: Values) -> Mask:
    weight = on_object.astype(np.float64)
    far_off = np.abs(uniform_filter(residual * weight, WINDOW_PX)) > SIGMAS * uniform_filter(
        sd * weight, WINDOW_PX
    )
    return np.asarray(on_object & far_off)


def _shadow(residual: Values, on_object: Mask, background: Mask, pixel_cm: float) -> Mask:
    """Pixels well beside the parts, in squares at least two wide, that are darker than air."""
    margin = int(np.ceil(MARGIN_CM / pixel_cm).clip(*MARGIN_PX))
    around, near_object = _around(on_object, margin), np.zeros_like(on_object)
    near_object[around] = binary_dilation(on_object[around], iterations=margin)
    air = background & ~near_object
    if not air.any():
        return np.zeros_like(on_object)
    level = float(np.median(residual[air]))
    weight = air.astype(np.float64)
    near = uniform_filter(weight, FEW_PX).clip(min=0.2)
    mean = uniform_filter((residual - level) * weight, FEW_PX) / near
    spread = 1.4826 * float(np.median(np.abs(mean[air])))
    darker = air & (mean < -max(BESIDE_SIGMAS * spread, FAINTEST_SHADOW))
    return np.asarray(binary_opening(darker, np.ones((2, 2)))) if darker.any() else darker


def _largest(mask: Mask) -> tuple[Bool[np.ndarray, "rows columns"], Box | None]:
    """Return the largest connected area, and the rows and columns it spans."""
    if not mask.any():
        return mask, None
    areas, _ = label(mask)
    largest = int(np.bincount(areas.ravel())[1:].argmax()) + 1
    rows, columns = find_objects(areas)[largest - 1]
    box = (rows.start, columns.start, rows.stop - 1, columns.stop - 1)
    return np.asarray(areas == largest), box


def _area_cm2(geometry: ViewGeometry) -> float:
    """Area of a pixel at the origin of the object's frame, across the beam."""
    area = float(np.linalg.norm(np.cross(geometry.column_step_cm, geometry.row_step_cm)))
    if geometry.source_cm is None:
        return area
    depth = float((np.linalg.inv(geometry.matrix) @ -geometry.source_cm)[2])
    return area * depth**2
