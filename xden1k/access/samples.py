"""What a method may see: a sample of the dataset, and those that it learns from."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol, runtime_checkable

import numpy as np
import trimesh

from xden1k.errors import DataError
from xden1k.folder import DatasetFolder
from xden1k.format.records import decode_array, decode_target
from xden1k.predictions import Target
from xden1k.values.arrays import Grid, Labels, Vec3
from xden1k.values.modality import Modality, ModalityError
from xden1k.values.types import DensityObject
from xden1k.values.views import XRayView

__all__ = ["Example", "Examples", "PictureSource", "SampleView"]


@runtime_checkable
class PictureSource(Protocol):
    """Where colour pictures come from: a folder of them, or a renderer.

    Found by the entry-point group ``xden1k.pictures``: ``scenes`` is called with a folder, any
    other, such as ``flat``, without arguments. It may be :class:`xden1k.predictor.Fingerprinted`.
    """

    @property
    def description(self) -> str:
        """What the row must say of them, such as ``12 views rendered in part colours``."""
        ...

    def __call__(self, folder: DatasetFolder, object_id: str) -> Any:
        """Return pictures, masks, depth and cameras of an object, and nothing else of it.

        Raises
        ------
        DataError
            If there are none.
        """
        ...


@dataclass(frozen=True, eq=False)
class SampleView:
    """An object as a method may see it: only the modalities it declared, read when touched.

    Density, attenuation and mass are on none. Without ``PARTS`` the outer surface and the envelope
    are all there is of the geometry: labels, occupancy and inner meshes would give cavities away.
    The grid itself (``origin_cm``, ``voxel_size_cm``) is open to all. Colour pictures are not in
    the dataset: they come from a source, by ``object_id``.

    Parameters
    ----------
    folder
        The dataset.
    object_id
        One of its objects.
    reads
        What the method declared.
    pictures_of
        Where colour pictures come from, if there are any.
    target
        What is to be predicted: ``density`` or ``apparent_density``.
    """

    folder: DatasetFolder
    object_id: str
    reads: Modality
    pictures_of: PictureSource | None = None
    target: Target = "density"

    @cached_property
    def origin_cm(self) -> Vec3:
        """Shape (3,): centre of field voxel (0, 0, 0), object frame."""
        origin: Vec3 = np.array(self._row("grid_origin_cm")["grid_origin_cm"], dtype=np.float64)
        return origin

    @cached_property
    def voxel_size_cm(self) -> float:
        """Edge of a field voxel."""
        return float(self._row("voxel_size_cm")["voxel_size_cm"])

    @cached_property
    def category(self) -> str:
        """The category's name. Needs ``CATEGORY``."""
        self._need(Modality.CATEGORY, "category")
        return str(self._row("category")["category"])

    @cached_property
    def envelope(self) -> Grid:
        """Shape (64, 64, 64), 0 to 1: share inside the outer surface. Needs ``GEOMETRY``."""
        self._need(Modality.GEOMETRY, "envelope")
        return self._array("envelope")

    @cached_property
    def outer_mesh(self) -> trimesh.Trimesh:
        """The closed outer surface, cm. Needs ``GEOMETRY``, and the extra ``build``."""
        self._need(Modality.GEOMETRY, "outer_mesh")
        from xden1k.rays.regions import outer_surface

        return outer_surface([part.mesh for part in self._object.parts])

    @cached_property
    def part_meshes(self) -> tuple[trimesh.Trimesh, ...]:
        """One closed mesh for each part, cm. Needs ``PARTS``."""
        self._need(Modality.PARTS, "part_meshes")
        return tuple(part.mesh for part in self._object.parts)

    @cached_property
    def part_names(self) -> tuple[str, ...]:
        """Name of each part. Needs ``PARTS``."""
        self._need(Modality.PARTS, "part_names")
        return tuple(self._row("part_names")["part_names"])

    @cached_property
    def part_materials(self) -> tuple[str, ...]:
        """Material or family of each part, empty = unknown. Needs ``MATERIALS``."""
        self._need(Modality.MATERIALS, "part_materials")
        return tuple(self._row("part_materials")["part_materials"])

    @cached_property
    def labels(self) -> Labels:
        """Shape (128, 128, 128): 0 = air, k = part k. Needs ``PARTS``."""
        self._need(Modality.PARTS, "labels")
        return self._array("labels")

    @cached_property
    def occupancy(self) -> Grid:
        """Shape (64, 64, 64), 0 to 1: share filled with material. Needs ``PARTS``."""
        self._need(Modality.PARTS, "occupancy")
        return self._array("occupancy")

    @cached_property
    def views(self) -> tuple[XRayView, XRayView]:
        """The radiographs ``pa`` and ``lat``. Needs ``XRAY``.

        Raises
        ------
        DataError
            If the object has none.
        """
        self._need(Modality.XRAY, "views")
        if not self._object.views:
            raise DataError(f"{self.object_id} has no radiographs")
        return self._object.views

    @cached_property
    def pictures(self) -> Any:
        """What the source has of the object: pictures, masks, depth, cameras. Needs ``RGB``.

        Raises
        ------
        DataError
            If there is no source, or it has none of this object.
        """
        self._need(Modality.RGB, "pictures")
        if self.pictures_of is None:
            raise DataError(
                f"{self.object_id}: the dataset has no colour pictures and no source of them is "
                "given: name a folder of scenes (--views DIR) or install a renderer"
            )
        return self.pictures_of(self.folder, self.object_id)

    @cached_property
    def truth(self) -> DensityObject:
        """Everything known of the object, its density first. Needs ``TRUTH``: for oracles."""
        self._need(Modality.TRUTH, "truth")
        return self._object

    def _need(self, modality: Modality, what: str) -> None:
        if modality not in self.reads:
            raise ModalityError(
                f"{self.object_id}: {what} needs the modality {modality.name}, "
                f"but the method declares {list(self.reads.inputs)}"
            )

    def _array(self, column: str) -> np.ndarray:
        return decode_array(self._row(column), column)

    def _row(self, column: str) -> Mapping[str, Any]:
        return self.folder.row(self.object_id, [column])

    @cached_property
    def _object(self) -> DensityObject:
        return self.folder.object(self.object_id)


