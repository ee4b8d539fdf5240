"""Parquet files of encoded rows: one row per row group, so that any row is read alone.

An encoded row (:data:`Row`) is a dict of every column: array columns and previews as ``bytes``,
everything else of JSON's types.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from xden1k.errors import DataError
from xden1k.format.remote import RemoteFile, RemotePath
from xden1k.format.schema import PREVIEW_COLUMNS

__all__ = ["Row", "ShardReader", "ShardWriter", "row_table"]

Row = dict[str, Any]
"""An encoded row: column name to value."""

PAGE_BYTES = 1 << 30
"""Larger than any value, so that a value is one page."""


def row_table(rows: Sequence[Mapping[str, Any]], schema: pa.Schema) -> pa.Table:
    """Arrow table of encoded rows.

    Raises
    ------
    DataError
        If a row lacks a column or a value has the wrong type.
    """
    return pa.table([_column(rows, field) for field in schema], schema=schema)


def _column(rows: Sequence[Mapping[str, Any]], field: pa.Field) -> pa.Array:
    try:
        return pa.array([_cell(row, field.name) for row in rows], type=field.type)
    except KeyError as err:
        raise DataError(f"{rows[0].get('object_id')}: no column {field.name}") from err
    except (pa.ArrowInvalid, pa.ArrowTypeError) as err:
        raise DataError(f"{rows[0].get('object_id')}: column {field.name}: {err}") from err


def _cell(row: Mapping[str, Any], name: str) -> Any:
    value = row[name]
    if isinstance(value, pa.Buffer):  # as a reader gives it
        value = value.to_pybytes()
    is_picture = name in PREVIEW_COLUMNS and value is not None
    return {"bytes": value, "path": None} if is_picture else value


class ShardWriter:
    """Writes one Parquet file, row by row.

    The same rows give the same bytes. :meth:`close` completes the file.

    Parameters
    ----------
    path
        The file to make.
    schema
        Its columns.
    group_rows
        Rows per row group.
    """

    def __init__(self, path: Path, schema: pa.Schema, group_rows: int = 1) -> None:
        self.path = path
        self.rows = 0
        self.num_bytes = 0
        """Size of the rows in Arrow memory, what a card calls ``num_bytes``."""
        self._schema = schema
        self._group_rows = group_rows
        self._waiting: list[Mapping[str, Any]] = []
        self._file: BinaryIO = path.open("wb")
        self._writer = pq.ParquetWriter(
            self._file,
            schema,
            compression="zstd",
            compression_level=3,
            use_dictionary=False,
            write_statistics=["object_id"],
            data_page_size=PAGE_BYTES,
            write_page_checksum=True,
        )

    def write(self, row: Mapping[str, Any]) -> None:
        """Add a row.

        Raises
        ------
        DataError
            If it lacks a column or a value has the wrong type.
        """
        self._waiting.append(row)
        self.rows += 1
        if len(self._waiting) == self._group_rows:
            self._flush()

    @property
    def file_bytes(self) -> int:
        """Bytes written so far."""
        return self._file.tell()

    def _flush(self) -> None:
        rows, self._waiting = self._waiting, []
        if rows:
            table = row_table(rows, self._schema)
            self.num_bytes += table.nbytes
            self._writer.write_table(table)

    def close(self) -> None:
        """Write what waits and the footer; closing again does nothing."""
        self._flush()
        self._writer.close()
        self._file.close()


class ShardReader:
    """Reads single rows of one Parquet file through a memory map, page checksums verified.

    For one thread at a time: what Parquet readers keep is not made for several.

    Parameters
    ----------
    path
        A file of one row per row group.
    file
        The file opened, where it is not one of this machine: read in place of the path. Of a
        :class:`RemoteFile` only what is asked for is fetched.

    Raises
    ------
    DataError
        If it cannot be read as Parquet: cut short, not there, or something else.
    """

    def __init__(self, path: Path | RemotePath, file: BinaryIO | RemoteFile | None = None) -> None:
        self.path = path
        self._remote = file if isinstance(file, RemoteFile) else None
        try:
            self._file = pq.ParquetFile(
                file or path,
                metadata=self._remote and self._remote.metadata,
                memory_map=file is None,
                page_checksum_verification=True,
            )
        except (pa.ArrowException, OSError, UnicodeDecodeError) as err:
            raise DataError(f"{path}: not a whole Parquet file: {err}") from err

    @cached_property
    def schema(self) -> pa.Schema:
        """Arrow schema of the file."""
        return self._file.schema_arrow

    @property
    def row_groups(self) -> int:
        """Number of row groups, which is that of rows in ``data``."""
        return int(self._file.num_row_groups)

    @property
    def rows(self) -> int:
        """Number of rows."""
        return int(self._file.metadata.num_rows)

    def column(self, name: str) -> list[Any]:
        """Values of one column in every row.

        Raises
        ------
        DataError
            If the file is damaged or has no such column.
        """
        self._check_columns([name])
        if self._remote:
            return [value for table in self.groups([name]) for value in table[name].to_pylist()]
        try:
            table = self._file.read(columns=[name], use_threads=False)
        except (pa.ArrowException, OSError) as err:
            raise DataError(f"{self.path}: cannot read {name}: {err}") from err
        values: list[Any] = table.column(name).to_pylist()
        return values

    def row(self, index: int, columns: Sequence[str] | None = None) -> Row:
        """One encoded row; binary values point into Arrow's memory, without a copy.

        Parameters
        ----------
        index
            Which row group.
        columns
            Columns to read; None = all. Only these are read from the file.

        Raises
        ------
        DataError
            If the file is damaged or has no such column.
        """
        return _row(self.table(index, columns), 0)

    def __iter__(self) -> Iterator[Row]:
        for table in self.groups():
            for position in range(table.num_rows):
                yield _row(table, position)

    def groups(self, columns: Sequence[str] | None = None) -> Iterator[pa.Table]:
        """Read the row groups one after the other, some columns or all.

        Raises
        ------
        DataError
            If the file is damaged or has no such column.
        """
        for index in range(self.row_groups):
            yield self.table(index, columns)

    def table(self, index: int, columns: Sequence[str] | None = None) -> pa.Table:
        """Read one row group, some columns or all.

        Raises
        ------
        DataError
            If the file is damaged or has no such column.
        """
        if columns is not None:
            self._check_columns(columns)
        held = self._remote.holding(index, columns) if self._remote else nullcontext()
        try:
            with held:
                return self._file.read_row_group(index, columns=columns, use_threads=False)
        except (pa.ArrowException, OSError) as err:
            name = self._named(index)
            if self._remote:
                self._remote.forget(index)  # last, since naming it has read it again
            raise DataError(f"{self.path}: cannot read {name}: {err}") from err

    def _named(self, index: int) -> str:
        """Name a row by its object, if that can still be read."""
        try:
            ids = self._file.read_row_group(index, columns=["object_id"], use_threads=False)
        except (pa.ArrowException, OSError):
            return f"row group {index}"
        return f"{', '.join(ids.column(0).to_pylist())} (row group {index})"

    def _check_columns(self, names: Sequence[str]) -> None:
        known = self.schema.names
        if missing := [name for name in names if name not in known]:
            raise DataError(f"{self.path}: no column {missing}; columns are {known}")


def _row(table: pa.Table, position: int) -> Row:
    cells = table.slice(position, 1)
    return {name: _value(name, cells.column(name).chunk(0)) for name in cells.column_names}


def _value(name: str, cell: pa.Array) -> Any:
    """Value of an array of one."""
    if pa.types.is_binary(cell.type):
        return _bytes(cell)
    value = cell[0].as_py()
    return value["bytes"] if name in PREVIEW_COLUMNS and value is not None else value


def _bytes(cell: pa.Array) -> pa.Buffer | None:
    """Bytes where they are: a scalar of Arrow would copy them."""
    if cell.null_count:
        return None
    _, offsets, data = cell.buffers()
    start, stop = np.frombuffer(offsets, np.int32)[cell.offset : cell.offset + 2].tolist()
    return data.slice(start, stop - start)
