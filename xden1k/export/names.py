"""Names that every format, and every file system, can hold."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable
from typing import Final

__all__ = ["file_name", "written_names"]

LONGEST: Final = 60
RESERVED: Final = frozenset(
    {
        "world",  # MJCF, SDF
        *("con", "prn", "aux", "nul"),  # Windows, with any suffix
        *(f"{port}{number}" for port in ("com", "lpt") for number in range(1, 10)),
    }
)
"""What stands for something else somewhere."""


def written_names(names: Iterable[str]) -> list[str]:
    """Map each name to ASCII letters, digits and underscores, a letter first, each to its own.

    That is what USD takes for a prim and what URDF, SDF and file systems take without quoting; one
    rule for all formats, so that a part is called the same in each. Names differ by more than
    case, since file systems may not see case.

    Examples
    --------
    >>> written_names(["handle", "2nd blade", "2nd/blade", "Griff-Hälfte", "手"])
    ['handle', 'n_2nd_blade', 'n_2nd_blade_2', 'Griff_Halfte', 'n']
    """
    taken: set[str] = set()
    return [_unique(_plain(name), taken) for name in names]


def file_name(object_id: str) -> str:
    """Name files after an object: its id, unless a file system could not hold it.

    Examples
    --------
    >>> file_name("hammer-0003"), file_name("../etc")
    ('hammer-0003', 'etc')
    """
    plain = re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]*", object_id) and len(object_id) <= LONGEST
    return object_id if plain and object_id.lower() not in RESERVED else _plain(object_id)


def _plain(name: str) -> str:
    ascii_only = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
    word = re.sub(r"[^A-Za-z0-9]+", "_", ascii_only).strip("_")[:LONGEST]
    return word if word[:1].isalpha() and word.lower() not in RESERVED else f"n_{word}".rstrip("_")


def _unique(word: str, taken: set[str]) -> str:
    choice, number = word, 1
    while choice.lower() in taken:
        number += 1
        choice = f"{word}_{number}"
    taken.add(choice.lower())
    return choice
