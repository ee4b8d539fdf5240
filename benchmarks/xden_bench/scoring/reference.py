"""The truth that submissions are compared with, read object by object from a dataset folder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Final

import numpy as np
import trimesh

from xden1k.errors import DataError
from xden1k.folder import DatasetFolder
from xden1k.format.records import decode_array, decode_target, split_meshes
from xden1k.format.shards import Row
from xden1k.predictions import Target
from xden1k.values.arrays import Grid, Vec3
from xden1k.values.types import PRIVATE

__all__ = [
    "BY_ORGANISER",
    "RECOMPUTED",
    "SELF_REPORTED",
    "Reference",
    "Truth",
    "private_refusal",
    "xray_refusal",
]

RECOMPUTED: Final = "recomputed"
SELF_REPORTED: Final = "self-reported"
BY_ORGANISER: Final = "by the organiser"
"""Who made the numbers of an entry: a maintainer who remade them, whoever sent it, or the keeper of
sealed answers."""


def private_refusal(split: str) -> str:
    """Why segments of a split cannot be scored; empty where they can."""
    if split != PRIVATE:
        return ""
    return (
        f"segments of the split {PRIVATE} cannot be scored: its part meshes and labels are public, "
        "so nothing about it is sealed; score test or unseen"
    )


def xray_refusal(folder: DatasetFolder, split: str) -> str:
    """Why a split cannot be in the track ``xray``; empty where every object has radiographs."""
    if not (without := folder.manifest.without_radiographs.get(split, 0)):
        return ""
    return (
        f"the track 'xray' needs radiographs, {without} of {folder.manifest.splits[split]} objects "
        f"of the split {split!r} have none"
    )


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """What is known of one object.

    Parameters
    ----------
    object_id, category, source
        As in the dataset.
    density_g_cm3
        Shape (64, 64, 64): the target, voxel means; it has mass.
    envelope
        Shape (64, 64, 64), 0 to 1: share of the voxel inside the outer surface.
    origin_cm
        Shape (3,): centre of voxel (0, 0, 0).
    voxel_size_cm
        Edge of a voxel.
    parts
        Number of parts.
    """

    object_id: str
    category: str
    source: str
    density_g_cm3: Grid
    envelope: Grid
    origin_cm: Vec3
    voxel_size_cm: float
    parts: int

    @property
    def extent_cm(self) -> float:
        """Longest edge of the bounding box of the outer surface, to a voxel."""
        inside = self.envelope > 0
        spans = [
            np.flatnonzero(inside.any(axis=axes))[[0, -1]] for axes in ((1, 2), (0, 2), (0, 1))
        ]
        return float(max(last - first + 1 for first, last in spans) * self.voxel_size_cm)


@dataclass(frozen=True, eq=False)
class Reference:
    """One split of a dataset folder as the truth.

    Parameters
    ----------
    folder
        The dataset.
    split
        One of its splits.

    Raises
    ------
    DataError
        If the folder has no such split, or its answers are withheld.
    """

    folder: DatasetFolder
    split: str

    can_be_private: ClassVar[bool] = False
    """Whether this class knows what to do without the folder's answers."""
    status: ClassVar[str] = SELF_REPORTED
    """What an entry says of its numbers: who made them."""

    def __post_init__(self) -> None:
        if self.split == PRIVATE and not self.can_be_private:
            raise DataError(
                f"{self.folder.root}: the answers of the split {PRIVATE} are sealed: scoring needs "
                "the organiser's sealed truth and key"
            )
        if not self.ids:
            raise DataError(f"{self.folder.root}: the split {self.split} is empty")

    @cached_property
    def ids(self) -> tuple[str, ...]:
        """Every object that has to be predicted, sorted."""
        return tuple(sorted(self.folder.ids(self.split)))

    @property
    def revision(self) -> str:
        """The data's version."""
        return self.folder.manifest.version

    @property
    def manifest_sha256(self) -> str:
        """Checksum of the manifest, which holds those of all files."""
        return self.folder.manifest_sha256

    def truth(self, object_id: str, target: Target = "density") -> Truth:
        """Read one object.

        Raises
        ------
        DataError
            If it has no value for the target, or no mass.
        """
        names = ["category", "source", "grid_origin_cm", "voxel_size_cm", "part_names"]
        row = self._row(object_id, [*names, target, "envelope"])
        density = decode_target(row, object_id, target)
        if not density.any():
            raise DataError(f"{object_id} has no mass in {target}: it cannot be scored")
        return Truth(
            object_id=object_id,
            category=row["category"],
            source=row["source"],
            density_g_cm3=density,
            envelope=decode_array(row, "envelope"),
            origin_cm=np.array(row["grid_origin_cm"], dtype=np.float64),
            voxel_size_cm=row["voxel_size_cm"],
            parts=len(row["part_names"]),
        )

    def part_meshes(self, object_id: str) -> list[trimesh.Trimesh]:
        """Read the closed mesh of each part, cm."""
        columns = ["mesh_vertices", "mesh_faces", "face_part", "part_names"]
        return split_meshes(self._row(object_id, columns))

    def _row(self, object_id: str, columns: Sequence[str]) -> Row:
        return self.folder.row(object_id, columns)