@dataclass(frozen=True, slots=True, eq=False)
class Example:
    """What a method learns from.

    Parameters
    ----------
    sample
        What it may see.
    density_g_cm3
        Shape (64, 64, 64): the target, voxel means.
    """

    sample: SampleView
    density_g_cm3: Grid

    @property
    def truth(self) -> DensityObject:
        """Everything known of a training object: materials, labels, part densities."""
        return self.sample.folder.object(self.sample.object_id)


@dataclass(frozen=True, eq=False)
class Examples:
    """Objects of a split to learn from. Can be gone through again; one in memory at a time.

    Parameters
    ----------
    folder
        The dataset.
    split
        One of its splits.
    reads
        What the method declared.
    target
        ``density`` or ``apparent_density``.
    pictures_of
        Where colour pictures come from, if there are any.
    ids
        Its objects, in this order; None for the whole split.
    """

    folder: DatasetFolder
    split: str
    reads: Modality
    target: Target = "density"
    pictures_of: PictureSource | None = None
    ids: tuple[str, ...] | None = None

    def __len__(self) -> int:
        return len(self._ids)

    def __iter__(self) -> Iterator[Example]:
        yield from self.only(range(len(self)))

    def only(self, numbers: Iterable[int]) -> Iterator[Example]:
        """Go through some of them, in their order; no other is read.

        Parameters
        ----------
        numbers
            Their places, from 0.
        """
        ids = self._ids
        for object_id in [ids[number] for number in sorted(set(numbers))]:
            row = self.folder.row(object_id, [self.target])
            sample = SampleView(self.folder, object_id, self.reads, self.pictures_of, self.target)
            yield Example(sample, decode_target(row, object_id, self.target))

    @property
    def _ids(self) -> tuple[str, ...]:
        return self.folder.ids(self.split) if self.ids is None else self.ids
