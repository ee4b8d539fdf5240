"""Reading what strangers enter: JSON and Parquet of bounded size, and text that can be printed."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from xden1k.errors import DataError
from xden1k.predictions.meta import COMMENT_MARKS

__all__ = ["read_json", "read_limited", "read_table"]

MAX_BYTES: Final = 16 << 20
"""Of one file. The scores of 1,000 objects take a tenth of a MiB."""
MAX_ROWS: Final = 100_000
MAX_TEXT: Final = 1000
"""Characters in a cell of a table."""


def read_json(path: Path) -> Any:
    """Read a JSON file in which every text is printable, on one line.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    Any
        Its content.

    Raises
    ------
    DataError
        If it is no plain file, larger than 16 MiB, not JSON or nested too deeply, or a text in it
        is not printable or holds the mark of an HTML comment.
    OSError
        If there is no such file.
    """
    if path.exists() and not path.is_file():
        raise DataError(f"{path}: must be a file")
    data = read_limited(path)
    try:
        values = json.loads(data.decode("utf-8"))
        texts = tuple(_texts(values))
    except (ValueError, RecursionError) as err:
        raise DataError(f"{path}: not JSON: {err}") from err
    for text in texts:
        if not text.isprintable():
            raise DataError(f"{path}: every text must be printable, found {text[:60]!a}")
        if any(mark in text for mark in COMMENT_MARKS):
            expected = " nor ".join(COMMENT_MARKS)
            raise DataError(f"{path}: no text may hold {expected}, found {text[:60]!a}")
    return values


def read_limited(path: Path) -> bytes:
    """Read a file of at most 16 MiB, whatever its directory says of its size.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    DataError
        If it is larger.
    OSError
        If there is no such file.
    """
    with path.open("rb") as stream:
        data = stream.read(MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        raise DataError(f"{path}: larger than {MAX_BYTES} bytes")
    return data


def read_table(data: bytes) -> pa.Table:
    """Read a Parquet file whose texts are short; text may come as a dictionary.

    Parameters
    ----------
    data
        The bytes of the file.

    Raises
    ------
    DataError
        If it has no rows or over 100,000, takes over 16 MiB when unpacked, or has a text of over
        1,000 characters.
    pyarrow.ArrowException
        If it is not a Parquet file.
    """
    with pq.ParquetFile(pa.BufferReader(data)) as file:
        about, names = file.metadata, file.schema_arrow.names
    size = sum(about.row_group(index).total_byte_size for index in range(about.num_row_groups))
    if not 1 <= about.num_rows <= MAX_ROWS or size > MAX_BYTES:
        expected = f"1 to {MAX_ROWS} rows in at most {MAX_BYTES} bytes"
        raise DataError(f"a table must have {expected}, got {about.num_rows} in {size}")
    # as a dictionary, a long text that many rows repeat is in memory once
    table = pq.read_table(pa.BufferReader(data), read_dictionary=names)
    for name in names:
        if pa.types.is_dictionary(table.schema.field(name).type):
            _check_texts(name, table.column(name))
    return table


def _check_texts(name: str, column: pa.ChunkedArray) -> None:
    for chunk in column.chunks:
        longest = pc.max(pc.binary_length(chunk.dictionary)).as_py() or 0
        if longest > MAX_TEXT:
            raise DataError(f"{name} has a text of {longest} bytes, at most {MAX_TEXT} are allowed")


def _texts(value: Any) -> Iterator[str]:
    """Every text in a value of JSON, keys included."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, list):
        for one in value:
            yield from _texts(one)
    elif isinstance(value, dict):
        for key, one in value.items():
            yield key
            yield from _texts(one)
