"""What the object explorer shows of one object: pictures, tables and the 3D model, on demand."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from threading import RLock
from typing import Any, Final, Literal, get_args

import numpy as np
import pyarrow.parquet as pq
from jaxtyping import Float
from matplotlib.cm import ScalarMappable

from xden1k.errors import DataError
from xden1k.folder import DatasetFolder
from xden1k.pictures.radiographs import compare
from xden1k.predictions import Target, open_predictions
from xden1k.values.arrays import Grid
from xden1k.values.types import PRIVATE, DensityField, DensityObject, Part
from xden_bench.entries.result import entry_path
from xden_bench.scoring.expand import grid_of_parts, part_shares
from xden_bench.scoring.metrics import METRICS
from xden_bench.serve import figures, glb
from xden_bench.serve.figures import Picture

__all__ = ["COLOURS", "PART_HEADINGS", "Colour", "Explorer", "Fields", "best_and_worst"]

Entry = Mapping[str, Any]
Rows = list[list[Any]]
Colour = Literal["density", "density sd", "error"]
COLOURS: Final[tuple[Colour, ...]] = ("density", "density sd", "error")
"""What the 3D view can be coloured by; ``error`` needs a method."""

PART_HEADINGS: Final = (
    *("part", "material", "density, g/cm³", "sd, g/cm³", "LAC, 1/cm"),
    *("volume, cm³", "source", "flags"),
)
OBJECTS_KEPT: Final = 16
MODELS_KEPT: Final = 64


@dataclass(frozen=True, eq=False)
class Fields:
    """Truth and prediction of one object on its field grid.

    Parameters
    ----------
    obj
        The object.
    target
        What is predicted.
    truth
        Of the object.
    guess
        Shape (x, y, z), g/cm³; None if no file of the method is at hand.
    """

    obj: DensityObject
    target: Target
    truth: DensityField
    guess: Grid | None

    @cached_property
    def error(self) -> Grid | None:
        """Prediction less truth inside the envelope, 0 outside, where nothing is scored."""
        if self.guess is None:
            return None
        return np.where(self.obj.envelope > 0, self.guess - self.truth.density_g_cm3, 0.0)

    @cached_property
    def scale(self) -> ScalarMappable:
        """Colours of truth and prediction alike, of all planes."""
        inside = self.obj.envelope > 0
        highest = [float(grid[inside].max()) for grid in self._grids]
        return figures.density_scale(max(highest))

    @cached_property
    def error_limit(self) -> float:
        """Largest size of the error, g/cm³."""
        return 0.0 if self.error is None else float(np.abs(self.error).max())

    @cached_property
    def limits_cm(self) -> Float[np.ndarray, "3 2"]:
        """Lowest and highest coordinate of the object on each axis, to a voxel."""
        filled = np.argwhere(self.obj.envelope > 0)
        ends = np.stack([filled.min(axis=0) - 0.5, filled.max(axis=0) + 0.5], axis=1)
        return np.asarray(self.truth.origin_cm[:, None] + ends * self.truth.voxel_size_cm)

    @property
    def _grids(self) -> list[Grid]:
        return [self.truth.density_g_cm3, *([] if self.guess is None else [self.guess])]


class Explorer:
    """Reads objects and predictions and draws them. Safe to call from several threads.

    Parameters
    ----------
    folder
        The dataset.
    upload_of
        Gives the file of a submission by its checksum, None if it is not at hand.
    scratch
        Folder for 3D models; the newest are kept.
    """

    def __init__(
        self, folder: DatasetFolder, upload_of: Callable[[str], Path | None], scratch: Path
    ) -> None:
        self.folder = folder
        self._upload_of = upload_of
        self._scratch = scratch
        self._lock = RLock()  # the files of a folder are read by one thread at a time
        self.object = lru_cache(OBJECTS_KEPT)(self._read_object)
        self.radiographs = lru_cache(OBJECTS_KEPT)(self._draw_radiographs)

    @property
    def splits(self) -> tuple[str, ...]:
        """Splits that have objects with answers, those for testing first."""
        splits = (name for name in self.folder.manifest.splits if name != PRIVATE)
        found = [name for name in splits if self.folder.ids(name)]
        return tuple(sorted(found, key=lambda name: ("train" in name, name)))

    def methods(self, entries: tuple[Entry, ...], split: str) -> dict[str, Entry]:
        """Entries of densities on a split of this very dataset, by a label that tells them apart.

        None of the split private: the score of an object tells its answer.
        """
        return {
            f"{row['method']['name']} · {row['track']} · {row['target']} · "
            f"{row['protocol']} · {row['submission_sha256'][:8]}": row
            for row in entries
            if row["dataset"]["manifest_sha256"] == self.folder.manifest_sha256
            and row["dataset"]["split"] == split != PRIVATE
            and row["target"] in get_args(Target)
        }

    def stored(self, row: Entry) -> bool:
        """Whether the file of an entry is at hand."""
        return self._upload_of(row["submission_sha256"]) is not None

    def fields(self, object_id: str, row: Entry | None) -> Fields:
        """Return truth and prediction; the target is the method's, or what the object has.

        Raises
        ------
        DataError
            If the object has no value for the target, or the file does not hold the object.
        """
        obj = self.object(object_id)
        known: Target = "density" if obj.density else "apparent_density"
        target: Target = row["target"] if row else known
        truth = obj.density if target == "density" else obj.apparent_density
        if truth is None:
            raise DataError(f"{object_id} has no density, only attenuation")
        return Fields(obj, target, truth, self._guess(obj, row))

    def slices(
        self, fields: Fields, axis: int, index: int
    ) -> tuple[Picture, Picture | None, Picture | None]:
        """Draw a plane of truth, prediction and error; the last two if there is a prediction."""
        field, label = fields.truth, f"{fields.target.replace('_', ' ')}, g/cm³"
        outside = np.take(fields.obj.envelope, index, axis=axis) == 0

        def draw(grid: Grid, scale: ScalarMappable, title: str, label: str) -> Picture:
            plane = np.where(outside, np.nan, np.take(grid, index, axis=axis))
            where = (axis, field.origin_cm, field.voxel_size_cm, fields.limits_cm)
            return figures.slice_picture(plane, *where, scale, title, label)

        truth = draw(field.density_g_cm3, fields.scale, "truth", label)
        if fields.guess is None or fields.error is None:
            return truth, None, None
        signed = figures.signed_scale(fields.error_limit)
        return (
            truth,
            draw(fields.guess, fields.scale, "prediction", label),
            draw(-fields.error, signed, "error", "truth - prediction, g/cm³"),
        )

    def model(self, fields: Fields, colour: Colour, cut: bool) -> tuple[Path, Picture]:
        """Write the 3D model and draw its colour bar.

        Parameters
        ----------
        fields
            The object.
        colour
            ``error`` falls to ``density`` where there is no prediction; the bar says which it is.
        cut
            Whether to take the half in front of the centre of mass away.

        Raises
        ------
        DataError
            If a part to be cut is not closed.
        """
        obj = fields.obj
        meshes = [part.mesh for part in obj.parts]
        if cut:
            centre = obj.com_cm if np.isfinite(obj.com_cm).all() else fields.truth.com_cm
            meshes = glb.cut_open(meshes, float(centre[1]))
        if colour == "error" and fields.error is not None:
            meshes = [glb.refined(mesh, obj.voxel_size_cm) for mesh in meshes]
            size = np.abs(fields.error)
            where = (fields.truth.origin_cm, fields.truth.voxel_size_cm)
            values = [glb.surface_values(mesh, size, *where) for mesh in meshes]
            scale = figures.error_scale(fields.error_limit)
            label = "size of the error half a voxel below the surface, g/cm³"
        else:
            values, scale, label = _part_colours(obj.parts, meshes, colour)
        shown = [glb.vertex_colours(one, scale) for one in values]
        name = f"{obj.object_id}|{colour}|{cut}|{fields.error_limit}"
        path = self._scratch / f"{hashlib.sha256(name.encode()).hexdigest()[:16]}.glb"
        glb.write_glb(path, obj.parts, meshes, shown)
        self._forget_old_models()
        return path, figures.bar_picture(scale, label)

    def parts(self, object_id: str) -> Rows:
        """Rows of the part table, under :data:`PART_HEADINGS`."""
        return [
            [
                part.name,
                part.material or "unknown",
                *map(_number, (part.density_g_cm3, part.density_sd_g_cm3, part.lac_per_cm)),
                _number(part.mesh.volume),
                part.density_source,
                ", ".join(part.flags),
            ]
            for part in self.object(object_id).parts
        ]

    def _read_object(self, object_id: str) -> DensityObject:
        with self._lock:
            return self.folder.object(object_id)

    def _draw_radiographs(self, object_id: str) -> tuple[Picture, ...]:
        """Measured, reprojected and residual of PA, then of LAT."""
        obj = self.object(object_id)
        return tuple(
            picture
            for view in obj.views
            for picture in figures.radiograph_pictures(
                compare(obj, view), obj.source, view.name.upper()
            )
        )

    def _guess(self, obj: DensityObject, row: Entry | None) -> Grid | None:
        path = self._upload_of(row["submission_sha256"]) if row else None
        if path is None:
            return None
        with open_predictions(path) as found:
            values = found.read(obj.object_id)
        if values.ndim == 3:
            return values
        meshes = [part.mesh for part in obj.parts]
        return grid_of_parts(values, part_shares(meshes, obj.origin_cm, obj.voxel_size_cm))

    def _forget_old_models(self) -> None:
        with self._lock:
            models = sorted(self._scratch.glob("*.glb"), key=lambda path: path.stat().st_mtime_ns)
            for path in models[:-MODELS_KEPT]:
                path.unlink()


def best_and_worst(row: Entry, metric: str, results: Path, most: int = 5) -> tuple[Rows, Rows]:
    """Objects that a method does best and worst on: id, category, longest edge, value.

    Parameters
    ----------
    row
        The entry.
    metric
        One of its metrics.
    results
        Folder of the entries: the objects lie beside the entry, as Parquet.
    most
        Objects in each list; none is in both.
    """
    path = (results / entry_path(row)).with_suffix(".parquet")
    columns = ["object_id", "category", "extent_cm", metric]
    found = pq.read_table(path, columns=columns).to_pylist()
    found = [one for one in found if one[metric] is not None]
    losses = METRICS[metric].loss(np.array([one[metric] for one in found], dtype=np.float64))
    order = sorted(range(len(found)), key=lambda at: (losses[at], found[at]["object_id"]))
    rows = [
        [one["object_id"], one["category"], _number(one["extent_cm"]), _number(one[metric])]
        for one in (found[place] for place in order)
    ]
    half = len(rows) - len(rows) // 2
    return rows[: min(most, half)], rows[max(half, len(rows) - most) :][::-1]


def _part_colours(
    parts: tuple[Part, ...], meshes: list[Any], colour: Colour
) -> tuple[list[np.ndarray], ScalarMappable, str]:
    """Values at the vertices, colours and title for a quantity of whole parts."""
    spread = colour == "density sd"
    of_parts = glb.part_values(parts, "density_sd_g_cm3" if spread else "density_g_cm3")
    known = of_parts[np.isfinite(of_parts)]
    scale = figures.density_scale(float(known.max()) if len(known) else 0.0)
    values = [np.full(len(mesh.vertices), one) for mesh, one in zip(meshes, of_parts, strict=True)]
    title = "standard deviation of the density" if spread else "density of the parts"
    return (
        values,
        scale,
        f"{title}, g/cm³" + ("" if len(known) == len(parts) else "; grey: unknown"),
    )


def _number(value: float) -> float | None:
    return float(f"{value:.4g}") if np.isfinite(value) else None
