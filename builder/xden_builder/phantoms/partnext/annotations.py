"""Rows of PartNeXt's annotations: found in a folder, indexed, and read one by one."""

from __future__ import annotations

import ast
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.ipc
import pyarrow.parquet as pq

from xden1k.errors import DataError
from xden_builder.capture.damage import decoding

__all__ = ["Annotations", "Entry", "find_annotations", "parsed", "read_fields"]

IDS: Final = ("model_id", "type_id", "anno_time")
FIELDS: Final = ("mesh_face_num", "masks", "hierarchyList")
ENDINGS: Final = (".arrow", ".jsonl", ".parquet")
_PLAIN: Final = re.compile(r"(?!\.+$)[A-Za-z0-9._-]{1,128}")
_SHOWN: Final = 60
"""Characters of a wrong value that a message quotes."""


@dataclass(frozen=True, slots=True)
class Entry:
    """Where the annotation of one model stands.

    Parameters
    ----------
    model_id
        Name of its GLB.
    type_id
        Folder of its GLB.
    seconds
        ``anno_time``, which its authors publish as the seconds spent on it.
    file
        The table.
    block, row
        Row group or batch, and the row in it; of JSON lines the byte at which the line begins, and
        its number from 1.
    """

    model_id: str
    type_id: str
    seconds: float
    file: Path
    block: int
    row: int

    @property
    def where(self) -> str:
        """File and object, for messages."""
        return f"{self.file}: object {self.model_id}"


@dataclass(frozen=True, slots=True)
class Annotations:
    """What a folder holds.

    Parameters
    ----------
    entries
        One for each model, sorted by its id.
    repeated
        Rows left out, since their model has another one.
    faults
        Of rows that could not be told to belong to a model: where, and one line each.
    """

    entries: tuple[Entry, ...]
    repeated: int
    faults: tuple[tuple[str, str], ...]

    def chosen(self, objects: Sequence[str], count: int | None) -> tuple[Entry, ...]:
        """Give the entries of some models, or of the first ones; of all by default.

        Raises
        ------
        DataError
            If there is no annotation of a model.
        """
        known = {entry.model_id: entry for entry in self.entries}
        if unknown := [name for name in objects if name not in known]:
            raise DataError(f"no annotation of object {unknown[0]}; there are {len(known)} objects")
        picked = [known[name] for name in sorted(set(objects))] if objects else self.entries
        return tuple(picked[:count])


def find_annotations(folder: Path) -> Annotations:
    """Index the annotations below a folder, in Parquet, JSON lines, or Arrow as ``datasets`` saves.

    Of several rows of a model, the one with the greatest ``anno_time`` is taken, of equals the
    last, as their own toolkit does. Hidden files and those called ``cache-`` are passed over.

    Raises
    ------
    DataError
        If there is no such file, one cannot be read or lacks a column, or no row names a model.
    """
    files = [
        path
        for path in sorted(folder.rglob("*"))
        if path.suffix in ENDINGS
        and path.is_file()
        and not any(name.startswith(".") for name in path.relative_to(folder).parts)
        and not path.name.startswith("cache-")
    ]
    if not files:
        raise DataError(f"{folder}: expected annotations as {', '.join(ENDINGS)}, found none")
    best: dict[str, Entry] = {}
    faults: list[tuple[str, str]] = []
    rows = 0
    for file in files:
        for found in _LISTED[file.suffix](file):
            if not isinstance(found, Entry):
                faults.append(found)
                continue
            rows += 1
            if found.model_id not in best or best[found.model_id].seconds <= found.seconds:
                best[found.model_id] = found
    if not rows and not faults:
        raise DataError(f"{folder}: no row in {len(files)} files of annotations")
    entries = tuple(sorted(best.values(), key=lambda entry: entry.model_id))
    return Annotations(entries, rows - len(entries), tuple(faults))


Found = Entry | tuple[str, str]


def _entry(values: Mapping[str, Any], file: Path, block: int, row: int, at: str) -> Found:
    """Take up a row, or say what is wrong with it."""
    for name in ("model_id", "type_id"):
        if not isinstance(values.get(name), str) or not _PLAIN.fullmatch(values[name]):
            got = repr(values.get(name))[:_SHOWN]
            return at, f"{name}: expected 1 to 128 letters, digits and . _ -, got {got}"
    try:
        seconds = float(values.get("anno_time") or 0.0)
        if not math.isfinite(seconds):  # it would be neither newer nor older than any other
            raise ValueError
    except (TypeError, ValueError):
        got = repr(values["anno_time"])[:_SHOWN]
        return at, f"object {values['model_id']}: anno_time: expected a number, got {got}"
    return Entry(values["model_id"], values["type_id"], seconds, file, block, row)


