"""Work files: finished objects kept between runs, one HDF5 file each.

A work file holds one encoded dataset row and the digest of everything it was made from. It is
written under another name and renamed, so that it is there whole or not at all; an older digest
means that inputs, settings or the builder have changed, and the object is made again.
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
DAMAGE = (OSError, KeyError, ValueError, TypeError, AttributeError, RuntimeError)
"""What reading no file, a file that is none of ours, or a damaged one may raise in h5py."""


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
        file.attrs.update(schema=SCHEMA, digest=digest, columns=list(row), content=_content(row))
        file.attrs["complete"] = True
    os.replace(partial, path)


def load_row(path: Path, digest: str) -> dict[str, Any] | None:
    """Read a kept row.

    Returns
    -------
    dict or None
        The row with its columns in their order; None if there is no such file, it is of another
        digest, or it is not whole.
    """
    try:
        with h5py.File(path, "r") as file:
            if not file.attrs.get("complete") or file.attrs["digest"] != digest:
                return None
            light = json.loads(file["light"][()])
            binary = {name: values[()].tobytes() for name, values in file["binary"].items()}
            row = {name: (light | binary)[name] for name in file.attrs["columns"]}
            return row if file.attrs["content"] == _content(row) else None
    except DAMAGE:
        return None


def _content(row: Mapping[str, Any]) -> str:
    """Checksum of the values of a row."""
    digest = hashlib.sha256()
    for name, value in row.items():
        data = value if isinstance(value, bytes) else json.dumps(value).encode()
        digest.update(f"{name} {len(data)} ".encode() + data)
    return digest.hexdigest()
