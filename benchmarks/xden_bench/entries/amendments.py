"""What a team says of its entry later: that it withdraws it, or what was wrong with it.

Entries are never deleted or edited. NAME.withdrawn.json and NAME.erratum.json lie beside one,
signed by its team or by a maintainer; of any other key they count nothing.
"""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, Literal, get_args

from xden1k.errors import DataError
from xden_bench.entries.notes import read_note, uncounted_because, write_note
from xden_bench.entries.signing import SigningKey

__all__ = ["KINDS", "Kind", "amend", "amendment_path", "read_amendments"]

SCHEMA: Final = "xden-amendment/1"
Kind = Literal["withdrawn", "erratum"]
KINDS: Final[tuple[Kind, ...]] = get_args(Kind)
MAX_TEXT: Final = 500


def amendment_path(entry: Path, kind: Kind) -> Path:
    """Where an amendment of an entry lies."""
    return entry.with_suffix(f".{kind}.json")


def amend(entry: Path, kind: Kind, text: str, date: datetime.date, key: SigningKey) -> Path:
    """Write an amendment.

    Parameters
    ----------
    entry
        The entry's JSON file.
    kind
        ``withdrawn``: the row stays, struck out, and has no rank. ``erratum``: it says what was
        wrong.
    text
        Why, one printable line of at most 500 characters.
    date
        When.
    key
        The team's, or a maintainer's.

    Raises
    ------
    DataError
        If there is one already, or the text is none that can be printed.
    """
    path = amendment_path(entry, kind)
    if path.exists():
        raise DataError(f"{path} is there already: it is never changed")
    if not text.strip() or len(text) > MAX_TEXT or not text.isprintable():
        raise DataError(f"the reason must be one line of 1 to {MAX_TEXT} characters, got {text!a}")
    values = {"schema": SCHEMA, "kind": kind, "text": text, "date": date.isoformat()}
    write_note(path, entry, values, key)
    return path


def read_amendments(
    path: Path, entry: Mapping[str, Any], maintainers: Mapping[str, str]
) -> tuple[dict[str, Any], list[str]]:
    """Read what lies beside an entry.

    Parameters
    ----------
    path
        Its JSON file.
    entry
        Its content, which names its team.
    maintainers
        Names by public key.

    Returns
    -------
    amendments, remarks
        By kind those that count, and why others do not.

    Raises
    ------
    DataError
        If a file is no amendment, or one for other contents of the entry.
    """
    team = entry.get("team")
    trusted = {**maintainers, **({team["public_key"]: team["name"]} if team else {})}
    found: dict[str, Any] = {}
    remarks = []
    for kind in KINDS:
        if not (note_path := amendment_path(path, kind)).exists():
            continue
        note = read_note(note_path, path, SCHEMA, {"kind": str, "text": str})
        if note["kind"] != kind:
            raise DataError(f"{note_path}: kind must be {kind!r}, got {note['kind']!r}")
        if reason := uncounted_because(note, trusted):
            remarks.append(f"a note ({kind}) counts nothing: {reason}")
        else:
            found[kind] = note
    return found, remarks
