"""What a network is shown of each voxel.

All channels but ``log10_extent`` and ``log10_volume`` are free of scale: they are the same for an
object twice as large. ``log10_lac`` is so too if the material is the same. None depends on the
order of pictures. What is told of the principal axes does not depend on how the object is turned,
but for the direction of an axis along which it is symmetric.

Needs the extra ``build``.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float32
from scipy import ndimage

from xden1k.access.samples import SampleView
from xden1k.errors import DataError
from xden1k.values.arrays import Grid
from xden1k.values.modality import Modality
from xden1k.values.types import FIELD_SIZE
from xden_baselines.geometry import SKIN, near_surface, nearest_filled, voxel_centres_cm
from xden_baselines.views.pictures import Pictures, visible
from xden_baselines.xray import back_projected_lac_per_cm

__all__ = ["ENVELOPE", "VECTORS", "Channels", "channel_names", "channels"]

Channels = Float32[np.ndarray, "channels x y z"]

ENVELOPE = 0
"""The channel that says how much of a voxel is inside."""
_GEOMETRY = (
    "envelope",
    "depth",
    "x",
    "y",
    "z",
    "log10_extent",
    "normal_x",
    "normal_y",
    "normal_z",
    "along_1",
    "along_2",
    "along_3",
    "log_slimness_2",
    "log_slimness_3",
    "skewness_1",
    "skewness_2",
    "skewness_3",
    "log10_volume",
)
_BY_MODALITY = {
    Modality.GEOMETRY: _GEOMETRY,
    Modality.RGB: ("red", "green", "blue", "seen"),
    Modality.XRAY: ("log10_lac_pa", "log10_lac_lat"),
}
VECTORS = (("x", "y", "z"), ("normal_x", "normal_y", "normal_z"))
"""The channels that turn with the object."""
THINNEST = 0.05
"""Least deviation along an axis, in voxels."""
FAINTEST_PER_CM = 1e-3
"""Attenuation below which nothing is told from air."""


def channel_names(reads: Modality) -> tuple[str, ...]:
    """Names of the channels of a method that reads this.

    Examples
    --------
    >>> channel_names(Modality.GEOMETRY | Modality.XRAY)[-2:]
    ('log10_lac_pa', 'log10_lac_lat')
    """
    return tuple(name for one, names in _BY_MODALITY.items() if one in reads for name in names)


def channels(sample: SampleView) -> Channels:
    """Return the channels of a sample, in the order of :func:`channel_names`.

    Parameters
    ----------
    sample
        Needs ``GEOMETRY``; pictures and radiographs are used if it declares them.

    Returns
    -------
    array
        Shape (channels, 64, 64, 64), 0 outside the envelope.

    Raises
    ------
    DataError
        If nothing is inside the envelope, or the pictures show no voxel of the object.
    """
    inside = sample.envelope > 0
    if not inside.any():
        raise DataError(f"{sample.object_id}: its envelope is empty")
    found = [_geometry(sample, inside)]
    if Modality.RGB in sample.reads:
        found.append(_colours(sample))
    if Modality.XRAY in sample.reads:
        lac = back_projected_lac_per_cm(sample).clip(FAINTEST_PER_CM, None)
        found.append(np.log10(lac))
    return np.asarray(np.concatenate(found) * inside)


def _geometry(sample: SampleView, inside: Bool[np.ndarray, "x y z"]) -> Channels:
    """Envelope, depth and place as shares of the cube's edge, size, outward normal, own axes."""
    depth = ndimage.distance_transform_edt(inside) / FIELD_SIZE
    place = np.indices(inside.shape) / (FIELD_SIZE - 1) - 0.5
    extent = np.full(inside.shape, np.log10(FIELD_SIZE * sample.voxel_size_cm))
    grids = [sample.envelope[None], depth[None], place, extent[None], _normals(depth, inside)]
    grids.append(_principal(sample.envelope, sample.voxel_size_cm))
    return np.concatenate(grids).astype(np.float32)


def _principal(envelope: Grid, voxel_size_cm: float) -> Channels:
    """Place along the three principal axes in deviations, longest first, and what sums them up.

    An axis points to where the object tails off. Where it is symmetric, or two axes are as long,
    the direction says nothing, and is what the arithmetic gives.
    """
    place = np.indices(envelope.shape).reshape(3, -1)
    inside = np.flatnonzero(envelope)
    weight = envelope.ravel()[inside].astype(np.float64)
    points = place[:, inside] - np.average(place[:, inside], axis=1, weights=weight)[:, None]
    variances, axes = np.linalg.eigh(np.cov(points, aweights=weight, bias=True))
    deviations = np.sqrt(variances[::-1].clip(THINNEST**2, None))
    along = axes[:, ::-1].T @ points / deviations[:, None]
    skewness = np.average(along**3, axis=1, weights=weight)
    told = [
        *np.log(deviations[1:] / deviations[0]),
        *np.abs(skewness),
        np.log10(weight.sum() * voxel_size_cm**3),
    ]
    grids = np.zeros((3 + len(told), *envelope.shape), dtype=np.float32)
    grids.reshape(len(grids), -1)[:, inside] = [
        *np.where(skewness < 0, -1, 1)[:, None] * along,
        *np.repeat(np.array(told)[:, None], len(inside), axis=1),
    ]
    return grids


def _normals(depth: Grid, inside: Bool[np.ndarray, "x y z"]) -> Channels:
    """Direction to the nearest surface, of length 1; 0 where several are as near."""
    signed = depth - ndimage.distance_transform_edt(~inside) / FIELD_SIZE
    slope = -np.stack(np.gradient(ndimage.gaussian_filter(signed, 1.0)))
    length = np.linalg.norm(slope, axis=0)
    return np.asarray(slope / length.clip(1e-3 / FIELD_SIZE, None), dtype=np.float32)


def _colours(sample: SampleView) -> Channels:
    """Mean colour over the pictures that see a voxel, 0 to 1, and the share of them that do.

    A voxel that none sees, as all within, has the colour of the nearest seen one.

    Raises
    ------
    DataError
        If the pictures show no voxel of the object.
    """
    pictures: Pictures = sample.pictures
    near = near_surface(sample)
    points = voxel_centres_cm(sample, near)
    # whole numbers, so that the order of the pictures cannot matter
    sums, counts = np.zeros((3, len(points)), np.int64), np.zeros(len(points), np.int64)
    for view, colors in enumerate(pictures.colors):
        seen, pixels = visible(points, pictures, view, tolerance_cm=SKIN * sample.voxel_size_cm)
        sums[:, seen] += colors[pixels[:, 0], pixels[:, 1]].T
        counts += seen
    if not counts.any():
        raise DataError(f"{sample.object_id}: its pictures show no voxel of it")
    grids = np.zeros((4, *near.shape), dtype=np.float32)
    grids[:3, near] = sums / (255 * counts.clip(1, None))
    grids[3, near] = counts / len(pictures)
    grids[:3] = nearest_filled(grids[:3], grids[3] > 0)
    return grids
