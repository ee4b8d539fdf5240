"""Entries that strangers write by hand: refused in one line, whatever is in them."""

from __future__ import annotations

import datetime
import hashlib
import io
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from xden1k.errors import DataError
from xden_bench.entries.reading import read_entries
from xden_bench.entries.result import entry_of, write_entry
from xden_bench.entries.untrusted import read_json, read_table
from xden_bench.scoring.protocol import load_protocol
from xden_bench.scoring.reference import Reference
from xden_bench.scoring.score import score


@pytest.fixture
def entry(submission: Callable[..., Path], reference: Reference, tmp_path: Path) -> Path:
    """A sound entry, the only one in ``tmp_path / "results"``."""
    scored = score(submission(), reference, load_protocol())
    made = entry_of(scored, reference, command="none", date=datetime.date(2025, 1, 1))
    return write_entry(made, scored, tmp_path / "results")


def parquet(table: pa.Table) -> bytes:
    buffer = io.BytesIO()
    pq.write_table(table, buffer, compression="zstd", store_schema=False)
    return buffer.getvalue()


def with_objects(entry: Path, data: bytes) -> None:
    """Put other objects beside an entry, with the checksum that they have."""
    entry.with_suffix(".parquet").write_bytes(data)
    values = json.loads(entry.read_text())
    values["objects"]["sha256"] = hashlib.sha256(data).hexdigest()
    entry.write_text(json.dumps(values))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[" * 200_000, "not JSON: maximum recursion depth"),
        ('{"a": ' * 200_000, "not JSON: maximum recursion depth"),
        ("1" * 5000, "not JSON: Exceeds the limit"),
        ("{", "not JSON: Expecting"),
        ('"' + "x" * (16 << 20) + '"', "larger than 16777216 bytes"),
        ('{"name": "a\\nb"}', r"every text must be printable, found 'a\\nb'"),
        ('{"a": [{"\\u001b[2J": 1}]}', r"every text must be printable, found '\\x1b\[2J'"),
        ('["\\ud800"]', r"every text must be printable, found '\\ud800'"),
        ('["\\u202e"]', r"every text must be printable, found '\\u202e'"),
    ],
)
def test_json_that_is_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "x.json").write_text(text)
    with pytest.raises(DataError, match=message):
        read_json(tmp_path / "x.json")


def test_bytes_that_are_no_text_are_refused(tmp_path: Path) -> None:
    (tmp_path / "x.json").write_bytes(b"\xff\xfe{}")
    with pytest.raises(DataError, match="not JSON: 'utf-8' codec"):
        read_json(tmp_path / "x.json")


@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir])
def test_what_is_no_file_is_not_waited_for(
    entry: Path, tmp_path: Path, make: Callable[[Path], None]
) -> None:
    make(entry.with_name("x.json"))
    with pytest.raises(DataError, match=r"x\.json: must be a file"):
        read_entries(tmp_path / "results")


def repeated(text: str, rows: int) -> pa.DictionaryArray:
    """One text in every row, in memory once; in the file its type is plain text."""
    return pa.DictionaryArray.from_arrays(pa.array([0] * rows, pa.int32()), [text])


@pytest.mark.parametrize(
    ("column", "message"),
    [
        (lambda: pa.nulls(2_000_000, pa.float64()), "got 2000000 in "),
        (lambda: pa.array([], pa.float64()), "a table must have 1 to 100000 rows"),
        (lambda: ["x" * (17 << 20)], "1 to 100000 rows in at most 16777216 bytes"),
        (lambda: repeated("x" * (1 << 20), 1000), "a has a text of 1048576 bytes, at most 1000"),
    ],
)
def test_small_files_that_fill_the_memory_are_refused(
    column: Callable[[], Any], message: str
) -> None:
    data = parquet(pa.table({"a": column()}))
    assert len(data) < 100_000
    with pytest.raises(DataError, match=message):
        read_table(data)


def test_a_table_of_scores_is_read_as_it_is() -> None:
    table = pa.table({"object_id": ["a", "b"], "error": [0.5, 1.5], "none": pa.nulls(2)})
    assert read_table(parquet(table)).to_pylist() == table.to_pylist()


@pytest.mark.parametrize("data", [b"", b"PAR1" + b"x" * 100 + b"PAR1"])
def test_objects_that_are_no_table_are_told(entry: Path, tmp_path: Path, data: bytes) -> None:
    with_objects(entry, data)
    with pytest.raises(DataError, match="its objects cannot be summed up: ArrowInvalid"):
        read_entries(tmp_path / "results")


def filled(table: pa.Table, column: Any) -> pa.Table:
    """A table of the same columns, each of these values."""
    return pa.table(dict.fromkeys(table.column_names, column))


@pytest.mark.parametrize(
    "change",
    [
        lambda table: table.select(table.column_names[:3]),
        lambda table: pa.concat_tables([table, table]),
        *(
            pytest.param(change, marks=pytest.mark.slow)
            for change in (
                lambda table: table.slice(0, 0),
                lambda table: filled(table, ["x"] * table.num_rows),
                lambda table: filled(table, [[[1.0]]] * table.num_rows),
                lambda table: filled(table, pa.nulls(table.num_rows)),
            )
        ),
    ],
)
def test_objects_of_another_kind_are_told(
    entry: Path, tmp_path: Path, change: Callable[[pa.Table], pa.Table]
) -> None:
    assert len(read_entries(tmp_path / "results")) == 1
    with_objects(entry, parquet(change(pq.read_table(entry.with_suffix(".parquet")))))
    with pytest.raises(DataError, match=r"cannot be summed up|is not what the objects in"):
        read_entries(tmp_path / "results")


@pytest.mark.parametrize("track", ["../..", "/tmp", "rgb/.."])  # noqa: S108
def test_an_entry_that_names_another_place_is_refused(
    entry: Path, tmp_path: Path, track: str
) -> None:
    entry.write_text(json.dumps({**json.loads(entry.read_text()), "track": track}))
    with pytest.raises(DataError, match="the inputs lead to 'geometry'"):
        read_entries(tmp_path / "results")
