"""The model of a radiograph again, from what a dataset keeps of the polychromatic fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from jaxtyping import Float64

from xden1k.errors import DataError
from xden1k.rays import PathLengths, path_lengths
from xden1k.rays.reprojection import SUBRAYS, reprojected
from xden1k.values.arrays import Image, Mask
from xden1k.values.types import DensityObject
from xden1k.values.views import ViewGeometry, XRayView
from xden_builder.capture import Capture
from xden_builder.physics.groups import energy_groups
from xden_builder.physics.source import Detector, Tube
from xden_builder.poly.materials.stand_ins import coefficients
from xden_builder.poly.model.beam import Heel, ViewBeam, view_beam
from xden_builder.poly.model.frames import coarse
from xden_builder.poly.model.radiograph import TERMS, WIDTH_TERMS, model_image
from xden_builder.poly.model.stray import coarse_binning, middle_of, scatter_reaches_cm

__all__ = ["expected_light", "replayed", "stored_model"]

WIDTHS_BEFORE_CM: Final = (2.0, 6.0)
"""Of near and far scatter, where a dataset does not tell them."""


def replayed(
    obj: DensityObject,
    capture: Capture,
    view: XRayView,
    geometry: ViewGeometry,
    lengths: PathLengths,
    beside: Mask,
) -> tuple[Image, float]:
    """Compute the image of a view from what a dataset keeps of a fit, and its gain.

    A view that was not fitted has the mean stray light of those that were, and the gain that makes
    its median right beside the object.

    Parameters
    ----------
    obj
        Rebuilt by the polychromatic fit.
    capture
        What it was made from.
    view
        One of its radiographs; a saturated pixel has the least transmission it can have.
    geometry
        Of the view, in the frame of the meshes.
    lengths
        Of the object's parts in that geometry.
    beside
        Shape (rows, columns): valid pixels beside the object.

    Raises
    ------
    DataError
        If the capture no longer says what tube it was taken with.
    """
    if capture.tube is None:
        raise DataError(
            f"{obj.object_id}: expected the tube it was rebuilt with, scanner.toml names none"
        )
    fit: Mapping[str, Any] = obj.meta["poly"]
    groups = energy_groups(_filtered(capture.tube, obj), capture.detector)
    known = np.array([_known(values) for values in fit["views"].values()])
    names = list(fit["views"])
    fitted = view.name in names
    mine = known[names.index(view.name)] if fitted else expected_light(obj, known, names, geometry)
    beam = view_beam(capture, view, groups)
    image = _image(obj, view, geometry, beam, lengths, np.array(mine))
    if fitted or not beside.any():
        return image, float(mine[0])
    gain = float(np.median(view.transmission[beside]) / np.median(image[beside]))
    return np.asarray(gain * image), gain


def stored_model(obj: DensityObject, view: XRayView, subrays: int = SUBRAYS) -> Image:
    """Compute the image of a fitted view from a dataset alone: by the fit's spectrum if it has one.

    Without the capture the side of the tube's cathode is not known: the beam is taken as equally
    hard everywhere.

    Parameters
    ----------
    obj
        From the dataset.
    view
        One of its own, or one of them with several pixels read as one.
    subrays
        Rays along each side of a pixel.

    Returns
    -------
    Image
        Transmission, shape (rows, columns); not a number where a part has no attenuation.
    """
    if "poly" not in obj.meta:
        return reprojected(obj, view, subrays).transmission
    tube, detector = Tube(**obj.meta["tube"]), Detector(**obj.meta.get("detector", {}))
    beam = ViewBeam(energy_groups(_filtered(tube, obj), detector), view.geometry, Heel())
    meshes = [part.mesh for part in obj.parts]
    lengths = path_lengths(meshes, range(len(meshes)), view.geometry, subrays)
    known = np.array(_known(obj.meta["poly"]["views"][view.name]))
    return _image(obj, view, view.geometry, beam, lengths, known)


def expected_light(
    obj: DensityObject,
    known: Float64[np.ndarray, "v 6"],
    names: Sequence[str],
    geometry: ViewGeometry,
) -> Float64[np.ndarray, "6"]:
    """Return gain, stray light and widths of scatter that a view is expected to have.

    Scatter is as much wider than assumed as that of the views that were fitted.

    Parameters
    ----------
    obj
        Rebuilt by the polychromatic fit.
    known, names
        The same of the views that were fitted, and their names.
    geometry
        Of the view, in the frame of the meshes.
    """
    middle_cm = middle_of([part.mesh for part in obj.parts])
    wider = [
        known[names.index(view.name), len(TERMS) :] / scatter_reaches_cm(view.geometry, middle_cm)
        for view in obj.views
        if view.name in names
    ]
    widths_cm = np.mean(wider, axis=0) * scatter_reaches_cm(geometry, middle_cm)
    return np.array([1.0, *known.mean(axis=0)[1 : len(TERMS)], *widths_cm])


def _known(values: Mapping[str, float]) -> list[float]:
    """Return gain and stray light of a fitted view, and how wide its scatter is.

    Builders before widths were sought had those of :data:`WIDTHS_BEFORE_CM`, and did not say so.
    """
    widths = zip(WIDTH_TERMS, WIDTHS_BEFORE_CM, strict=True)
    return [*(values[term] for term in TERMS), *(values.get(*each) for each in widths)]


def _image(
    obj: DensityObject,
    view: XRayView,
    geometry: ViewGeometry,
    beam: ViewBeam,
    lengths: PathLengths,
    known: Float64[np.ndarray, "6"],
) -> Image:
    """Compute a radiograph of the stored parts by the materials that stand in for them."""
    stand_ins = [obj.meta["poly"]["stand_ins"][part.name] for part in obj.parts]
    smooth = path_lengths(
        [part.mesh for part in obj.parts],
        range(len(obj.parts)),
        coarse(geometry, coarse_binning(geometry.shape)),
    )
    return model_image(
        view,
        beam,
        lengths,
        smooth,
        coefficients(stand_ins, beam.groups, scattering=False),
        coefficients(stand_ins, beam.groups, scattering=True),
        _seen_density_g_cm3(obj),
        known[: len(TERMS)],
        known[len(TERMS) :].tolist(),
    )


def _filtered(tube: Tube, obj: DensityObject) -> Tube:
    """Return the tube with the filter that the object was rebuilt with."""
    return tube.behind("Cu", obj.meta["settings"]["poly"]["extra_filter_mm_cu"] / 10)


def _seen_density_g_cm3(obj: DensityObject) -> Float64[np.ndarray, "k"]:
    """Density of each part that the images see, were its coefficients the library's."""
    factors = obj.meta["poly"]["composition"]
    return np.array([part.density_g_cm3 * factors[part.name] for part in obj.parts])
