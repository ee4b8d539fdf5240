"""How arrays become bytes in a shard, and come back.

An array is flattened in C order, little-endian, and split into byte planes: all lowest bytes
first, then all second bytes, and so on, which zstd packs far better than the plain array. Values
with a known range are stored as integers:

- transmission: uint16, 65535 = 1.25, **0 = invalid pixel**. A valid pixel is at least code 1
  (a transmission of 2e-5, below one count of a 16-bit detector), so noise below zero is clipped
  to it, and above 1.25 to 65535;
- shares of a voxel: uint8, 255 = full;
- densities: float16, in steps of 0.004 g/cm³ at steel's 7.8.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa
from jaxtyping import Float32, Shaped, UInt8, UInt16

from xden1k.errors import DataError
from xden1k.values.arrays import Grid, Image, Mask

__all__ = [
    "MAX_TRANSMISSION",
    "ArrayCodec",
    "Buffer",
    "encode_density",
    "encode_share",
    "encode_transmission",
    "from_planes",
    "to_planes",
]

Buffer: TypeAlias = bytes | memoryview | pa.Buffer
"""Stored bytes, as read from a shard or made here."""
AnyArray = Shaped[np.ndarray, "..."]

MAX_TRANSMISSION = 1.25
"""Transmission of the highest code, 65535."""


def to_planes(values: AnyArray) -> bytes:
    """Byte planes of an array.

    Examples
    --------
    >>> to_planes(np.array([0x0102, 0x0304], dtype=np.uint16)).hex()
    '02040103'
    """
    little = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<"))
    return little.reshape(-1).view(np.uint8).reshape(-1, little.itemsize).T.tobytes()


def from_planes(data: Buffer, dtype: np.dtype[Any], shape: tuple[int, ...]) -> AnyArray:
    """Array of byte planes: a fresh, writable one.

    Parameters
    ----------
    data
        What :func:`to_planes` gave.
    dtype
        Type of the values.
    shape
        One entry may be -1, any count.

    Raises
    ------
    DataError
        If the number of bytes does not go with the type and the shape.
    """
    planes = np.frombuffer(data, dtype=np.uint8)
    wanted = dtype.itemsize * abs(math.prod(shape))
    # With -1 in the shape any multiple will do, and nothing of an empty row can be counted.
    fits = bool(wanted) and planes.size % wanted == 0 if -1 in shape else planes.size == wanted
    if not fits:
        raise DataError(f"{planes.size} bytes do not make {dtype.name} values of shape {shape}")
    planes = planes.reshape(dtype.itemsize, -1)
    words = planes[-1].astype(f"u{dtype.itemsize}")
    for plane in planes[-2::-1]:
        words <<= 8
        words |= plane
    values: AnyArray = words.view(dtype).reshape(shape)
    return values


@dataclass(frozen=True)
class ArrayCodec:
    """How one binary column is stored.

    Parameters
    ----------
    stored
        Name of the little-endian NumPy type of the stored values.
    shape
        Shape of the array, -1 = any count; or the name of the column that holds it.
    scale
        A value is the stored one times this, as float32; None = as stored.
    """

    stored: str
    shape: tuple[int, ...] | str
    scale: float | None = None

    def decode(self, data: Buffer, shape: tuple[int, ...] | None = None) -> AnyArray:
        """Array of stored bytes: a fresh, writable one. As :meth:`codes`."""
        return self.values(self.codes(data, shape))

    def codes(self, data: Buffer, shape: tuple[int, ...] | None = None) -> AnyArray:
        """Return the stored values as they are: a fresh, writable array.

        Parameters
        ----------
        data
            The column's value.
        shape
            Needed where the shape is in another column.

        Raises
        ------
        DataError
            If the number of bytes does not go with the type and the shape.
        """
        if shape is None:
            if isinstance(self.shape, str):
                raise DataError(f"the shape of this array is in the column {self.shape}: pass it")
            shape = self.shape
        return from_planes(data, np.dtype(self.stored), shape)

    def values(self, codes: AnyArray) -> AnyArray:
        """Return the values of stored codes: the same array where they are stored as they are."""
        if self.scale is None:
            return codes
        decoded: Float32[np.ndarray, "..."] = codes.astype(np.float32)
        if self.scale != 1.0:
            decoded *= np.float32(self.scale)
        return decoded


def encode_transmission(transmission: Image, valid: Mask) -> UInt16[np.ndarray, "rows columns"]:
    """Codes of a radiograph: 65535 = 1.25, 0 = invalid; clipped to 1 ... 65535 where valid.

    Examples
    --------
    >>> image = np.array([[1.25, 0.0, -0.1, np.nan]], dtype=np.float32)
    >>> encode_transmission(image, np.isfinite(image)).tolist()
    [[65535, 1, 1, 0]]
    """
    steps = np.where(valid, transmission, np.float32(0)) * np.float32(65535 / MAX_TRANSMISSION)
    codes: UInt16[np.ndarray, "rows columns"] = np.rint(steps).clip(1, 65535).astype(np.uint16)
    codes[~valid] = 0
    return codes


def encode_share(share: Grid) -> UInt8[np.ndarray, "x y z"]:
    """Codes of shares from 0 to 1: 255 = full.

    Raises
    ------
    DataError
        If a share is outside 0 ... 1 by more than rounding.
    """
    if not ((share >= -1e-6) & (share <= 1 + 1e-6)).all():
        raise DataError(f"a share must be 0 to 1, got {np.min(share)} to {np.max(share)}")
    return np.rint(share * 255.0).clip(0, 255).astype(np.uint8)


def encode_density(density_g_cm3: Grid) -> Grid:
    """Densities as float16.

    Raises
    ------
    DataError
        If one is above float16's range, 65504 g/cm³.
    """
    if np.max(density_g_cm3) > np.finfo(np.float16).max:
        raise DataError(f"a density of {np.max(density_g_cm3)} g/cm³ does not fit into float16")
    return density_g_cm3.astype(np.float16)
