"""Rebuilds of the same captures from other parts, against the truth of voxels and radiographs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from xden1k.errors import DataError
from xden1k.folder import open_folder
from xden1k.rays import CubeGrid, density_grid, ownership_order, part_fractions
from xden1k.values.arrays import Grid
from xden1k.values.types import FIELD_SIZE, DensityObject
from xden_builder.audit.object import audit_object
from xden_builder.capture import Capture, CaptureFolder
from xden_builder.evaluate.cells import HEADERS, error_cells, reprojection_cells, table
from xden_builder.evaluate.quality import Quality
from xden_builder.evaluate.truth import Errors, Truth, read_truth, size_of
from xden_builder.workers import gather

__all__ = ["Interior", "Interiors", "compare_interiors", "interiors_markdown"]


@dataclass(frozen=True, slots=True)
class Interior:
    """One rebuild of one object.

    Parameters
    ----------
    parts
        Number of its parts, whatever they are called.
    errors
        Of its density, over voxels weighted by their share inside the outer surface, mass and
        centre of mass.
    quality
        The same of voxels, and its reprojection.
    """

    parts: int
    errors: Errors
    quality: Quality


@dataclass(frozen=True, slots=True)
class Interiors:
    """All rebuilds of a folder.

    Parameters
    ----------
    objects
        By object id: each rebuild, in the order of the folders. Objects that all have.
    failures
        Object id and reason of the others.
    """

    objects: dict[str, tuple[Interior, ...]]
    failures: tuple[tuple[str, str], ...]

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON."""
        return asdict(self)


def compare_interiors(
    captures: Path,
    roots: Sequence[Path],
    *,
    workers: int,
    on_done: Callable[[str], None] = lambda _: None,
) -> Interiors:
    """Compare rebuilds of simulated captures that may be of other parts than the truth.

    Parameters
    ----------
    captures
        Folder of simulated captures, with their truth; meshes near their place.
    roots
        Dataset folders made of it.
    workers
        Processes.
    on_done
        Told of each object.

    Raises
    ------
    DataError
        If a folder cannot be read.
    """
    there = [set(open_folder(root).ids()) for root in roots]
    wanted = CaptureFolder(captures).object_ids
    task = partial(_compared, captures, tuple(roots))
    everywhere = [key for key in wanted if all(key in ids for ids in there)]
    missing = [(key, "not rebuilt everywhere") for key in wanted if key not in everywhere]
    objects, failures = gather(task, everywhere, workers, on_done)
    return Interiors(objects, tuple(sorted([*missing, *failures])))


def interiors_markdown(names: Sequence[str], found: Interiors) -> str:
    """Write a table with a row for each rebuild."""
    if not found.objects:
        return "0 simulated objects.\n"
    rows = []
    for name, each in zip(names, zip(*found.objects.values(), strict=True), strict=True):
        parts = f"{np.mean([one.parts for one in each]):.1f}"
        reprojection = reprojection_cells([one.quality for one in each])
        rows.append([name, parts, *reprojection, *error_cells([one.errors for one in each])])
    headers = ("rebuilt from", "parts", "PA", "LAT", "PA beside", "LAT beside", *HEADERS)
    return (
        f"{len(found.objects)} simulated objects. Reprojection: mean absolute error of -ln T on "
        "the pixels whose ray meets the object, and beside it, mean and standard deviation over "
        "objects. Density MAE over voxels, weighted by their share inside the outer surface; "
        "means over objects, medians in brackets.\n\n" + table(headers, rows) + "\n"
    )


def _compared(captures: Path, roots: Sequence[Path], object_id: str) -> tuple[Interior, ...]:
    capture = CaptureFolder(captures).read(object_id)
    if capture.pose != "near":
        raise DataError(f"{object_id}: expected meshes near their place, got pose {capture.pose}")
    truth = read_truth(captures / object_id, capture.parts)
    return tuple(_interior(capture, truth, open_folder(root).object(object_id)) for root in roots)


def _interior(capture: Capture, truth: Truth, rebuilt: DensityObject) -> Interior:
    if rebuilt.density is None:
        raise DataError(f"{rebuilt.object_id}: expected a density, got attenuation alone")
    weights = rebuilt.envelope.astype(np.float64)
    truth = truth.enlarged(size_of(rebuilt))
    off = np.abs(rebuilt.density.density_g_cm3 - _true_g_cm3(capture, truth, rebuilt))
    mae_g_cm3 = float((off * weights).sum() / weights.sum())
    com_l1_cm = float(np.abs(rebuilt.com_cm - truth.com_cm).sum())
    views = {view.name: view for view in audit_object(rebuilt, capture).views}
    return Interior(
        len(rebuilt.parts),
        Errors(mae_g_cm3, abs(rebuilt.mass_g / truth.mass_g - 1), com_l1_cm),
        Quality(mae_g_cm3, (views["pa"], views["lat"])),
    )


def _true_g_cm3(capture: Capture, truth: Truth, rebuilt: DensityObject) -> Grid:
    """Give the truth on the grid of a rebuild, as large as that."""
    meshes = [size_of(rebuilt).enlarged(part.mesh) for part in capture.parts]
    order = ownership_order(meshes, [part.priority for part in capture.parts])
    grid = CubeGrid(rebuilt.origin_cm, rebuilt.voxel_size_cm, FIELD_SIZE)
    return density_grid(part_fractions(meshes, order, grid), truth.density_g_cm3.tolist(), grid)
