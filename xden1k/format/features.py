"""Array columns of ``datasets`` that decode to NumPy arrays on access.

``datasets`` hands a decoder one value of one column, without its row. In a shard the size of a
radiograph is in another column, and so the builder of :mod:`xden1k.access.rows` appends to each
value the shape it has (:mod:`xden1k.format.packing`):

    byte planes | the shape, int32 little-endian, one per axis | the number of axes, one byte

An array that the column's own type cannot hold exactly, as ``map`` makes them, is stored in the
type it has, which its value then names: kind and size, two bytes before the last, and 128 more in
the last. So a column of arrays stays one, no value is ever rounded, and none becomes lists.

The last byte is never zero, which matters: the NumPy and torch formats of ``datasets`` put
bytes into a fixed-width array, where zeros at the end are lost.

What decodes: rows, slices, columns, batches, streaming, every format but ``arrow``, and what
``map`` gives back. Limits, all of ``datasets``: its NumPy and torch formats widen integers to
int64 and are slow (:func:`xden1k.to_tensors` is not), and its files (``save_to_disk``,
``to_parquet``, the cache) need ``import xden1k`` before they are read, unless
:func:`xden1k.to_plain` was applied.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
import pyarrow as pa
from datasets.features import features as hf
from jaxtyping import Shaped

from xden1k.errors import DataError
from xden1k.format.codec import ArrayCodec, to_planes

__all__ = ["PackedArray", "shape_footer"]

_NAME = "Xden1kArray"
"""In every file ``datasets`` writes: who lacks the import reads it in the message."""
_OWN_TYPE = 128
_OWN_TYPES = frozenset(f"{kind}{n}".encode() for kind in "iuf" for n in (1, 2, 4, 8)) | {b"b1"}


@dataclass
class PackedArray:
    """Feature type of one array column.

    Parameters
    ----------
    stored
        Name of the little-endian NumPy type of the stored values.
    scale
        A value is the stored one times this, as float32; None = as stored.
    decode
        False leaves the bytes.

    Examples
    --------
    >>> transmission = PackedArray("<u2", scale=1.25 / 65535)
    >>> transmission.decode_example(transmission.encode_example([[1.25, 0.0]])).tolist()
    [[1.25, 0.0]]
    """

    stored: str
    scale: float | None = None
    decode: bool = True
    id: str | None = field(default=None, repr=False)
    dtype: ClassVar[str] = "binary"
    pa_type: ClassVar[pa.DataType] = pa.binary()
    _type: str = field(default=_NAME, init=False, repr=False)

    def __call__(self) -> pa.DataType:
        """Arrow type of the storage."""
        return self.pa_type

    def decode_example(
        self, value: bytes, token_per_repo_id: object = None
    ) -> Shaped[np.ndarray, "..."]:
        """Array of one stored value: a fresh, writable one.

        Raises
        ------
        DataError
            If the value is not byte planes followed by their shape.
        """
        del token_per_repo_id  # every decoder gets one; nothing here is remote
        axes = value[-1] & ~_OWN_TYPE if value else 0
        own = bool(value) and value[-1] >= _OWN_TYPE
        end = len(value) - 1 - 2 * own - 4 * axes if value else -1
        if end < 0:
            raise DataError(f"{len(value)} bytes are no byte planes followed by their shape")
        shape = tuple(np.frombuffer(value, dtype="<i4", count=axes, offset=end).tolist())
        codec = ArrayCodec(self.stored, shape, self.scale)
        if own:
            codec = ArrayCodec(_type_of(value[-3:-1]), shape)
        return codec.decode(memoryview(value)[:end])

    def encode_example(self, value: Any) -> bytes:
        """Return the stored value of an array, or of bytes already stored.

        Raises
        ------
        DataError
            If it is no array of numbers.
        """
        if isinstance(value, bytes):
            return value
        array = np.asarray(value)
        if array.dtype.kind not in "biuf" or not array.ndim:
            raise DataError(
                f"{array.dtype} of shape {array.shape} is no array of numbers: give it a new column"
            )
        with np.errstate(all="ignore"):
            steps = array if self.scale in (None, 1.0) else np.rint(array / self.scale)
            codes = steps.astype(self.stored)
        back = ArrayCodec(self.stored, array.shape, self.scale).values(codes)
        if np.array_equal(back, array, equal_nan=True):
            return to_planes(codes) + shape_footer(array.shape)
        own = array.dtype.newbyteorder("<")
        named = f"{own.kind}{own.itemsize}".encode("ascii")
        return to_planes(array) + shape_footer(array.shape, named)

    def cast_storage(self, storage: pa.Array) -> pa.BinaryArray:
        """Return the stored values of a column that is stored already, or of nested lists.

        ``map`` makes nested lists of every array that was looked at.

        Raises
        ------
        pyarrow.ArrowInvalid
            If the column holds no arrays of numbers; ``map`` then gives it another type.
        """
        if storage.type in (self.pa_type, pa.large_binary(), pa.null()):
            return storage.cast(self.pa_type)
        if not pa.types.is_list(storage.type):
            raise pa.ArrowInvalid(f"{storage.type} is no array")
        try:
            values = [
                self.encode_example(_array_of(row)) if row.is_valid else None for row in storage
            ]
        except DataError as err:
            raise pa.ArrowInvalid(str(err)) from err
        return pa.array(values, self.pa_type)


def shape_footer(shape: tuple[int, ...], own_type: bytes = b"") -> bytes:
    """Return what a stored value has after its byte planes.

    Parameters
    ----------
    shape
        Of the array.
    own_type
        Kind and size of its type, such as ``b"f4"``, where that is not the column's.
    """
    last = len(shape) + (_OWN_TYPE if own_type else 0)
    return np.array(shape, dtype="<i4").tobytes() + own_type + bytes([last])


def _type_of(name: bytes) -> str:
    if name not in _OWN_TYPES:
        raise DataError(f"{name!r} is no type of stored values")
    return f"<{name.decode('ascii')}"


def _array_of(row: pa.ListScalar) -> Shaped[np.ndarray, "..."]:
    values = row.values
    shape = [len(values)]
    while pa.types.is_list(values.type):
        lengths = values.value_lengths().unique().to_pylist() or [0]
        if len(lengths) > 1:
            raise DataError(f"lists of lengths {sorted(lengths)} make no array")
        shape.append(lengths[0])
        values = values.flatten()
    array: Shaped[np.ndarray, "..."] = values.to_numpy(zero_copy_only=False)
    return array.reshape(shape)


with warnings.catch_warnings():
    # "experimental and might be subject to breaking changes": the tests watch over that.
    warnings.simplefilter("ignore", UserWarning)
    hf.register_feature(PackedArray, _NAME)
