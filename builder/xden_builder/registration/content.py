"""Where an object of known rotation may be, by what is seen in its shadows, not by their boxes.

Where a part has no mesh the box around a shadow is not that of the meshes: a hammer without its
handle would stand in the middle of the handle's shadow. Edges are where they are, though. Images of
all shifts at once are compared by a Fourier transform.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import Final

import numpy as np
from jaxtyping import Float32, Float64
from scipy import fft
from scipy.ndimage import gaussian_filter, maximum_filter

from xden_builder.registration.body import Cloud
from xden_builder.registration.camera import Camera, Rotations, Shifts
from xden_builder.registration.middles import led_to

__all__ = ["shifts_to_content"]

BATCH: Final = 512
SMOOTH_PX: Final = 2.5
"""What varies more slowly says little of where an edge is."""
PEAKS: Final = 2
"""Places that are tried in each view."""


def shifts_to_content(
    cameras: Sequence[Camera], cloud: Cloud, rotations: Rotations, shifts: Shifts
) -> Iterator[Shifts]:
    """Yield shifts with which images of the object resemble parts of the measured ones.

    There are two places in each view, so that of v views 2**v shifts come for each pose.

    Parameters
    ----------
    cameras
        Views in which the object stands as it was told.
    cloud
        The object about its middle.
    rotations, shifts
        Shapes (b, 3, 3) and (b, 3), cm: poses that show the object within the cameras' windows.
    """
    origin = np.zeros((len(rotations), 1, 3))
    starts, peaks = [], []
    for camera in cameras:
        starts.append(camera.geometry.project(shifts)[:, :2])
        peaks.append(_peaks_px(camera, cloud, rotations, shifts))
    for numbers in product(range(PEAKS), repeat=len(cameras)):
        places = [
            (camera.geometry, start + peak[:, number])
            for camera, start, peak, number in zip(cameras, starts, peaks, numbers, strict=True)
        ]
        yield led_to(places, origin, shifts)


def _peaks_px(
    camera: Camera, cloud: Cloud, rotations: Rotations, shifts: Shifts
) -> Float64[np.ndarray, "b peaks 2"]:
    """Columns and rows by which images have to be moved to resemble the measured one most."""
    rows, columns = camera.geometry.shape
    whole = fft.next_fast_len(2 * rows, real=True), fft.next_fast_len(2 * columns, real=True)
    wanted = fft.rfft2(_edges(camera.seen[None], rows, columns), whole)
    found = []
    for start in range(0, len(rotations), BATCH):
        here = slice(start, start + BATCH)
        images = _edges(camera.render(cloud, rotations[here], shifts[here]), rows, columns)
        both = (wanted * fft.rfft2(images, whole).conj()).sum(axis=1)
        alike = fft.fftshift(fft.irfft2(both, whole), axes=(1, 2))
        highest = alike == maximum_filter(alike, (1, 3, 3))
        ordered = np.where(highest, -alike, np.inf).reshape(len(alike), -1)
        places = np.argpartition(ordered, PEAKS, axis=1)[:, :PEAKS]
        row, column = np.unravel_index(places, whole)
        found.append(np.stack([column - whole[1] // 2, row - whole[0] // 2], axis=-1))
    return np.concatenate(found).astype(np.float64)


def _edges(
    features: Float32[np.ndarray, "b n"], rows: int, columns: int
) -> Float32[np.ndarray, "b 2 rows columns"]:
    """Both features of images, without what varies slowly."""
    images = features.reshape(len(features), 2, rows, columns)
    return np.asarray(images - gaussian_filter(images, (0, 0, SMOOTH_PX, SMOOTH_PX)))
