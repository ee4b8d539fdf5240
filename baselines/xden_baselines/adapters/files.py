"""Reading files that come from elsewhere: bounded in size, nothing unpickled, one line if wrong."""

from __future__ import annotations

import io
import json
import struct
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Shaped

from xden1k.errors import DataError

__all__ = [
    "checked_points",
    "numbers",
    "read_json",
    "read_npy",
    "read_npz",
    "read_ply",
    "read_text",
]

MAX_BYTES: Final = 512 << 20
"""Of an array, and of a file other than ``.npz``: ten million points and more."""
MAX_TEXT_BYTES: Final = 16 << 20
"""Of JSON and text."""

Array = Shaped[np.ndarray, "..."]
_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def read_npy(path: Path) -> Array:
    """Read an ``.npy`` file.

    Raises
    ------
    DataError
        If there is none, it is too large, cut short, or would have to be unpickled.
    """
    return _array(_bytes(path, MAX_BYTES), str(path))


def read_npz(path: Path, names: tuple[str, ...]) -> Mapping[str, Array]:
    """Read some arrays of an ``.npz`` file.

    Parameters
    ----------
    path
        The file.
    names
        Those wanted; what is missing is not in the result, what else there is remains unread.

    Raises
    ------
    DataError
        As :func:`read_npy` does, or if it is no ``.npz`` file.
    """
    found = {}
    try:
        with zipfile.ZipFile(path) as archive:
            members = {info.filename: info for info in archive.infolist()}
            for name in names:
                if info := members.get(f"{name}.npy"):
                    _check_bytes(info.file_size, MAX_BYTES, f"{path}: {name}")
                    found[name] = _array(archive.read(info), f"{path}: {name}")
    except OSError as err:
        raise DataError(f"{path}: {err.strerror or err}") from err
    except (EOFError, zipfile.BadZipFile, zlib.error, struct.error) as err:
        raise DataError(f"{path}: expected a readable .npz file: {err}") from err
    except (NotImplementedError, RuntimeError) as err:
        raise DataError(f"{path}: packed or encrypted in a way that is not read: {err}") from err
    return found


def read_ply(path: Path, names: tuple[str, ...]) -> Mapping[str, Array]:
    """Read some properties of the vertices of a PLY file, each of shape (vertices,).

    Raises
    ------
    DataError
        If there is no such file, it is too large, damaged, or lacks a property.
    """
    from trimesh.exchange.ply import load_ply

    stream = io.BytesIO(_bytes(path, MAX_BYTES))
    try:
        # without materials it opens no other file
        elements = load_ply(stream, skip_materials=True)["metadata"]["_ply_raw"]
        vertices = elements["vertex"]["data"]
        return {name: np.asarray(vertices[name]).reshape(-1) for name in names}
    except (ValueError, KeyError, IndexError, TypeError, AttributeError, struct.error) as err:
        expected = f"a PLY file whose vertices have {list(names)}"
        raise DataError(f"{path}: expected {expected}: {type(err).__name__}: {err}") from err


def read_json(path: Path) -> Mapping[str, Any]:
    """Read a JSON object.

    Raises
    ------
    DataError
        If there is no such file, or it holds something else.
    """
    try:
        found = json.loads(read_text(path))
    except (ValueError, RecursionError) as err:
        raise DataError(f"{path}: not JSON: {err}") from err
    if not isinstance(found, dict):
        raise DataError(f"{path}: expected a JSON object, got {type(found).__name__}")
    return found


def read_text(path: Path) -> str:
    """Read a text file.

    Raises
    ------
    DataError
        If there is no such file, it is too large or not UTF-8.
    """
    try:
        return _bytes(path, MAX_TEXT_BYTES).decode()
    except UnicodeDecodeError as err:
        raise DataError(f"{path}: expected UTF-8 text: {err}") from err


def numbers(values: object, shape: tuple[int | None, ...], where: str) -> np.ndarray:
    """Return finite numbers as float64.

    Parameters
    ----------
    values
        What was read: an array, or lists of JSON.
    shape
        The one it must have; None = any length but 0.
    where
        File and key, which opens the message.

    Raises
    ------
    DataError
        If these are no numbers, the shape is another, or one is not finite.
    """
    try:
        found = np.asarray(values)
    except ValueError as err:
        raise DataError(f"{where}: expected numbers of shape {_shown(shape)}: {err}") from err
    if found.dtype.kind not in "fiu":
        raise DataError(f"{where}: expected numbers, got {found.dtype}")
    fits = found.ndim == len(shape) and all(
        have == want if want is not None else have > 0
        for have, want in zip(found.shape, shape, strict=True)
    )
    if not fits:
        raise DataError(f"{where}: shape must be {_shown(shape)}, got {found.shape}")
    floats = found.astype(np.float64)
    if bad := np.argwhere(~np.isfinite(floats)).tolist():
        raise DataError(f"{where}: {len(bad)} values are not finite, first at {tuple(bad[0])}")
    return floats


def checked_points(
    arrays: Mapping[str, Array], points: str, density: str, path: Path
) -> tuple[np.ndarray, np.ndarray]:
    """Return points (N, 3), and one density or a range for each, (N,) or (N, 2).

    Raises
    ------
    DataError
        If one is missing, or they are no such arrays of one length.
    """
    for name in (points, density):
        if name not in arrays:
            raise DataError(f"{path}: {name} is missing")
    found = numbers(arrays[points], (None, 3), f"{path}: {points}")
    ranged = arrays[density].ndim == 2
    shape = (len(found), 2) if ranged else (len(found),)
    return found, numbers(arrays[density], shape, f"{path}: {density}")


def _bytes(path: Path, most: int) -> bytes:
    try:
        _check_bytes(path.stat().st_size, most, str(path))
        return path.read_bytes()
    except OSError as err:
        raise DataError(f"{path}: {err.strerror}") from err


def _check_bytes(count: int, most: int, where: str) -> None:
    if count > most:
        raise DataError(f"{where}: {count} bytes, at most {most}")


def _array(data: bytes, where: str) -> Array:
    """Read ``.npy`` bytes. The header is compared with their number before anything is made."""
    stream = io.BytesIO(data)
    try:
        header = _HEADERS[np.lib.format.read_magic(stream)]
        shape, fortran, dtype = header(stream)
    except (ValueError, KeyError) as err:
        raise DataError(f"{where}: no .npy array: {err}") from err
    if dtype.hasobject:
        raise DataError(f"{where}: an object array, which would have to be unpickled")
    count = 1
    for edge in shape:
        count *= edge
    start = stream.tell()
    if (expected := start + count * dtype.itemsize) != len(data):
        raise DataError(
            f"{where}: shape {shape} of {dtype} needs {expected} bytes, there are {len(data)}"
        )
    if not count:
        return np.zeros(shape, dtype)
    return np.frombuffer(data, dtype, offset=start).reshape(shape, order="F" if fortran else "C")


def _shown(shape: tuple[int | None, ...]) -> str:
    edges = ", ".join("N" if edge is None else str(edge) for edge in shape)
    return f"({edges},)" if len(shape) == 1 else f"({edges})"
