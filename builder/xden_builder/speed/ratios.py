"""``xden-build speed``: our way against the alternatives, as ratios in one run.

Absolute seconds depend on the machine and on who else uses it; ratios of processor time taken in
one run hardly do. Every row also says how far each result is from the truth, because a fast wrong
answer is no alternative.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np
import torch
import trimesh
from jaxtyping import Int64

from xden1k.rays import (
    CubeGrid,
    PathLengths,
    disjoint_path_lengths,
    part_fractions,
    path_lengths,
)
from xden1k.values.views import ViewGeometry, XRayView
from xden_builder.fit.compare import compare_solvers
from xden_builder.speed import torch_rays
from xden_builder.speed.peers import (
    Lengths,
    cast_lengths,
    march_lengths,
    pixel_rays,
    reference_lengths,
)
from xden_builder.speed.scenes import radiograph, six_parts, two_views
from xden_builder.speed.timing import timed
from xden_builder.speed.whole_object import CATEGORY, compared_ways

__all__ = ["Comparison", "comparisons", "scene_radiographs"]

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
        Seconds.
    ours_error, other_error
        How far from the reference: what ``error`` says.
    error
        Meaning and unit of the errors.
    clock
        ``processor``: time of all threads; ``wall``: time that passes, where a GPU does the work.
    """

    task: str
    ours: str
    other: str
    ours_s: float
    other_s: float
    ours_error: float
    other_error: float
    error: str
    clock: Literal["processor", "wall"] = "processor"

    @property
    def ratio(self) -> float:
        """How many times our time the other way takes."""
        return self.other_s / self.ours_s

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON."""
        return asdict(self) | {"ratio": self.ratio}


def scene_radiographs(
    parts: list[trimesh.Trimesh], size: int
) -> list[tuple[PathLengths, XRayView]]:
    """Path lengths of one ray a pixel, and radiographs."""
    rng = np.random.default_rng(SEED)
    pairs = []
    for name, geometry in zip(("pa", "lat"), two_views(size), strict=True):
        lengths = path_lengths(parts, range(len(parts)), geometry)
        pairs.append((lengths, radiograph(name, geometry, lengths, LAC_PER_CM, rng)))
    return pairs


def comparisons(size: int = 1024, repeats: int = 5, voxels: int = 256) -> Iterator[Comparison]:
    """Compare the fit with the paper's, and path lengths with other ways to them.

    The other ways are ray casting, ray marching, and our own algorithm in torch: on the CPU, and
    on a GPU if there is one.

    Parameters
    ----------
    size
        Pixels along each side of both radiographs.
    repeats
        Of our own, fast way; the slow ones run once.
    voxels
        Along each side of the volume that rays march through.
    """
    parts = six_parts()
    yield _fit_comparison(scene_radiographs(parts, size), repeats)
    yield from _length_comparisons(parts, size, repeats, voxels)
    yield _object_comparison(size, repeats)


def _fit_comparison(pairs: list[tuple[PathLengths, XRayView]], repeats: int) -> Comparison:
    result = compare_solvers(pairs, repeats=repeats)
    size = pairs[0][0].shape[0]
    return Comparison(
        task=f"fit of 6 parts to 2 x {size}² pixels",
        ours=f"Levenberg-Marquardt, steps: {result.lm_iterations}",
        other=f"Adam on full frames, steps: {result.adam_steps}",
        ours_s=result.lm_cpu_seconds,
        other_s=result.adam_cpu_seconds,
        ours_error=result.lm_excess,
        other_error=result.adam_excess,
        error="loss above the least seen, relative",
    )


def _object_comparison(size: int, repeats: int) -> Comparison:
    count, (ours_s, ours_error), (other_s, other_error) = compared_ways(size, repeats)
    return Comparison(
        task=f"densities of a {CATEGORY} of {count} parts, 2 x {size}² pixels",
        ours="pose, materials, stray light and spectrum",
        other="the paper's way: attenuation by Adam on full frames, by 0.17",
        ours_s=ours_s,
        other_s=other_s,
        ours_error=ours_error,
        other_error=other_error,
        error="density MAE, g/cm³",
    )


def _length_comparisons(
    parts: list[trimesh.Trimesh], size: int, repeats: int, voxels: int
) -> Iterator[Comparison]:
    """Path lengths of the PA view; the others get only the rays that meet the object."""
    geometry = two_views(size)[0]
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
    summed = disjoint_path_lengths(parts, geometry)  # compiles
    summed_s, _ = timed(lambda: disjoint_path_lengths(parts, geometry), repeats)
    yield replace(
        row,
        ours="sums of depths, parts that share no space",
        other=row.ours,
        ours_s=summed_s,
        other_s=ours_s,
        ours_error=_worst_of(summed, ours.pixels[chosen], truth),
        other_error=row.ours_error,
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
    for device in ("cpu", "cuda") if torch.cuda.is_available() else ("cpu",):
        in_torch = torch_rays.path_lengths(parts, order, geometry, device=device)  # warms up
        yield replace(
            _torch_comparison(row, parts, geometry, device, repeats),
            other_error=worst(in_torch.lengths_cm[:, 0]),
        )


def _worst_of(lengths: PathLengths, pixels: Int64[np.ndarray, "n"], truth: Lengths) -> float:
    """Largest error of one ray a pixel in some pixels, in those that it passes over too."""
    told = np.zeros((lengths.shape[0] * lengths.shape[1], truth.shape[1]))
    told[lengths.pixels] = lengths.lengths_cm[:, 0]
    return float(np.abs(told[pixels] - truth).max())


def _torch_comparison(
    row: Comparison,
    parts: list[trimesh.Trimesh],
    geometry: ViewGeometry,
    device: str,
    repeats: int,
) -> Comparison:
    """Time both forms of our algorithm: on one thread, or by the clock on the wall on a GPU."""
    order = range(len(parts))
    on_cpu = device == "cpu"
    clock = time.process_time if on_cpu else time.perf_counter
    ours_s, _ = timed(lambda: path_lengths(parts, order, geometry), repeats, clock)
    with _one_thread():
        other_s, _ = timed(
            lambda: torch_rays.path_lengths(parts, order, geometry, device=device), repeats, clock
        )
    return replace(
        row,
        other=f"the same in torch, {'CPU, one thread' if on_cpu else 'CUDA'}",
        ours_s=ours_s,
        other_s=other_s,
        clock="processor" if on_cpu else "wall",
    )


@contextmanager
def _one_thread() -> Iterator[None]:
    """Keep torch to one thread: on a busy machine several wait for each other, all at full load."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


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
