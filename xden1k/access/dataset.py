"""The dataset for torch; the only module here that imports it."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch.utils.data import Dataset

from xden1k.access.hub import data_root
from xden1k.errors import DataError
from xden1k.folder import DatasetFolder
from xden1k.format.records import decode_array
from xden1k.format.schema import ARRAY_COLUMNS
from xden1k.format.shards import Row
from xden1k.values.types import FIELD_SIZE, DensityObject

__all__ = ["FIELDS", "RAGGED_FIELDS", "XDen1K", "collate"]

FIELDS = (
    *("object_id", "category", "xray_pa", "xray_lat", "density", "apparent_density"),
    *("occupancy", "envelope", "labels", "part_density", "mesh_vertices", "mesh_faces"),
    *("face_part", "grid_origin_cm", "voxel_size_cm", "mass_g", "com_cm"),
)
"""What a sample may hold."""
RAGGED_FIELDS = frozenset({"part_density", "mesh_vertices", "mesh_faces", "face_part"})
"""Fields whose size is the object's own; :func:`collate` keeps them as lists."""
_NAMES = ("object_id", "category")


class XDen1K(Dataset[dict[str, Any]]):
    """Objects of one split as torch samples.

    A sample is a dict of

    - ``object_id``, ``category``: str;
    - ``xray_pa``, ``xray_lat``: float32 (rows, columns), transmission; 0 = invalid pixel;
    - ``density``, ``apparent_density``: float32 (64, 64, 64), g/cm³, voxel means; ``density`` is
      not a number where only attenuation is known, both are in the split ``private``;
    - ``occupancy``, ``envelope``: float32 (64, 64, 64), shares of a voxel, 0 to 1;
    - ``labels``: uint8 (128, 128, 128), 0 = air, k = part k;
    - ``part_density``: float32 (K + 1), g/cm³, entry 0 is air;
    - ``mesh_vertices`` float32 (V, 3), cm; ``mesh_faces`` int32 (F, 3); ``face_part`` uint8 (F);
    - ``grid_origin_cm``, ``com_cm``: float32 (3); ``voxel_size_cm``, ``mass_g``: float32, 0-d.

    Rows are read one at a time, and of a row only what the fields need. Any start method of
    ``DataLoader`` workers will do.

    Parameters
    ----------
    root
        A dataset folder; None = as :func:`xden1k.data_root` finds it.
    split
        ``train``, ``val``, ``test``, or ``private`` where a folder withholds answers.
    fields
        What a sample holds, some of :data:`FIELDS`; None = everything.

    Raises
    ------
    DataError
        If there is no such folder, split or field.
    """

    def __init__(
        self,
        root: str | os.PathLike[str] | None = None,
        split: str = "train",
        fields: Sequence[str] | None = None,
    ) -> None:
        self.fields = FIELDS if fields is None else tuple(fields)
        if unknown := sorted(set(self.fields) - set(FIELDS)):
            raise DataError(f"unknown fields {unknown}; there are {list(FIELDS)}")
        self.split = split
        self.folder = DatasetFolder(data_root(root))
        self.ids = self.folder.ids(split)
        self._columns = list(dict.fromkeys(c for name in self.fields for c in _columns(name)))

    def __len__(self) -> int:
        return len(self.ids)

    def __getitem__(self, index: int) -> dict[str, Any]:
        row = self.folder.row(self.ids[index], self._columns)
        return {name: _value(row, name) for name in self.fields}

    def object(self, object_id: str) -> DensityObject:
        """Return one object, of any split: views, parts with their meshes, fields.

        Raises
        ------
        MissingObjectError
            If there is no such object.
        """
        return self.folder.object(object_id)


def _columns(name: str) -> tuple[str, ...]:
    """Return the columns a field is made of."""
    if name == "part_density":
        return ("part_density_g_cm3",)
    codec = ARRAY_COLUMNS.get(name)
    return (name, codec.shape) if codec and isinstance(codec.shape, str) else (name,)


def _value(row: Row, name: str) -> str | torch.Tensor:
    if name in _NAMES:
        return str(row[name])
    if name == "part_density":
        return torch.tensor([0.0, *row["part_density_g_cm3"]])
    if name in ("density", "apparent_density") and row[name] is None:
        return torch.full((FIELD_SIZE,) * 3, np.nan)
    if name in ARRAY_COLUMNS:
        return torch.from_numpy(decode_array(row, name))
    return torch.tensor(row[name], dtype=torch.float32)


def collate(samples: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Join samples to a batch, for ``DataLoader(..., collate_fn=xden1k.collate)``.

    Tensors are stacked along a new first axis. Names, meshes and part densities become lists, and
    so do radiographs if their sizes differ.
    """
    return {
        name: _joined(name, [sample[name] for sample in samples]) for name in (samples or [{}])[0]
    }


def _joined(name: str, values: list[Any]) -> Any:
    if name in _NAMES or name in RAGGED_FIELDS:
        return values
    same = all(value.shape == values[0].shape for value in values)
    return torch.stack(values) if same else values
