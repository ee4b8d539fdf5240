"""What a maintainer adds beside an entry whose numbers came out again: NAME.recomputed.json.

The entry itself is never edited. The file beside it holds the entry's checksum, so that it vouches
for no other one; its word is the maintainer's, and reviewed as the entry was.
"""

from __future__ import annotations

import datetime
import hashlib
import json
from pathlib import Path
from typing import Any, Final, Literal

from xden1k.errors import DataError
from xden_bench.entries.provenance import code_commit, package_version
from xden_bench.entries.untrusted import read_json

__all__ = ["SUFFIX", "How", "read_recomputed", "write_recomputed"]

SCHEMA: Final = "xden-recomputed/1"
SUFFIX: Final = ".recomputed.json"
How = Literal["remade", "rescored"]
"""``remade``: the method ran again. ``rescored``: the stored submission was scored again."""


def write_recomputed(
    entry: Path, how: How, largest_relative_difference: float, command: str, date: datetime.date
) -> Path:
    """Note beside an entry that its numbers came out again.

    Parameters
    ----------
    entry
        Its JSON file.
    how
        In which way.
    largest_relative_difference
        Between a number of the entry and the one found.
    command
        That found it.
    date
        When.

    Raises
    ------
    DataError
        If there is such a note already.
    """
    values = {
        "schema": SCHEMA,
        "entry_sha256": _sha256(entry),
        "how": how,
        "largest_relative_difference": largest_relative_difference,
        "command": command,
        "date": date.isoformat(),
        "xden_version": package_version(),
        "commit": code_commit(),
    }
    path = entry.with_suffix(SUFFIX)
    try:
        with path.open("x", encoding="utf-8", newline="\n") as stream:
            stream.write(json.dumps(values, indent=2) + "\n")
    except FileExistsError as err:
        raise DataError(f"{path} is there already: it is never changed") from err
    return path


def read_recomputed(entry: Path) -> dict[str, Any] | None:
    """Read the note beside an entry, or None if there is none.

    Parameters
    ----------
    entry
        Its JSON file.

    Raises
    ------
    DataError
        If it is no such note, or one for other contents of the entry.
    """
    path = entry.with_suffix(SUFFIX)
    if not path.exists():
        return None
    try:
        values: dict[str, Any] = read_json(path)
        if values["schema"] != SCHEMA or values["how"] not in ("remade", "rescored"):
            raise ValueError(f"schema {values['schema']!r}, how {values['how']!r}")
        values["date"] = datetime.date.fromisoformat(values["date"]).isoformat()
        found, stated = _sha256(entry), values["entry_sha256"]
    except (ValueError, TypeError, KeyError) as err:
        raise DataError(f"{path}: not a note of schema {SCHEMA}: {err!r}") from err
    if found != stated:
        raise DataError(f"{path}: it is for an entry of sha256 {stated}, {entry.name} has {found}")
    return values


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
