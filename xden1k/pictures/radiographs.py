"""A radiograph against what the stored parts would give: the images, cut to the object."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from xden1k.errors import require
from xden1k.values.arrays import Image
from xden1k.values.types import DensityObject
from xden1k.values.views import XRayView
from xden1k.values.windows import object_window, pixel_aspect

__all__ = ["MADE_WORDS", "Comparison", "compare"]

MADE_WORDS = {
    "scan": "measured",
    "phantom": "simulated",
    "ct": "computed",
    "published": "measured",
}
"""How the radiographs of each source came to be, where there are any."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """One view as it is and as reprojected, cut to the object and a margin.

    Parameters
    ----------
    measured, model
        Shape (rows, columns): transmission; not a number where there is no value.
    mean_abs_residual
        Mean of the size of the residual over the pixels with material; nan without any.
    limit
        End of a colour scale for the residual: its 99th percentile there, to one digit.
    aspect
        Height of a pixel over its width.
    """

    measured: Image
    model: Image
    mean_abs_residual: float
    limit: float
    aspect: float

    @property
    def residual(self) -> Image:
        """Measured less model."""
        return np.asarray(self.measured - self.model)


def compare(obj: DensityObject, view: XRayView) -> Comparison:
    """Compare a view with the reprojection of the object's stored parts.

    Raises
    ------
    MissingExtraError
        If the projector's libraries (extra ``build``) are not installed.
    """
    require("numba", "build")
    from xden1k.rays.reprojection import gain_of, reprojected

    window = object_window(obj, view)
    measured = np.where(view.valid, view.transmission, np.float32(np.nan))[window]
    model = reprojected(obj, view).transmission[window]
    on_object = model < gain_of(obj, view.name)
    mean, limit = _mean_and_limit(np.abs((measured - model)[on_object]))
    return Comparison(measured, model, mean, limit, pixel_aspect(view))


def _mean_and_limit(sizes: Float[np.ndarray, "n"]) -> tuple[float, float]:
    known = sizes[np.isfinite(sizes)]
    if not len(known):
        return np.nan, 1e-3
    return float(known.mean()), float(f"{max(np.quantile(known, 0.99), 1e-3):.1g}")
