"""From the binary columns of a shard to values that know their shape, and so can be decoded."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from datasets import Features, Value

from xden1k.format.features import PackedArray, shape_footer
from xden1k.format.schema import ARRAY_COLUMNS

__all__ = ["pack", "scanned_columns", "with_arrays"]


def with_arrays(features: Features) -> Features:
    """Return the same features, with each plain binary array column made to decode."""
    return Features(
        {
            name: PackedArray(ARRAY_COLUMNS[name].stored, ARRAY_COLUMNS[name].scale)
            if name in ARRAY_COLUMNS and feature == Value("binary")
            else feature
            for name, feature in features.items()
        }
    )


def scanned_columns(columns: Iterable[str]) -> list[str]:
    """Columns to read from a shard: those asked for, and those which hold their shapes."""
    columns = list(columns)
    shapes = (ARRAY_COLUMNS[name].shape for name in columns if name in ARRAY_COLUMNS)
    return list(dict.fromkeys([*columns, *(name for name in shapes if isinstance(name, str))]))


def pack(table: pa.Table, features: Features) -> pa.Table:
    """Append the shape to each value of the array columns.

    Parameters
    ----------
    table
        As read from a shard, shapes included.
    features
        What :func:`with_arrays` gave; other columns of the table are dropped.
    """
    for name, feature in features.items():
        if isinstance(feature, PackedArray):
            packed = _pack(table, name)
            table = table.set_column(table.column_names.index(name), name, packed)
    return table.select(list(features))


def _pack(table: pa.Table, name: str) -> pa.ChunkedArray:
    values, shape = table[name], ARRAY_COLUMNS[name].shape
    counts = pc.divide(pc.binary_length(values), np.dtype(ARRAY_COLUMNS[name].stored).itemsize)
    shapes = table[shape].to_pylist() if isinstance(shape, str) else [shape] * len(values)
    footers = [
        None if count is None else shape_footer(_whole(shape, count))
        for shape, count in zip(shapes, counts.to_pylist(), strict=True)
    ]
    return pc.binary_join_element_wise(values, pa.array(footers, pa.binary()), b"")


def _whole(shape: Iterable[int], count: int) -> tuple[int, ...]:
    """Replace the -1 of a shape by what makes ``count`` values."""
    known = int(np.prod([length for length in shape if length >= 0]))
    return tuple(count // known if length < 0 else length for length in shape)
