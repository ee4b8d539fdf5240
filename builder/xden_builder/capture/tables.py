"""Tables of TOML and CSV files that know where they stand, so that every message can say it."""

from __future__ import annotations

import csv
import io
import math
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from xden1k.errors import DataError
from xden_builder.capture.damage import decoding

__all__ = [
    "CsvRow",
    "TomlTable",
    "is_number",
    "is_positive",
    "is_vector",
    "number_or_nan",
    "read_csv",
    "refuse_wrong",
]

MOST_TOLD = 10
"""Rows that are wrong beside the first."""

Check = Callable[[Any], bool]


def is_number(value: object) -> bool:
    """Whether a TOML value is a finite number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300


def is_positive(value: Any) -> bool:
    """Whether a TOML value is a finite number above zero."""
    return is_number(value) and value > 0


def is_vector(value: object) -> bool:
    """Whether a TOML value is three finite numbers."""
    return isinstance(value, list) and len(value) == 3 and all(map(is_number, value))


def number_or_nan(text: str) -> float:
    """Read a number of a CSV file; what is none is not a number.

    Examples
    --------
    >>> number_or_nan("1e3"), number_or_nan("1_000")
    (1000.0, nan)
    """
    try:
        return math.nan if "_" in text else float(text)
    except ValueError:
        return math.nan


@dataclass(frozen=True)
class TomlTable:
    """One table of a TOML file.

    Parameters
    ----------
    file
        The file it stands in.
    prefix
        Its dotted name with a last dot, such as ``views.pa.``; empty for the file itself.
    values
        Its keys and values.
    """

    file: Path
    prefix: str
    values: Mapping[str, Any]

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def error(self, key: str, message: str) -> DataError:
        """Return an error that names the file and the key."""
        return DataError(f"{self.file}: {self.prefix}{key} {message}")

    def refuse_unknown(self, known: Collection[str]) -> None:
        """Raise DataError if the table holds a key that is not known."""
        if unknown := sorted(self.values.keys() - set(known)):
            raise self.error(unknown[0], f"is not a known key; known keys are {', '.join(known)}")

    def get(self, key: str, check: Check, expected: str) -> Any:
        """Return the value of a key that must be there.

        Raises
        ------
        DataError
            If the key is missing or its value fails the check.
        """
        if key not in self.values:
            raise self.error(key, f"is missing, expected {expected}")
        value = self.values[key]
        if not check(value):
            raise self.error(key, f"must be {expected}, got {value!r}")
        return value

    def get_or_none(self, key: str, check: Check, expected: str) -> Any:
        """Return the value of a key, or None where it is absent."""
        return self.get(key, check, expected) if key in self.values else None

    def choice(self, key: str, options: Sequence[str]) -> str:
        """Return the value of a key that must be one of a few words."""
        return str(self.get(key, lambda value: value in options, " or ".join(options)))

    def table(self, key: str) -> TomlTable:
        """Return the table of that name, empty where it is absent."""
        values = self.get_or_none(key, lambda value: isinstance(value, dict), "a table")
        return TomlTable(self.file, f"{self.prefix}{key}.", values or {})


@dataclass(frozen=True)
class CsvRow:
    """One row of a CSV file, as text.

    Parameters
    ----------
    file
        The file it stands in.
    number
        The row's number as a spreadsheet shows it: the header is row 1.
    values
        Column to text without surrounding blanks; every known column is there, empty where the
        file has none.
    """

    file: Path
    number: int
    values: Mapping[str, str]

    def __getitem__(self, column: str) -> str:
        return self.values[column]

    def error(self, column: str, message: str) -> DataError:
        """Return an error that names file, row and column."""
        return DataError(f"{self.file}: row {self.number}, {column}: {message}")

    def choice(self, column: str, options: Sequence[str], default: str = "") -> str:
        """Return the text of a column that must be one of a few words, if there is any."""
        text = self[column] or default
        if text not in options:
            raise self.error(column, f"must be one of {', '.join(options)}, got {text!r}")
        return text


def read_csv(path: Path, required: Sequence[str], optional: Sequence[str]) -> list[CsvRow]:
    """Read a CSV file of known columns; rows without any text are left out.

    Parameters
    ----------
    path
        UTF-8, comma-separated, with a header.
    required, optional
        The columns that must and may be there; a required one holds text in every row.

    Raises
    ------
    DataError
        If the file is missing or no CSV, lacks a required column, has an unknown one, a row is
        longer than the header, or a required field is empty.
    """
    frame = _read_frame(path)
    known = (*required, *optional)
    for column in frame.columns:
        if column not in known:
            raise DataError(f"{path}: unknown column {column!r}; columns are {', '.join(known)}")
    for column in required:
        if column not in frame.columns:
            raise DataError(f"{path}: column {column} is missing")
    frame = frame.reindex(columns=list(known), fill_value="").fillna("")
    rows = [
        CsvRow(path, number, {name: text.strip() for name, text in zip(known, texts, strict=True)})
        for number, texts in enumerate(frame.itertuples(index=False, name=None), start=2)
    ]
    rows = [row for row in rows if any(row.values.values())]
    for row in rows:
        for column in required:
            if not row[column]:
                raise row.error(column, "must not be empty")
    return rows


def refuse_wrong(rows: Mapping[int, DataError]) -> None:
    """Raise what is wrong with the first row, and name the others.

    Parameters
    ----------
    rows
        What is wrong with each, by its number.
    """
    if not rows:
        return
    first, *others = rows
    told = ", ".join(map(str, others[:MOST_TOLD]))
    more = f" and {len(others) - MOST_TOLD} more" if len(others) > MOST_TOLD else ""
    too = f"; wrong too: row {told}{more}" if others else ""
    raise DataError(f"{rows[first]}{too}") from rows[first]


def _without_empty_columns(path: Path, header: Sequence[str], frame: pd.DataFrame) -> pd.DataFrame:
    """Leave out columns without a name and any text, as spreadsheets write them after the last."""
    nameless = [number for number, name in enumerate(header) if not name.strip()]
    for number in nameless:
        texts = frame.iloc[:, number].fillna("").str.strip()
        if texts.any():
            row = int(np.flatnonzero(texts)[0])
            raise DataError(
                f"{path}: column {number + 1} has no name, and {texts.iloc[row]!r} stands in it in "
                f"row {row + 2}"
            )
    return frame.iloc[:, [number for number in range(len(header)) if number not in nameless]]


def _read_frame(path: Path) -> pd.DataFrame:
    """Read the table as text only: an object called NA or 007 stays what it is."""
    if not path.is_file():
        raise DataError(f"{path}: no such file")
    text = _text(path)
    with decoding(path, "a table of comma-separated values", csv.Error):
        _refuse_long_rows(path, text)
        frame = pd.read_csv(
            io.StringIO(text),
            dtype=str,
            keep_default_na=False,
            index_col=False,
            skip_blank_lines=False,
        )
        header, *_ = csv.reader(io.StringIO(text, newline=None))
    return _without_empty_columns(path, header, frame)


def _refuse_long_rows(path: Path, text: str) -> None:
    """Raise DataError at a column that is there twice, and a row longer than the header."""
    header, *rows = csv.reader(io.StringIO(text, newline=None))
    if twice := [name for name, count in Counter(header).items() if name and count > 1]:
        raise DataError(f"{path}: column {twice[0]} is there twice")
    for number, fields in enumerate(rows, start=2):
        if len(fields) > len(header):
            raise DataError(
                f"{path}: row {number}: {len(fields)} fields, expected at most {len(header)} as in "
                f"the header, got {','.join(fields)!r}; write decimals with a point, and put text "
                "with a comma in quotes"
            )


def _text(path: Path) -> str:
    """Decode a table, and refuse other separators than commas, which many spreadsheets write."""
    raw = path.read_bytes()
    try:
        text = raw.decode("utf-8-sig")  # spreadsheets begin a file with a byte-order mark
    except UnicodeDecodeError as err:
        row = len(raw[: err.start + 1].splitlines())
        raise DataError(
            f"{path}: row {row}: must be UTF-8, got byte 0x{raw[err.start]:02x}; save the table as "
            "UTF-8"
        ) from err
    if not text.strip():
        raise DataError(f"{path}: is empty, expected a header and a row for each entry")
    header, *_ = text.splitlines()
    for mark, name in ((";", "semicolons"), ("\t", "tabs")):
        if mark in header and "," not in header:
            raise DataError(
                f"{path}: columns must be separated by commas, got {name}: {header!r}; save the "
                "table with commas"
            )
    return text
