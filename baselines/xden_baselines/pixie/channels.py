"""What a network is shown of each voxel.

All channels but ``log10_extent`` are free of scale: they are the same for an object twice as
large. ``log10_lac`` is so too if the material is the same. None depends on the order of pictures.

Needs the extra ``build``.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float32
from scipy import ndimage

from xden1k.arrays import Grid
from xden1k.errors import DataError
from xden1k.modality import Modality
from xden1k.samples import SampleView
from xden1k.types import FIELD_SIZE
from xden_baselines.geometry import nearest_filled, voxel_centres_cm
from xden_baselines.views.pictures import Pictures, visible
from xden_baselines.xray import back_projected_lac_per_cm

__all__ = ["ENVELOPE", "MIRRORED", "Channels", "channel_names", "channels"]

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
)
_BY_MODALITY = {
    Modality.GEOMETRY: _GEOMETRY,
    Modality.RGB: ("red", "green", "blue", "seen"),
    Modality.XRAY: ("log10_lac_pa", "log10_lac_lat"),
}
MIRRORED = (("x", "normal_x"), ("y", "normal_y"), ("z", "normal_z"))
"""The channels that change sign when an axis is turned round."""
SKIN = 2.0
"""How deep below the surface a voxel's centre may lie and still be seen, in voxels."""
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
    """
    inside = sample.envelope > 0
    found = [_geometry(sample, inside)]
    if Modality.RGB in sample.reads:
        found.append(_colours(sample))
    if Modality.XRAY in sample.reads:
        lac = back_projected_lac_per_cm(sample).clip(FAINTEST_PER_CM, None)
        found.append(np.log10(lac))
    return np.asarray(np.concatenate(found) * inside)


def _geometry(sample: SampleView, inside: Bool[np.ndarray, "x y z"]) -> Channels:
    """Envelope, depth and place as shares of the cube's edge, size, outward normal."""
    depth = ndimage.distance_transform_edt(inside) / FIELD_SIZE
    place = np.indices(inside.shape) / (FIELD_SIZE - 1) - 0.5
    extent = np.full(inside.shape, np.log10(FIELD_SIZE * sample.voxel_size_cm))
    grids = [sample.envelope[None], depth[None], place, extent[None], _normals(depth, inside)]
    return np.concatenate(grids).astype(np.float32)


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
    inside = sample.envelope > 0
    near = inside & (ndimage.distance_transform_edt(inside) <= SKIN)
    points = voxel_centres_cm(sample, near)
    # whole numbers, so that the order of the pictures cannot matter
    sums, counts = np.zeros((3, len(points)), np.int64), np.zeros(len(points), np.int64)
    for view, colors in enumerate(pictures.colors):
        seen, pixels = visible(points, pictures, view, tolerance_cm=SKIN * sample.voxel_size_cm)
        sums[:, seen] += colors[pixels[:, 0], pixels[:, 1]].T
        counts += seen
    if not counts.any():
        raise DataError(f"{sample.object_id}: its pictures show no voxel of it")
    grids = np.zeros((4, *inside.shape), dtype=np.float32)
    grids[:3, near] = sums / (255 * counts.clip(1, None))
    grids[3, near] = counts / len(pictures)
    grids[:3] = nearest_filled(grids[:3], grids[3] > 0)
    return grids
