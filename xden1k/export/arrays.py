"""An object as arrays, under the names of the dataset's columns and in their units."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import trimesh

from xden1k.export.si import Inertial
from xden1k.format.records import decode_array, object_row
from xden1k.format.schema import ARRAY_COLUMNS, COLUMNS, PREVIEW_COLUMNS, RADIOGRAPH_COLUMNS
from xden1k.values.mass import mass_of_meshes
from xden1k.values.types import FIELD_SIZE, DensityObject

__all__ = ["arrays_of", "of_arrays"]

RAGGED: Final = ("part_flags",)
"""Lists of lists: as JSON."""


def arrays_of(obj: DensityObject) -> dict[str, np.ndarray]:
    """Decode what the dataset stores of an object, previews left out.

    Values are those of the dataset, in its precision. A weight or a field that there is none of is
    not a number; ``part_flags`` is JSON. Radiographs that there are none of are left out.
    """
    row = object_row(obj)
    left_out = PREVIEW_COLUMNS if obj.views else RADIOGRAPH_COLUMNS
    return {
        column.name: _array(row, column.name) for column in COLUMNS if column.name not in left_out
    }


def _array(row: Mapping[str, Any], name: str) -> np.ndarray:
    value = row[name]
    if name in ARRAY_COLUMNS:
        if value is None:
            return np.full((FIELD_SIZE,) * 3, np.nan, dtype=np.float32)
        return decode_array(row, name)
    if name in RAGGED:
        return np.array(json.dumps(value, ensure_ascii=False))
    if value is None:
        return np.array(np.nan)
    return np.array(value, dtype=np.str_) if value == [] else np.array(value)


def of_arrays(arrays: Mapping[str, np.ndarray]) -> Inertial:
    """Integrate meshes and densities of such arrays.

    Raises
    ------
    KeyError
        If one is missing.
    """
    vertices = np.asarray(arrays["mesh_vertices"], dtype=np.float64).reshape(-1, 3)
    faces, owner = arrays["mesh_faces"].reshape(-1, 3), arrays["face_part"]
    densities = [float(value) for value in arrays["part_density_g_cm3"]]
    meshes = [
        trimesh.Trimesh(vertices, faces[owner == part], process=False)
        for part in range(1, len(densities) + 1)
    ]
    return Inertial.of(mass_of_meshes(meshes, densities))
