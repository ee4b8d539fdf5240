"""The answers of an object as bytes, the same for the same answers, and their commitment."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping
from typing import Any, Final

from xden1k.errors import DataError
from xden1k.folder.withheld import ANSWER_COLUMNS
from xden1k.format.schema import ARRAY_COLUMNS
from xden1k.format.shards import Row
from xden_bench.sealed.key import Key

__all__ = ["SALT_BYTES", "answers_bytes", "answers_row", "commitment", "salt_of"]

SALT_BYTES: Final = 64
_ARRAYS: Final = tuple(name for name in ANSWER_COLUMNS if name in ARRAY_COLUMNS)
_KEYS: Final = {"object_id", *ANSWER_COLUMNS}


def answers_bytes(row: Mapping[str, Any]) -> bytes:
    """Return the answers of an encoded row as JSON, keys sorted, no spaces, ASCII.

    Numbers are as Python writes them, the shortest text that reads back as the same number; the
    bytes of arrays are in Base64.

    Parameters
    ----------
    row
        With ``object_id`` and every answer.
    """
    values = {name: row[name] for name in sorted(_KEYS)}
    for name in _ARRAYS:
        if values[name] is not None:
            values[name] = base64.b64encode(values[name]).decode("ascii")
    return json.dumps(values, sort_keys=True, separators=(",", ":")).encode("ascii")


def answers_row(data: bytes) -> Row:
    """Return the columns that :func:`answers_bytes` wrote.

    Raises
    ------
    DataError
        If the columns are others than today's.
    """
    row: Row = json.loads(data)
    if row.keys() != _KEYS:
        raise DataError(f"sealed by another version: columns {sorted(row.keys() ^ _KEYS)} differ")
    return row | {name: base64.b64decode(row[name]) for name in _ARRAYS if row[name] is not None}


def salt_of(object_id: str, manifest_sha256: str, key: Key) -> bytes:
    """Return an object's salt, which nobody without the key can guess; another in each dataset."""
    return key.derive("salt", manifest_sha256, object_id)


def commitment(salt: bytes, answers: bytes) -> str:
    """Return SHA-256 of salt and answers, hexadecimal.

    Whoever published it cannot find other answers for it; whoever lacks the salt cannot try
    answers on it.
    """
    return hashlib.sha256(salt + answers).hexdigest()
