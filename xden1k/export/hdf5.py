"""HDF5: the arrays of many objects, stacked along the first axis, as ``datasets`` reads them.

One dataset for each column, one row for each object, in the dataset's units (cm, g):
``load_dataset("hdf5", data_files="objects.h5")``. Groups for each object or attributes it would not
read. What differs in size from object to object has rows of variable length, flat: vertices and
faces are ``reshape(-1, 3)``; lists of words are JSON.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np

from xden1k.errors import DataError, MissingExtraError
from xden1k.export.arrays import arrays_of, of_arrays
from xden1k.export.body import Body
from xden1k.export.si import Inertial
from xden1k.values.types import DensityObject

__all__ = ["SUFFIX", "check", "expected", "read", "rows", "rows_by_datasets", "stack", "write"]

SUFFIX: Final = ".h5"
VARIABLE: Final = ("mesh_vertices", "mesh_faces", "face_part")
"""Beside every column that starts with ``part_``."""
CHUNK: Final = 256
"""Rows of a column of single values that are stored together."""
BATCH: Final = 8
"""Rows that ``datasets`` holds at a time; by its default, the whole file."""


def stack(objects: Iterable[DensityObject], path: Path) -> int:
    """Write a file of many objects, one at a time.

    Parameters
    ----------
    objects
        All with radiographs of one size, or all without.
    path
        The ``.h5``.

    Returns
    -------
    int
        How many there were.

    Raises
    ------
    DataError
        If an object cannot be stacked on the first.
    """
    count = 0
    with h5py.File(path, "w", libver="latest") as file:
        for obj in objects:
            arrays = arrays_of(obj)
            if count and (odd := sorted(arrays.keys() ^ file.keys())):
                raise DataError(
                    f"{obj.object_id}: it and those before it do not both have {', '.join(odd)}: "
                    "only objects that all have radiographs, or none, can be stacked"
                )
            for name, values in arrays.items():
                _append(file, obj.object_id, name, values, count)
            count += 1
    return count


def _append(file: h5py.File, object_id: str, name: str, values: np.ndarray, row: int) -> None:
    value, kind = _stackable(name, values)
    shape = () if h5py.check_vlen_dtype(kind) is not None else np.shape(value)
    if name not in file:
        packed = {"compression": "gzip", "shuffle": True} if shape else {}
        chunk = (1, *shape) if shape else (CHUNK,)
        all_rows = {"maxshape": (None, *shape), "chunks": chunk}
        file.create_dataset(name, (0, *shape), kind, **all_rows, **packed)
    column = file[name]
    if column.shape[1:] != shape:
        raise DataError(
            f"{object_id}: its {name} has shape {shape}, those before it {column.shape[1:]}: "
            "only equal shapes can be stacked"
        )
    column.resize(row + 1, axis=0)
    column[row] = value


def _stackable(name: str, values: np.ndarray) -> tuple[Any, np.dtype[Any]]:
    """Return a value and the type of its column."""
    if values.dtype.kind == "U":
        text = str(values) if values.ndim == 0 else json.dumps(values.tolist(), ensure_ascii=False)
        return text, h5py.string_dtype()
    if name in VARIABLE or name.startswith("part_"):
        return values.reshape(-1), h5py.vlen_dtype(values.dtype)
    return values, values.dtype


def write(body: Body, path: Path) -> None:
    """Write one object."""
    stack([body.obj], path)


def expected(body: Body) -> Inertial:
    """Return what a reader should find."""
    return body.inertial


def read(path: Path, body: Body) -> Inertial:
    """Integrate the meshes of this object's row.

    Raises
    ------
    DataError
        If there is none.
    """
    return _of(body, path, rows(path))


def check(path: Path, body: Body) -> Inertial:
    """Read with the module of ``datasets``, and integrate the meshes of this object's row.

    Raises
    ------
    DataError
        If there is none.
    """
    return _of(body, path, rows_by_datasets(path))


def _of(body: Body, path: Path, found: Iterable[tuple[str, Inertial]]) -> Inertial:
    for object_id, inertial in found:
        if object_id == body.obj.object_id:
            return inertial
    raise DataError(f"{path}: no object {body.obj.object_id}")


def rows(path: Path) -> Iterator[tuple[str, Inertial]]:
    """Ids of all rows, and what their meshes integrate to."""
    names = (*VARIABLE, "part_density_g_cm3")
    with h5py.File(path) as file:
        for row, object_id in enumerate(file["object_id"].asstr()[:]):
            yield object_id, of_arrays({name: file[name][row] for name in names})


def rows_by_datasets(path: Path) -> Iterator[tuple[str, Inertial]]:
    """Give the same as the ``hdf5`` module of ``datasets`` reads it.

    Raises
    ------
    MissingExtraError
        If this version of ``datasets`` has none.
    """
    try:
        from datasets.packaged_modules.hdf5.hdf5 import HDF5
    except ModuleNotFoundError as err:
        raise MissingExtraError(
            "datasets reads HDF5 from 4.1 on: pip install --upgrade datasets"
        ) from err
    from datasets.utils import (
        are_progress_bars_disabled,
        disable_progress_bars,
        enable_progress_bars,
    )

    with tempfile.TemporaryDirectory() as cache:
        builder = HDF5(cache_dir=cache, data_files=str(path), batch_size=BATCH)
        shown = not are_progress_bars_disabled()
        disable_progress_bars()
        builder.download_and_prepare()
        if shown:
            enable_progress_bars()
        for row in builder.as_dataset(split="train").with_format("numpy"):
            yield str(row["object_id"]), of_arrays(row)
