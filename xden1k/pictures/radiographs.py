"""A radiograph against what the stored parts would give: the images, cut to the object."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from xden1k.errors import require
from xden1k.values.arrays import Image
from xden1k.values.types import DensityObject
from xden1k.values.views import XRayView

__all__ = ["MADE_WORDS", "Comparison", "Window", "compare", "object_window", "reprojection"]

SUBRAYS = 3
MADE_WORDS = {"scan": "measured", "phantom": "simulated", "ct": "computed"}
"""How the radiographs of each source came to be."""
Window = tuple[slice, slice]


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
    window = object_window(obj, view)
    measured = np.where(view.valid, view.transmission, np.float32(np.nan))[window]
    model = reprojection(obj, view)[window]
    on_object = model < _gain(obj, view)
    mean, limit = _mean_and_limit(np.abs((measured - model)[on_object]))
    return Comparison(measured, model, mean, limit, _aspect(view))


def reprojection(obj: DensityObject, view: XRayView) -> Image:
    """Transmission that the stored parts give in a view, 3 x 3 rays a pixel.

    The gain is that of ``meta["fit"]["gain"]``, 1 if there is none. Where a ray meets a part of
    unknown attenuation, the pixel is not a number.

    Raises
    ------
    MissingExtraError
        If the projector's libraries (extra ``build``) are not installed.
    """
    require("numba", "build")
    require("manifold3d", "build")
    from xden1k.rays import path_lengths

    meshes = [part.mesh for part in obj.parts]
    lac = np.array([part.lac_per_cm for part in obj.parts])
    lengths = path_lengths(meshes, range(len(meshes)), view.geometry, SUBRAYS)
    image = lengths.image(np.nan_to_num(lac), _gain(obj, view))
    unknown = lengths.lengths_cm[:, :, np.isnan(lac)].any(axis=(1, 2))
    image.flat[lengths.pixels[unknown]] = np.nan
    return image


def object_window(obj: DensityObject, view: XRayView) -> Window:
    """Rows and columns of the object and a margin: square, but for the image's edges."""
    points = np.concatenate([part.mesh.vertices for part in obj.parts])
    columns, rows, _ = view.geometry.project(points).T
    side = int(np.ceil(1.2 * max(np.ptp(rows), np.ptp(columns)))) + 1
    return _span(rows, side, view.geometry.shape[0]), _span(columns, side, view.geometry.shape[1])


def _span(positions: Float[np.ndarray, "n"], side: int, size: int) -> slice:
    first = round((positions.min() + positions.max() - side) / 2)
    return slice(max(0, first), min(size, first + side))


def _gain(obj: DensityObject, view: XRayView) -> float:
    return float(obj.meta.get("fit", {}).get("gain", {}).get(view.name, 1.0))


def _mean_and_limit(sizes: Float[np.ndarray, "n"]) -> tuple[float, float]:
    known = sizes[np.isfinite(sizes)]
    if not len(known):
        return np.nan, 1e-3
    return float(known.mean()), float(f"{max(np.quantile(known, 0.99), 1e-3):.1g}")


def _aspect(view: XRayView) -> float:
    place = view.geometry
    return float(np.linalg.norm(place.row_step_cm) / np.linalg.norm(place.column_step_cm))
