"""What a maintainer adds beside an entry whose numbers came out again: NAME.recomputed.json.

It says what came out again and what nobody can find again, and is signed: a note of no trusted key
(:func:`xden_bench.entries.signing.read_maintainers`) counts nothing.
"""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

from xden1k.errors import DataError
from xden_bench.entries.notes import read_note, uncounted_because, write_note
from xden_bench.entries.provenance import code_commit, package_version
from xden_bench.entries.signing import SigningKey, read_maintainers

if TYPE_CHECKING:
    from xden_bench.entries.verification import Verification

__all__ = ["SUFFIX", "How", "read_recomputed", "write_recomputed"]

SCHEMA: Final = "xden-recomputed/2"
SUFFIX: Final = ".recomputed.json"
How = Literal["remade", "rescored"]
"""``remade``: the method ran again. ``rescored``: the stored submission was scored again."""
_KEYS: Final[Mapping[str, Any]] = {
    "how": str,
    "vouches_for": list,
    "not_verifiable": list,
    "largest_relative_difference": float,
    "command": str,
    "xden_version": str,
    "commit": (str, type(None)),
}


def write_recomputed(
    entry: Path,
    how: How,
    found: Verification,
    command: str,
    date: datetime.date,
    key: SigningKey | None,
    results: Path,
) -> Path:
    """Note beside an entry that it came out again.

    Parameters
    ----------
    entry
        Its JSON file.
    how
        In which way.
    found
        What was compared.
    command
        That found it.
    date
        When.
    key
        The maintainer's; None leaves the note unsigned, and then it counts nothing.
    results
        The folder of all entries.

    Raises
    ------
    DataError
        If something differs, or there is such a note already that counts.
    """
    path = entry.with_suffix(SUFFIX)
    if found.deviations:
        raise DataError(f"{entry}: {found.deviations[0]}: nothing to vouch for")
    if path.exists() and read_recomputed(entry, read_maintainers(results))[0] is not None:
        raise DataError(f"{path} is there already: it is never changed")
    values = {
        "schema": SCHEMA,
        "how": how,
        "vouches_for": list(found.compared),
        "not_verifiable": list(found.not_verifiable),
        "largest_relative_difference": found.largest_relative_difference,
        "command": command,
        "date": date.isoformat(),
        "xden_version": package_version(),
        "commit": code_commit(),
    }
    write_note(path, entry, values, key)
    return path


def read_recomputed(
    entry: Path, maintainers: Mapping[str, str]
) -> tuple[dict[str, Any] | None, str | None]:
    """Read the note beside an entry.

    Parameters
    ----------
    entry
        Its JSON file.
    maintainers
        Names by public key.

    Returns
    -------
    note, remark
        The note if there is one that counts, and why one that is there does not.

    Raises
    ------
    DataError
        If it is no such note, or one for other contents of the entry.
    """
    path = entry.with_suffix(SUFFIX)
    if not path.exists():
        return None, None
    note = read_note(path, entry, SCHEMA, _KEYS)
    if note["how"] not in ("remade", "rescored"):
        raise DataError(f"{path}: not a note of schema {SCHEMA}: how {note['how']!r}")
    if reason := uncounted_because(note, maintainers):
        return None, f"a note that it was recomputed counts nothing: {reason}"
    return note, None
