"""The model of a whole radiograph, from a fit or from what a dataset keeps of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float64

from xden1k.errors import DataError
from xden1k.rays import PathLengths, path_lengths
from xden1k.values.arrays import Image, Mask
from xden1k.values.materials import load_materials
from xden1k.values.types import DensityObject
from xden1k.values.views import ViewGeometry, XRayView
from xden_builder.capture import Capture
from xden_builder.poly import kernels
from xden_builder.poly.beam import EnergyGroups, ViewBeam, energy_groups, view_beam
from xden_builder.poly.pose import coarse
from xden_builder.poly.stray import coarse_binning, stray_light

__all__ = ["TERMS", "model_image", "replayed", "transmissions", "transmissions_and_slopes"]

TERMS = ("gain", "near_scatter", "far_scatter", "glare")
"""What a view has of its own, in the order of the unknowns."""


def transmissions(
    lengths: PathLengths,
    beam: ViewBeam,
    mac_cm2_g: Float64[np.ndarray, "k groups"],
    density_g_cm3: Float64[np.ndarray, "k"],
    binning: int = 1,
) -> Float64[np.ndarray, "n"]:
    """Transmission of the direct beam in every pixel of some path lengths, shape (n,).

    Parameters
    ----------
    lengths
        Of a view, or of blocks of its pixels.
    beam
        Of the panel.
    mac_cm2_g, density_g_cm3
        Of the parts.
    binning
        Pixels along each side of a block.
    """
    none = np.empty((0, len(density_g_cm3)))
    return _predicted(lengths, beam, mac_cm2_g, density_g_cm3, binning, none)


def transmissions_and_slopes(
    lengths: PathLengths,
    beam: ViewBeam,
    mac_cm2_g: Float64[np.ndarray, "k groups"],
    density_g_cm3: Float64[np.ndarray, "k"],
    binning: int = 1,
) -> tuple[Float64[np.ndarray, "n"], Float64[np.ndarray, "n k"]]:
    """Give the same, and its derivatives by the densities, shape (n, K)."""
    slopes = np.empty((len(lengths.pixels), len(density_g_cm3)))
    return _predicted(lengths, beam, mac_cm2_g, density_g_cm3, binning, slopes), slopes


def _predicted(
    lengths: PathLengths,
    beam: ViewBeam,
    mac_cm2_g: Float64[np.ndarray, "k groups"],
    density_g_cm3: Float64[np.ndarray, "k"],
    binning: int,
    slopes: Float64[np.ndarray, "m k"],
) -> Float64[np.ndarray, "n"]:
    """Run the kernel, which writes the slopes if there is room for any."""
    count, rays, _ = lengths.lengths_cm.shape
    transmission = np.empty(count)
    kernels.predict(
        lengths.lengths_cm,
        np.full(count, rays),
        mac_cm2_g,
        density_g_cm3,
        beam.weights(lengths.pixels, binning),
        transmission,
        slopes,
    )
    return transmission


def model_image(
    view: XRayView,
    beam: ViewBeam,
    lengths: PathLengths,
    smooth: PathLengths,
    mac_cm2_g: Float64[np.ndarray, "k groups"],
    scattering_cm2_g: Float64[np.ndarray, "k groups"],
    density_g_cm3: Float64[np.ndarray, "k"],
    nuisances: Float64[np.ndarray, "4"],
) -> Image:
    """Compute direct beam and stray light of a view, with the gain, shape (rows, columns).

    Parameters
    ----------
    view, beam
        The radiograph, which glare is made of, and what reaches its panel.
    lengths, smooth
        Of its pixels, and of the coarse panel.
    mac_cm2_g, scattering_cm2_g, density_g_cm3
        Of the parts.
    nuisances
        By :data:`TERMS`.
    """
    every = np.arange(view.transmission.size)
    known = np.where(view.valid, view.transmission, 1.0).ravel().astype(np.float64)
    stray = stray_light(
        view, beam, smooth, mac_cm2_g, scattering_cm2_g, density_g_cm3, every, known
    )
    light = stray @ nuisances[1:] + 1.0
    direct = transmissions(lengths, beam, mac_cm2_g, density_g_cm3)
    light[lengths.pixels] += direct - 1.0
    image = nuisances[0] * light.reshape(view.transmission.shape)
    return np.asarray(image, dtype=np.float32)


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
        One of its radiographs.
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
    groups = energy_groups(capture.tube, capture.detector.scintillator)
    known = np.array([[values[term] for term in TERMS] for values in fit["views"].values()])
    names = list(fit["views"])
    fitted = view.name in names
    nuisances = known[names.index(view.name)] if fitted else [1.0, *known.mean(axis=0)[1:]]
    stand_ins = [fit["stand_ins"][part.name] for part in obj.parts]
    smooth = path_lengths(
        [part.mesh for part in obj.parts],
        range(len(obj.parts)),
        coarse(geometry, coarse_binning(geometry.shape)),
    )
    image = model_image(
        view,
        view_beam(capture, view, groups),
        lengths,
        smooth,
        _coefficients(stand_ins, groups, scattering=False),
        _coefficients(stand_ins, groups, scattering=True),
        np.array([part.density_g_cm3 for part in obj.parts]),
        np.array(nuisances),
    )
    if fitted or not beside.any():
        return image, float(nuisances[0])
    gain = float(np.median(view.transmission[beside]) / np.median(image[beside]))
    return np.asarray(gain * image), gain


def _coefficients(
    stand_ins: Sequence[Mapping[str, float]], groups: EnergyGroups, *, scattering: bool
) -> Float64[np.ndarray, "k groups"]:
    """Mix the coefficients of each part's materials."""
    of = groups.scattering_cm2_g if scattering else groups.mac_cm2_g
    library = load_materials()
    return np.stack(
        [
            np.sum([share * of(library[name].composition) for name, share in each.items()], axis=0)
            for each in stand_ins
        ]
    )
