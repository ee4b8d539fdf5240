"""What a network is shown of an object: its outer surface, and crops of its radiographs.

Nothing of it depends on what is inside, but for the radiographs. Needs the extra ``build``.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import Final

import numpy as np
import trimesh
from jaxtyping import Float16, Float32
from scipy import ndimage

from xden1k.access.samples import SampleView
from xden1k.errors import DataError
from xden1k.values.arrays import Image, Mask
from xden1k.values.modality import Modality
from xden1k.values.views import XRayView
from xden_baselines.xfield.crops import Crop, Cube, projection
from xden_baselines.xray import mean_lengths_cm

__all__ = ["VIEWS", "Seen", "seen", "surface_points"]

VIEWS: Final = ("pa", "lat")
"""Names of the views, in the order of their axis."""


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What a network is shown of one object. Geometry alone has no views.

    Parameters
    ----------
    surface
        Shape (n, 6): points on the outer surface in units of the cube, and outward normals.
    transmission
        Shape (views, rows, columns): I / I0 in the crop of each view; beside the object 1.
    chord
        Shape (views, rows, columns): way inside the outer surface, cavities included, over half the
        cube's edge.
    projection
        Shape (views, 3, 4): see :func:`xden_baselines.xfield.crops.projection`.
    half_cm
        Half the edge of the cube: the object's physical scale.
    """

    surface: Float32[np.ndarray, "n 6"]
    transmission: Float16[np.ndarray, "views rows columns"]
    chord: Float16[np.ndarray, "views rows columns"]
    projection: Float32[np.ndarray, "views 3 4"]
    half_cm: float


def seen(sample: SampleView, points: int, crop_px: int) -> Seen:
    """Prepare a sample.

    Parameters
    ----------
    sample
        Needs ``GEOMETRY``; radiographs are used if it declares ``XRAY``.
    points
        On the outer surface.
    crop_px
        Rows and columns of the crops.

    Raises
    ------
    DataError
        If the object has no radiographs, one of them does not show it, or it reaches beyond one.
    """
    cube = Cube.of(sample)
    surface = surface_points(sample.outer_mesh, cube, points, sample.object_id)
    views = [
        _cropped(view, sample.outer_mesh, cube, crop_px, sample.object_id)
        for view in (sample.views if Modality.XRAY in sample.reads else ())
    ]
    shapes = [(0, crop_px, crop_px), (0, crop_px, crop_px), (0, 3, 4)]
    transmission, chord, matrices = (
        (np.stack(arrays) for arrays in zip(*views, strict=True))
        if views
        else map(np.zeros, shapes)
    )
    return Seen(
        surface,
        transmission.astype(np.float16),
        chord.astype(np.float16),
        matrices.astype(np.float32),
        cube.half_cm,
    )


def surface_points(
    outer: trimesh.Trimesh, cube: Cube, number: int, object_id: str
) -> Float32[np.ndarray, "n 6"]:
    """Draw points evenly on a surface, by the CRC-32 of the object's id.

    Returns
    -------
    array
        Shape (n, 6): place in units of the cube, outward normal.
    """
    points_cm, faces = trimesh.sample.sample_surface(
        outer, number, seed=zlib.crc32(object_id.encode())
    )
    normals = outer.face_normals[faces]
    return np.concatenate([cube.places(points_cm), normals], axis=1).astype(np.float32)


def _cropped(
    view: XRayView, outer: trimesh.Trimesh, cube: Cube, size: int, object_id: str
) -> tuple[Image, Image, Float32[np.ndarray, "3 4"]]:
    """Transmission, chord over half the cube's edge, and projection of the crop of a view."""
    _refuse_outside(view, outer, object_id)
    crop = Crop.around(cube, view.geometry, size)
    lengths_cm = mean_lengths_cm(outer, view.geometry)
    chord = crop.averaged(lengths_cm, np.ones_like(view.valid))[0] / cube.half_cm
    transmission, covered = crop.averaged(view.transmission, view.valid)
    beside = covered & (chord == 0)
    if not beside.any() or not (covered & (chord > 0)).any():
        raise DataError(
            f"{object_id}: view {view.name} must have valid pixels on and beside the object"
        )
    transmission = _filled(transmission / np.median(transmission[beside]), covered, chord > 0)
    if not (transmission[chord > 0].mean() < 1):
        raise DataError(f"{object_id}: view {view.name} shows nothing where the object is")
    matrix = projection(crop.geometry(view.geometry), cube)
    return transmission, chord, matrix.astype(np.float32)


def _refuse_outside(view: XRayView, outer: trimesh.Trimesh, object_id: str) -> None:
    """Refuse an object that reaches beyond its radiograph."""
    corners = view.geometry.project(np.asarray(outer.vertices))[:, 1::-1]
    beyond = np.maximum(-0.5 - corners, corners - view.geometry.shape + 0.5).max()
    if beyond > 0:
        raise DataError(
            f"{object_id}: view {view.name} of {view.geometry.shape} pixels must show the whole "
            f"object, which reaches {beyond:.1f} pixels beyond it"
        )


def _filled(transmission: Image, covered: Mask, shadow: Mask) -> Image:
    """Give pixels that no valid one covers the nearest one's value; beside the shadow, air."""
    nearest = ndimage.distance_transform_edt(~covered, return_distances=False, return_indices=True)
    known: Image = transmission[tuple(nearest)]
    return np.where(covered | shadow, known, np.float32(1))