def _in_parquet(file: Path) -> Iterator[Found]:
    with decoding(file, "a Parquet file", pa.ArrowException):
        table = pq.ParquetFile(file)
    _check_columns(file, table.schema_arrow.names)
    for block in range(table.num_row_groups):
        with decoding(file, "a Parquet file", pa.ArrowException):
            rows = table.read_row_group(block, columns=list(IDS)).to_pylist()
        for row, values in enumerate(rows):
            yield _entry(values, file, block, row, f"{file}: row {row + 1} of group {block + 1}")


def _in_arrow(file: Path) -> Iterator[Found]:
    for block, batch in enumerate(_batches(file)):
        _check_columns(file, batch.schema.names)
        for row, values in enumerate(batch.select(list(IDS)).to_pylist()):
            yield _entry(values, file, block, row, f"{file}: row {row + 1} of batch {block + 1}")


def _batches(file: Path) -> Iterator[pa.RecordBatch]:
    with (
        decoding(file, "an Arrow stream", pa.ArrowException),
        pa.memory_map(str(file)) as mapped,
        pa.ipc.open_stream(mapped) as stream,
    ):
        yield from stream


def _in_lines(file: Path) -> Iterator[Found]:
    at = 0
    with file.open("rb") as lines:
        for number, line in enumerate(lines, 1):
            start, at = at, at + len(line)
            if not line.strip():
                continue
            where = f"{file}: line {number}"
            try:
                values = json.loads(line)
            except (ValueError, RecursionError) as error:
                yield where, f"expected a row as JSON: {error}"
                continue
            if not isinstance(values, dict):
                yield where, f"expected a row as a JSON object, got {repr(values)[:_SHOWN]}"
                continue
            yield _entry(values, file, start, number, where)


_LISTED: Final = {".parquet": _in_parquet, ".arrow": _in_arrow, ".jsonl": _in_lines}


def _check_columns(file: Path, names: Sequence[str]) -> None:
    if missing := [name for name in (*IDS, *FIELDS) if name not in names]:
        raise DataError(f"{file}: expected a column {missing[0]}, got {', '.join(names)}")


def read_fields(entry: Entry) -> dict[str, Any]:
    """Read what is large in an annotation: face counts, masks and hierarchy, parsed.

    Raises
    ------
    DataError
        If a field is missing or cannot be parsed.
    """
    values = _row(entry)
    return {name: parsed(values.get(name), f"{entry.where}: {name}") for name in FIELDS}


def _row(entry: Entry) -> Mapping[str, Any]:
    if entry.file.suffix == ".jsonl":
        with entry.file.open("rb") as lines:
            lines.seek(entry.block)
            read: dict[str, Any] = json.loads(lines.readline())
            return read
    if entry.file.suffix == ".parquet":
        with decoding(entry.file, "a Parquet file", pa.ArrowException):
            table = pq.ParquetFile(entry.file).read_row_group(entry.block, columns=list(FIELDS))
            return dict(table.slice(entry.row, 1).to_pylist()[0])
    for block, batch in enumerate(_batches(entry.file)):
        if block == entry.block:
            return dict(batch.select(list(FIELDS)).slice(entry.row, 1).to_pylist()[0])
    raise DataError(f"{entry.where}: its row is gone")


def parsed(value: Any, where: str) -> Any:
    """Parse a field that holds JSON, or a literal of Python's, in a string.

    Raises
    ------
    DataError
        If it is neither.

    Examples
    --------
    >>> parsed('{"0": [1, 2]}', "masks"), parsed("{0: [1, 2]}", "masks")
    ({'0': [1, 2]}, {0: [1, 2]})
    """
    if isinstance(value, dict | list):
        return value
    if not isinstance(value, str):
        raise DataError(f"{where}: expected JSON in a string, got {repr(value)[:_SHOWN]}")
    try:
        return json.loads(value)
    except (ValueError, RecursionError) as error:
        try:
            return ast.literal_eval(value)
        except (ValueError, SyntaxError, MemoryError, RecursionError):
            raise DataError(
                f"{where}: expected JSON in a string, got {value[:_SHOWN]!r}: {error}"
            ) from None
