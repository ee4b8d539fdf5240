"""Work files: finished objects kept between runs, one HDF5 file each.

A work file holds one encoded dataset row. Beside it stands a seal: the checksum of everything the
row was made from, and that of the file itself. An older one means that inputs, settings or the
builder have changed; a file that does not match its seal is damaged, or was never finished (and
HDF5 may not even return from reading it). Either way the object is made again.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

__all__ = ["load_row", "save_row"]

SCHEMA = "xden-work/1"


def save_row(path: Path, digest: str, row: Mapping[str, Any]) -> None:
    """Keep one encoded row.

    Parameters
    ----------
    path
        The work file; its folder must exist.
    digest
        Of all inputs, settings and the builder's version.
    row
        Columns of the dataset; binary ones as ``bytes``, the rest of JSON's types.
    """
    for stale in path.parent.glob(f"{path.name}.*.partial"):  # of runs that were killed
        stale.unlink(missing_ok=True)
    partial = path.with_name(f"{path.name}.{os.getpid()}.partial")
    with h5py.File(partial, "w", libver="latest") as file:
        binary = file.create_group("binary")
        for name, value in row.items():
            if isinstance(value, bytes):
                values = np.frombuffer(value, dtype=np.uint8)
                binary.create_dataset(name, data=values, compression="gzip", compression_opts=1)
        light = {name: value for name, value in row.items() if not isinstance(value, bytes)}
        file.create_dataset("light", data=json.dumps(light))
        file.attrs.update(schema=SCHEMA, digest=digest, columns=list(row))
    seal = _seal(partial, digest)
    os.replace(partial, path)
    partial.write_text(seal)
    os.replace(partial, _seal_path(path))


def load_row(path: Path, digest: str) -> dict[str, Any] | None:
    """Read a kept row.

    Returns
    -------
    dict or None
        The row with its columns in their order; None if there is no such file, it is of another
        digest, or it is damaged.
    """
    if not path.is_file() or not _seal_path(path).is_file():
        return None
    if _seal_path(path).read_bytes() != _seal(path, digest).encode():
        return None
    with h5py.File(path, "r") as file:
        light = json.loads(file["light"][()])
        binary = {name: values[()].tobytes() for name, values in file["binary"].items()}
        return {name: (light | binary)[name] for name in file.attrs["columns"]}


def _seal_path(path: Path) -> Path:
    return path.with_suffix(".seal")


def _seal(path: Path, digest: str) -> str:
    """Checksums of a file's origin and of its bytes."""
    with path.open("rb") as stream:
        content = hashlib.file_digest(stream, "sha256").hexdigest()
    return f"{digest}\n{content}\n"
