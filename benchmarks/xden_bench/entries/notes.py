"""Notes: signed JSON files beside an entry, which is itself never edited."""

from __future__ import annotations

import datetime
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from xden1k.errors import DataError
from xden1k.format.checksums import file_sha256
from xden_bench.entries.durable import write_text
from xden_bench.entries.signing import SigningKey, is_public_key, is_signed
from xden_bench.entries.untrusted import read_json

__all__ = ["read_note", "uncounted_because", "write_note"]


def write_note(path: Path, entry: Path, values: Mapping[str, Any], key: SigningKey | None) -> None:
    """Write a note; one that is there is replaced.

    Parameters
    ----------
    path
        The note's file.
    entry
        The entry's JSON file: the note holds its checksum and is for no other.
    values
        What it says, its schema among it.
    key
        Whose word it is; None leaves it unsigned, and then it counts nothing.
    """
    bound = {**values, "entry_sha256": file_sha256(entry)}
    made = bound if key is None else key.signed({**bound, "public_key": key.public_key})
    write_text(path, json.dumps(made, indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def read_note(path: Path, entry: Path, schema: str, keys: Mapping[str, type]) -> dict[str, Any]:
    """Read a note; whether it counts is another question (:func:`uncounted_because`).

    Parameters
    ----------
    path
        The note's file.
    entry
        The entry's JSON file.
    schema
        Of the note.
    keys
        What it must hold beside, and the type of each.

    Raises
    ------
    DataError
        If it is no such note, or one for other contents of the entry.
    OSError
        If there is no such file.
    """
    values: dict[str, Any] = read_json(path)
    try:
        if values["schema"] != schema:
            raise ValueError(f"schema {values['schema']!r}")
        expected = {"schema": str, "entry_sha256": str, "date": str, **keys}
        if wrong := [key for key, kind in expected.items() if not isinstance(values[key], kind)]:
            raise ValueError(f"of the wrong type: {wrong}")
        if unknown := values.keys() - expected.keys() - {"public_key", "signature"}:
            raise ValueError(f"unknown keys {sorted(unknown)}")
        datetime.date.fromisoformat(values["date"])
    except (ValueError, TypeError, KeyError) as err:
        raise DataError(f"{path}: not a note of schema {schema}: {err!r}") from err
    if (found := file_sha256(entry)) != (stated := values["entry_sha256"]):
        raise DataError(f"{path}: it is for an entry of sha256 {stated}, {entry.name} has {found}")
    return values


def uncounted_because(note: Mapping[str, Any], trusted: Mapping[str, str]) -> str | None:
    """Why a note counts nothing, or None if it is signed by a trusted key.

    Parameters
    ----------
    note
        From :func:`read_note`.
    trusted
        Names by public key.
    """
    key = str(note.get("public_key"))
    if not is_public_key(key):
        return "it is not signed"
    if key not in trusted:
        return f"the key {key[:8]} is not trusted here"
    return None if is_signed(note, key) else f"its signature is not that of {trusted[key]}"
