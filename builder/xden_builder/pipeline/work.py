"""Work files: finished objects kept between runs, one HDF5 file each.

A work file holds one encoded dataset row. Beside it stands a seal: the checksum of everything the
row was made from, and that of the file itself. An older one means that inputs, settings or the
builder have changed; a file that does not match its seal is damaged, or was never finished (and
HDF5 may not even return from reading it). Either way the object is made again.

HDF5 works in memory here: then a full disk is an error of one plain write, and a URL is as good as
a path.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Mapping
from typing import Any

import h5py
import numpy as np

from xden_builder.pipeline.storage import Place, inside, read_bytes, write_bytes

__all__ = ["load_row", "save_row"]

SCHEMA = "xden-work/1"


def save_row(folder: Place, object_id: str, digest: str, row: Mapping[str, Any]) -> None:
    """Keep one encoded row.

    Parameters
    ----------
    folder
        Of the work files; it must exist.
    object_id
        Names the file.
    digest
        Of all inputs, settings and the builder's version.
    row
        Columns of the dataset; binary ones as ``bytes``, the rest of JSON's types.
    """
    stream = io.BytesIO()
    with h5py.File(stream, "w", libver="latest") as file:
        binary = file.create_group("binary")
        for name, value in row.items():
            if isinstance(value, bytes):
                values = np.frombuffer(value, dtype=np.uint8)
                binary.create_dataset(name, data=values, compression="gzip", compression_opts=1)
        light = {name: value for name, value in row.items() if not isinstance(value, bytes)}
        file.create_dataset("light", data=json.dumps(light))
        file.attrs.update(schema=SCHEMA, digest=digest, columns=list(row))
    content = stream.getvalue()
    write_bytes(inside(folder, f"{object_id}.h5"), content)
    write_bytes(inside(folder, f"{object_id}.seal"), _seal(digest, content))


def load_row(folder: Place, object_id: str, digest: str) -> dict[str, Any] | None:
    """Read a kept row.

    Returns
    -------
    dict or None
        The row with its columns in their order; None if there is no such file, it is of another
        digest, or it is damaged.
    """
    seal = read_bytes(inside(folder, f"{object_id}.seal"))
    if seal is None or not seal.startswith(digest.encode()):
        return None
    content = read_bytes(inside(folder, f"{object_id}.h5"))
    if content is None or seal != _seal(digest, content):
        return None
    with h5py.File(io.BytesIO(content), "r") as file:
        light = json.loads(file["light"][()])
        binary = {name: values[()].tobytes() for name, values in file["binary"].items()}
        return {name: (light | binary)[name] for name in file.attrs["columns"]}


def _seal(digest: str, content: bytes) -> bytes:
    """Checksums of a file's origin and of its bytes."""
    return f"{digest}\n{hashlib.sha256(content).hexdigest()}\n".encode()
