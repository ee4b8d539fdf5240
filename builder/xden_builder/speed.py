"""``xden-build speed``: our way against the alternatives, as ratios in one run.

Absolute seconds depend on the machine and on who else uses it; ratios of processor time taken in
one run hardly do. Every row also says how far each result is from the truth, because a fast wrong
answer is no alternative.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from statistics import median
from typing import Any, TypeVar

import numpy as np
import trimesh

from xden1k.rays import CubeGrid, PathLengths, part_fractions, path_lengths
from xden1k.views import ViewGeometry, XRayView
from xden_builder.fit.compare import compare_solvers
from xden_builder.peers import (
    Lengths,
    cast_lengths,
    march_lengths,
    pixel_rays,
    reference_lengths,
)

__all__ = ["Comparison", "comparisons", "scene", "scene_radiographs", "scene_views"]

Result = TypeVar("Result")

QUANTA = 20_000
"""Open-field quanta of a pixel in the scene's radiographs."""
LAC_PER_CM = np.array([0.17, 0.25, 0.4, 0.6, 1.0, 0.3])
SEED = 0


@dataclass(frozen=True, slots=True)
class Comparison:
    """Two ways to the same result.

    Parameters
    ----------
    task
        What both do.
    ours, other
        Names of the two ways.
    ours_s, other_s
        Processor seconds, all threads.
    ours_error, other_error
        How far from the reference: what ``error`` says.
    error
        Meaning and unit of the errors.
    """

    task: str
    ours: str
    other: str
    ours_s: float
    other_s: float
    ours_error: float
    other_error: float
    error: str

    @property
    def ratio(self) -> float:
        """How many times our processor time the other way takes."""
        return self.other_s / self.ours_s

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON."""
        return asdict(self) | {"ratio": self.ratio}


def scene() -> list[trimesh.Trimesh]:
    """Make six parts that do not overlap: 54,000 faces, 10 x 5 x 17 cm.

    A ball with bumps, an ellipsoid, a capsule, a torus, a thin-walled tube and a box.
    """
    blob = trimesh.creation.icosphere(subdivisions=5, radius=1.8)
    bumps = 1 + 0.12 * np.sin(5 * blob.vertices).prod(axis=1, keepdims=True)
    blob.vertices = blob.vertices * bumps
    ellipsoid = trimesh.creation.icosphere(subdivisions=5)
    ellipsoid.apply_scale((1.5, 1.0, 2.2))
    capsule = trimesh.creation.capsule(height=4.0, radius=0.7, count=[64, 64])
    torus = trimesh.creation.torus(1.6, 0.4, major_sections=64, minor_sections=32)
    tube = trimesh.creation.annulus(1.1, 1.2, 5.0, sections=96)
    box = trimesh.creation.box((2.0, 3.0, 1.0))
    places = [(-3, 0, 6), (3, 1, 6), (-3, 0, -1), (3, -1, 0), (-3, 1, -6.5), (3, 0, -6)]
    parts = [blob, ellipsoid, capsule, torus, tube, box]
    tilt = trimesh.transformations.rotation_matrix(0.3, (1, 2, 3))  # type: ignore[no-untyped-call]
    for part, place in zip(parts, places, strict=True):
        part.apply_transform(tilt)
        part.apply_translation(place)
    return parts


def scene_views(size: int) -> tuple[ViewGeometry, ViewGeometry]:
    """PA and LAT by a 43 cm panel of ``size`` pixels a side, 100 cm before and 30 behind."""
    step = 43.0 / size
    edge = 21.5 - step / 2
    down = np.array([0.0, 0.0, -step])
    return (
        ViewGeometry(
            beam="cone",
            source_cm=np.array([0.0, -100.0, 0.0]),
            pixel00_cm=np.array([-edge, 30.0, edge]),
            column_step_cm=np.array([step, 0.0, 0.0]),
            row_step_cm=down,
            shape=(size, size),
        ),
        ViewGeometry(
            beam="cone",
            source_cm=np.array([-100.0, 0.0, 0.0]),
            pixel00_cm=np.array([30.0, edge, edge]),
            column_step_cm=np.array([0.0, -step, 0.0]),
            row_step_cm=down,
            shape=(size, size),
        ),
    )


def scene_radiographs(
    parts: list[trimesh.Trimesh], size: int
) -> list[tuple[PathLengths, XRayView]]:
    """Path lengths of one ray a pixel, and an image with the noise of 20,000 quanta a pixel."""
    rng = np.random.default_rng(SEED)
    pairs = []
    for name, geometry in zip(("pa", "lat"), scene_views(size), strict=True):
        lengths = path_lengths(parts, range(len(parts)), geometry)
        counts = rng.poisson(QUANTA * lengths.image(LAC_PER_CM))
        image = (counts / QUANTA).astype(np.float32)
        pairs.append((lengths, XRayView(name, image, np.ones(image.shape, bool), geometry)))
    return pairs


def comparisons(size: int = 1024, repeats: int = 5, voxels: int = 256) -> Iterator[Comparison]:
    """Compare the fit with the paper's, and path lengths with ray casting and ray marching.

    Parameters
    ----------
    size
        Pixels along each side of both radiographs.
    repeats
        Of our own, fast way; the slow ones run once.
    voxels
        Along each side of the volume that rays march through.
    """
    parts = scene()
    yield _fit_comparison(scene_radiographs(parts, size), repeats)
    yield from _length_comparisons(parts, size, repeats, voxels)


def _fit_comparison(pairs: list[tuple[PathLengths, XRayView]], repeats: int) -> Comparison:
    result = compare_solvers(pairs, repeats=repeats)
    size = pairs[0][0].shape[0]
    return Comparison(
        task=f"fit of 6 parts to 2 x {size}² pixels",
        ours=f"Levenberg-Marquardt, {result.lm_iterations} steps",
        other=f"Adam on full frames, {result.adam_steps} steps",
        ours_s=result.lm_cpu_seconds,
        other_s=result.adam_cpu_seconds,
        ours_error=result.lm_excess,
        other_error=result.adam_excess,
        error="loss above the least seen, relative",
    )


def _length_comparisons(
    parts: list[trimesh.Trimesh], size: int, repeats: int, voxels: int
) -> Iterator[Comparison]:
    """Path lengths of the PA view; the others get only the rays that meet the object."""
    geometry = scene_views(size)[0]
    order = range(len(parts))
    path_lengths(parts, order, geometry)  # compiles
    ours_s, ours = timed(lambda: path_lengths(parts, order, geometry), repeats)
    rays = pixel_rays(geometry, ours.pixels)
    chosen = np.random.default_rng(SEED).permutation(len(ours.pixels))[:300]
    truth = reference_lengths(parts, pixel_rays(geometry, ours.pixels[chosen]))

    def worst(lengths: Lengths) -> float:
        return float(np.abs(lengths[chosen] - truth).max())

    row = Comparison(
        task=f"path lengths of 6 parts, {size}² pixels",
        ours="signed-depth scan conversion",
        other="",
        ours_s=ours_s,
        other_s=0.0,
        ours_error=worst(ours.lengths_cm[:, 0]),
        other_error=0.0,
        error=f"largest error on {len(chosen)} rays, cm",
    )
    casting_s, cast = timed(lambda: cast_lengths(parts, rays), 1)
    yield replace(
        row, other="ray casting, trimesh + Embree", other_s=casting_s, other_error=worst(cast)
    )
    cube = _cube_around(parts, voxels)
    shares = _shares(parts, cube)
    low = cube.origin_cm - cube.voxel_size_cm / 2
    marching_s, marched = timed(
        lambda: march_lengths(shares, low, cube.size * cube.voxel_size_cm, rays), 1
    )
    yield replace(
        row,
        other=f"ray marching through {voxels}³ voxels, torch grid_sample",
        other_s=marching_s,
        other_error=worst(marched),
    )


def _cube_around(parts: list[trimesh.Trimesh], size: int) -> CubeGrid:
    bounds = np.array([part.bounds for part in parts])
    low, high = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
    voxel = float((high - low).max()) / (size - 2)
    return CubeGrid((low + high - voxel * (size - 1)) / 2, voxel, size)


def _shares(parts: list[trimesh.Trimesh], cube: CubeGrid) -> np.ndarray:
    """Share of each voxel that each part fills, shape (parts, x, y, z) float32."""
    shares = np.zeros((len(parts), *(cube.size,) * 3), dtype=np.float32)
    for grid, fill in zip(shares, part_fractions(parts, range(len(parts)), cube, 4), strict=True):
        grid[fill.where] = fill.share
    return shares


def timed(work: Callable[[], Result], repeats: int) -> tuple[float, Result]:
    """Median processor seconds of a piece of work, and its result."""
    seconds = []
    for _ in range(repeats):
        start = time.process_time()
        result = work()
        seconds.append(time.process_time() - start)
    return median(seconds), result
