"""Training objects: what is seen of each, what it is inside, and a cache of both.

A lesson is named in the user's cache by a checksum of all that decides it, so that none that is
kept can go stale. Needs the extra ``build``.
"""

from __future__ import annotations

import hashlib
import io
from dataclasses import dataclass, fields
from typing import Any, Final

import numpy as np
from jaxtyping import Float16, Float32, Float64, UInt8

from xden1k.access.samples import Example
from xden1k.errors import DataError
from xden1k.format.cache import PieceCache, cache_folder, cache_limit
from xden1k.predictions import Target
from xden1k.rays import path_lengths
from xden1k.segmentation import GRID_SIZE
from xden1k.segmentation.points import draw_points, point_owners, segment_grid
from xden1k.values.arrays import Image
from xden1k.values.modality import Modality
from xden1k.values.types import DensityObject
from xden1k.values.views import ViewGeometry
from xden_baselines.xfield.crops import Cube
from xden_baselines.xfield.seen import Seen, seen
from xden_baselines.xfield.sizes import Size

__all__ = ["Lesson", "cache", "kept_lesson", "lesson", "third_view"]

VERSION: Final = 1
"""Raised whenever a lesson of the same object becomes another."""
FOLDER: Final = "x-field"
"""In the user's cache of this package."""
POINTS_SEED: Final = 19
"""Of the points that are learned from; those of the benchmark are drawn by another."""


@dataclass(frozen=True, slots=True, eq=False)
class Lesson(Seen):
    """One training object.

    Parameters
    ----------
    surface, transmission, chord, projection, half_cm
        What is seen of it.
    voxels
        Shape (points, 3): where it is known inside, in voxels of ``GRID_SIZE`` along the cube.
    owner
        Shape (points,): the part of each point, 0 = void.
    densities_g_cm3
        Shape (owners,): the target, of void and of each part.
    third
        Shape (x, y): line integrals of attenuation along z over the plane of x (rows) and
        y (columns), monochromatic, as no scan has them: for training alone.
    """

    voxels: UInt8[np.ndarray, "points 3"]
    owner: UInt8[np.ndarray, "points"]
    densities_g_cm3: Float32[np.ndarray, "owners"]
    third: Float16[np.ndarray, "x y"]

    def places(self, chosen: Any) -> Float32[np.ndarray, "chosen 3"]:
        """Return points in units of the cube."""
        centres = (self.voxels[chosen] + np.float32(0.5)) * np.float32(2 / GRID_SIZE) - 1
        return np.asarray(centres)


def lesson(example: Example, size: Size) -> Lesson:
    """Prepare a training object.

    Raises
    ------
    DataError
        If a part has no known target, the outer surface is not closed, or a radiograph does not
        show the object.
    """
    sample, truth = example.sample, example.truth
    shown = seen(sample, size.points, size.crop_px)
    grid = segment_grid(sample.origin_cm, sample.voxel_size_cm)
    points = draw_points(sample.outer_mesh, grid, sample.object_id, POINTS_SEED)
    return Lesson(
        **{field.name: getattr(shown, field.name) for field in fields(Seen)},
        voxels=points.voxels,
        owner=point_owners([part.mesh for part in truth.parts], grid, points),
        densities_g_cm3=_densities_g_cm3(truth, sample.target),
        third=third_view(truth, Cube.of(sample), 2 * size.plane).astype(np.float16),
    )


def cache() -> PieceCache:
    """Return the user's cache of lessons; it keeps at most ``XDEN1K_CACHE_GB`` gigabytes.

    Raises
    ------
    DataError
        If that is no number.
    """
    return PieceCache(cache_folder() / FOLDER, cache_limit())


def kept_lesson(example: Example, size: Size, kept: PieceCache) -> Lesson:
    """Return a lesson that is kept; prepare and keep it if it is not there.

    Raises
    ------
    DataError
        As :func:`lesson`.
    """
    name = _name(example, size)
    if (piece := kept.get(name)) is not None:
        return _unpacked(piece)
    made = lesson(example, size)
    kept.put(name, _packed(made))
    return made


def third_view(truth: DensityObject, cube: Cube, size: int) -> Image:
    """Line integrals along z over the cube, from the parts' attenuation.

    Raises
    ------
    DataError
        If the attenuation of a part is not known.
    """
    lac_per_cm = _known(truth, "lac_per_cm")
    paths = path_lengths(
        [part.mesh for part in truth.parts], range(len(truth.parts)), _from_above(cube, size)
    )
    integral = np.zeros((size, size), dtype=np.float32)
    integral.flat[paths.pixels] = paths.lengths_cm.mean(axis=1) @ lac_per_cm
    return integral


def _from_above(cube: Cube, size: int) -> ViewGeometry:
    """Parallel rays along z; rows along x and columns along y cover the cube."""
    step_cm = 2 * cube.half_cm / size
    corner = (step_cm - 2 * cube.half_cm) / 2
    return ViewGeometry(
        beam="parallel",
        pixel00_cm=cube.centre_cm + np.array([corner, corner, -2 * cube.half_cm]),
        column_step_cm=np.array([0.0, step_cm, 0.0]),
        row_step_cm=np.array([step_cm, 0.0, 0.0]),
        shape=(size, size),
        direction=np.array([0.0, 0.0, 1.0]),
    )


def _densities_g_cm3(truth: DensityObject, target: Target) -> Float32[np.ndarray, "owners"]:
    """Target of void and of each part."""
    return np.array([0.0, *_known(truth, f"{target}_g_cm3")], dtype=np.float32)


def _known(truth: DensityObject, figure: str) -> Float64[np.ndarray, "parts"]:
    """Return a figure of each part, all of them numbers."""
    found = [getattr(part, figure) for part in truth.parts]
    for part, value in zip(truth.parts, found, strict=True):
        if not np.isfinite(value):
            raise DataError(
                f"{truth.object_id}: the part {part.name} must have a finite {figure} to be "
                f"learned from, got {value}"
            )
    return np.array(found)


def _name(example: Example, size: Size) -> str:
    """Name a lesson by what decides it."""
    sample, truth = example.sample, example.truth
    recipe = (VERSION, POINTS_SEED, sample.object_id, sample.target, sample.reads.inputs)
    digest = hashlib.sha256(f"{recipe} {size.points} {size.crop_px} {size.plane}".encode())
    density = f"{sample.target}_g_cm3"
    for part in truth.parts:
        digest.update(f"{part.lac_per_cm} {getattr(part, density)}".encode())
        _add(digest, part.mesh.vertices, part.mesh.faces)
    if Modality.XRAY in sample.reads:
        for view in sample.views:
            digest.update(f"{view.name} {view.geometry.to_dict()}".encode())
            _add(digest, view.transmission, view.valid)
    return f"{digest.hexdigest()}.npz"


def _add(digest: Any, *arrays: np.ndarray) -> None:
    for array in arrays:
        digest.update(f"{array.dtype} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())


def _packed(made: Lesson) -> bytes:
    file = io.BytesIO()
    np.savez_compressed(file, **{field.name: getattr(made, field.name) for field in fields(Lesson)})
    return file.getvalue()


def _unpacked(piece: bytes) -> Lesson:
    with np.load(io.BytesIO(piece), allow_pickle=False) as found:
        arrays = {field.name: found[field.name] for field in fields(Lesson)}
    return Lesson(**{**arrays, "half_cm": float(arrays["half_cm"])})
