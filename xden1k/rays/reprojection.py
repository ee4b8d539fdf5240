"""The radiograph that an object's stored parts would give."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from xden1k.errors import DataError, require
from xden1k.rays.lengths import path_lengths
from xden1k.values.types import DensityObject
from xden1k.values.views import XRayView

__all__ = ["SUBRAYS", "gain_of", "reprojected"]

SUBRAYS = 3


def reprojected(obj: DensityObject, view: XRayView | str, subrays: int = SUBRAYS) -> XRayView:
    """Radiograph that an object's stored parts give where a view was taken, without noise.

    Monochromatic (Eq. 1 and 2 of the paper), with the attenuation each part has. The gain is
    that of ``meta["fit"]["gain"]``, 1 if there is none. Where a ray meets a part of unknown
    attenuation the pixel is not a number, and not valid.

    Parameters
    ----------
    obj
        The object.
    view
        Where to look from: a view of any object, or the name of one of its own, ``pa`` or ``lat``.
    subrays
        Rays along each side of a pixel, whose transmissions are averaged.

    Raises
    ------
    DataError
        If the object has no view of that name, every pixel is unknown, or a mesh reaches behind
        the source.
    MissingExtraError
        If the projector's libraries (extra ``build``) are not installed.

    Examples
    --------
    Residual of a radiograph: ``view.transmission - xden1k.reprojected(obj, view).transmission``.
    """
    require("manifold3d", "build")
    if isinstance(view, str):
        view = _own_view(obj, view)
    lac = np.array([part.lac_per_cm for part in obj.parts])
    meshes = [part.mesh for part in obj.parts]
    lengths = path_lengths(meshes, range(len(meshes)), view.geometry, subrays)
    image = lengths.image(np.nan_to_num(lac), gain_of(obj, view.name))
    unknown = lengths.lengths_cm[:, :, np.isnan(lac)].any(axis=(1, 2))
    image.flat[lengths.pixels[unknown]] = np.nan
    return replace(view, transmission=image, valid=np.isfinite(image))


def gain_of(obj: DensityObject, view: str) -> float:
    """Transmission of air in a view, as the fit has it; 1 if there was none."""
    return float(obj.meta.get("fit", {}).get("gain", {}).get(view, 1.0))


def _own_view(obj: DensityObject, name: str) -> XRayView:
    for view in obj.views:
        if view.name == name:
            return view
    names = [view.name for view in obj.views]
    raise DataError(f"{obj.object_id}: no view {name!r}; there are {names}")
