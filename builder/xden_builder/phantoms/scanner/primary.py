"""The direct beam behind an object: attenuated ray by ray in each energy group, then blurred.

Rays are many times finer than pixels, so that blur by less than a pixel is right too: a pixel is a
weighted mean over the rays of its own area and its neighbours'.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import trimesh
from jaxtyping import Float, Float32, Int64
from scipy.special import ndtr

from xden1k.rays import PathLengths, path_lengths
from xden1k.values.arrays import Image
from xden1k.values.views import ViewGeometry
from xden_builder.phantoms.scanner.beam import Beam

__all__ = ["Absorber", "Primary", "pixel_kernel", "render"]

LENGTHS_AT_ONCE = 1 << 26
"""Path lengths kept at a time, 4 bytes each."""


@dataclass(frozen=True, slots=True, eq=False)
class Absorber:
    """The parts of an object, as a beam meets them.

    Parameters
    ----------
    meshes
        Disjoint.
    lac_per_cm, scattering_per_cm
        Shape (parts, groups): attenuation, and the share of it that is scattering.
    """

    meshes: Sequence[trimesh.Trimesh]
    lac_per_cm: Float32[np.ndarray, "parts groups"]
    scattering_per_cm: Float32[np.ndarray, "parts groups"]


@dataclass(frozen=True, slots=True, eq=False)
class Primary:
    """The direct beam of one view, each pixel in shares of its own open field.

    Parameters
    ----------
    transmission
        Shape (rows, columns).
    scattered
        Signal that is scattered on its way and is not attenuated otherwise: T times the optical
        depth of scattering. It never exceeds 1 - T.
    mean_kev
        Mean energy of the transmitted signal.
    """

    transmission: Image
    scattered: Image
    mean_kev: Image


def pixel_kernel(
    subrays: int, pixel_cm: float, box_cm: float, gauss_cm: float
) -> Float[np.ndarray, "pixels subrays"]:
    """Weights of the rays along one axis in the signal of the middle pixel.

    The share of each ray's light that lands in the pixel, once spread evenly over the image of
    the focal spot and then by a Gaussian. They add up to 1 over all rays, and to 1 over all pixels
    for each ray, divided by the number of rays: light moves but is not lost.

    Parameters
    ----------
    subrays
        Rays in a pixel.
    pixel_cm, box_cm, gauss_cm
        Width of a pixel, width of the even spread, standard deviation of the Gaussian.
    """
    reach = int(np.ceil((box_cm / 2 + 5 * gauss_cm) / pixel_cm)) if box_cm or gauss_cm else 0
    at = (np.arange(-reach * subrays, (reach + 1) * subrays) + 0.5) / subrays - 0.5
    moved = (np.arange(16) / 16 + 1 / 32 - 0.5) * box_cm / pixel_cm
    sd = max(gauss_cm / pixel_cm, 1e-9)
    off = at[:, None] + moved
    landed = (ndtr((off + 0.5) / sd) - ndtr((off - 0.5) / sd)).mean(axis=1)
    weights = landed.reshape(2 * reach + 1, subrays)
    return np.asarray(weights / weights.sum(axis=0) / subrays)


def render(
    absorber: Absorber,
    beam: Beam,
    geometry: ViewGeometry,
    subrays: int,
    kernel: Float[np.ndarray, "pixels subrays"],
) -> Primary:
    """Compute the direct beam of one view.

    Parameters
    ----------
    absorber
        The object, wholly inside the view.
    beam
        Its rows are those of the view.
    geometry
        The view.
    subrays
        Rays along each side of a pixel.
    kernel
        Of :func:`pixel_kernel`, for both axes.
    """
    shape, reach = geometry.shape, len(kernel) // 2
    left, right = _columns(absorber.meshes, geometry, reach)
    partly = np.ones((shape[0] + 2 * reach, subrays, right - left), dtype=np.float32)
    scattered, mean_kev = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    mean_kev[:] = (beam.row_weights @ beam.energies_kev)[:, None]
    for row, columns, lengths in _rows(absorber.meshes, geometry, subrays, right - left):
        weights = beam.row_weights[row].astype(np.float32)
        rays = _rays(lengths, absorber.lac_per_cm) @ weights
        fine = np.ones((subrays, right - left + 2 * reach, subrays), dtype=np.float32)
        fine[:, columns - left + reach] = rays.reshape(-1, subrays, subrays).swapaxes(0, 1)
        partly[row + reach] = _folded(fine @ kernel.T.astype(np.float32), axis=1)
        some = np.ascontiguousarray(lengths[:, :: subrays + 1])  # one ray of each row and column
        groups = _rays(some, absorber.lac_per_cm) * weights
        sources = np.einsum("rb,rb->r", groups, _along(some, absorber.scattering_per_cm))
        scattered[row, columns] = sources.reshape(-1, subrays).mean(axis=1)
        energy, signal = groups @ beam.energies_kev.astype(np.float32), groups.sum(axis=1)
        behind = signal.reshape(-1, subrays).sum(axis=1).clip(min=1e-30)
        mean_kev[row, columns] = energy.reshape(-1, subrays).sum(axis=1) / behind
    transmission = np.ones(shape, dtype=np.float32)
    seen = np.einsum("ric,pi->rcp", partly, kernel.astype(np.float32), optimize=True)
    transmission[:, left:right] = _folded(seen, axis=0)
    return Primary(transmission, scattered, mean_kev)


def _folded(shares: Float32[np.ndarray, "a b pixels"], axis: int) -> Float32[np.ndarray, "c d"]:
    """Sum what each pixel along an axis gives to its neighbours, the ends left out."""
    count = shares.shape[2]
    size = shares.shape[axis] - count + 1
    moved = (np.take(shares[..., p], range(p, p + size), axis=axis) for p in range(count))
    return np.asarray(sum(moved))


def _along(
    lengths_cm: Float32[np.ndarray, "n s parts"], per_cm: Float32[np.ndarray, "parts groups"]
) -> Float32[np.ndarray, "rays groups"]:
    return np.asarray(lengths_cm.reshape(-1, lengths_cm.shape[2]) @ per_cm)


def _rays(
    lengths_cm: Float32[np.ndarray, "n s parts"], lac_per_cm: Float32[np.ndarray, "parts groups"]
) -> Float32[np.ndarray, "rays groups"]:
    """Transmission of each ray in each group."""
    path = _along(lengths_cm, lac_per_cm)
    np.negative(path, out=path)
    return np.asarray(np.exp(path, out=path))


def _columns(
    meshes: Sequence[trimesh.Trimesh], geometry: ViewGeometry, reach: int
) -> tuple[int, int]:
    """First and last column, that one excluded, that an object or its blur reaches."""
    columns = geometry.project(np.concatenate([mesh.vertices for mesh in meshes]))[:, 0]
    low, high = int(np.floor(columns.min())) - reach, int(np.ceil(columns.max())) + reach + 1
    return max(low, 0), min(high, geometry.shape[1])


def _rows(
    meshes: Sequence[trimesh.Trimesh], geometry: ViewGeometry, subrays: int, width: int
) -> Iterator[tuple[int, Int64[np.ndarray, "n"], Float32[np.ndarray, "n s parts"]]]:
    """Yield number, columns and path lengths of each row that meets the object."""
    step = max(LENGTHS_AT_ONCE // (width * subrays**2 * len(meshes)), 1)
    for first in range(0, geometry.shape[0], step):
        lengths = _band(meshes, geometry, subrays, first, step)
        rows, columns = np.divmod(lengths.pixels, geometry.shape[1])
        ends = np.flatnonzero(np.diff(rows, append=-1)) + 1
        for start, end in zip([0, *ends[:-1].tolist()], ends.tolist(), strict=False):
            row = first + int(rows[start])
            yield row, columns[start:end], lengths.lengths_cm[start:end]


def _band(
    meshes: Sequence[trimesh.Trimesh],
    geometry: ViewGeometry,
    subrays: int,
    first: int,
    count: int,
) -> PathLengths:
    """Path lengths of some rows of a view."""
    band = replace(
        geometry,
        pixel00_cm=geometry.pixel00_cm + first * geometry.row_step_cm,
        shape=(min(count, geometry.shape[0] - first), geometry.shape[1]),
    )
    return path_lengths(meshes, range(len(meshes)), band, subrays)
