"""What each flag means, how grave it is, and what to do: ``flags.csv``, the gravest first."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from types import MappingProxyType
from typing import Any, Literal

__all__ = ["FlagKind", "Severity", "flag_kind", "flag_kinds"]

Severity = Literal["needs_you", "information"]
"""``needs_you``: a person must look, or a number may be wrong without a word. ``information``: the
standard deviation says it already, or nothing is wrong."""


@dataclass(frozen=True, slots=True)
class FlagKind:
    """One flag.

    Parameters
    ----------
    flag
        Its name.
    severity
        Whether a person must look.
    meaning, remedy
        In one sentence each: what is so, what to do.
    """

    flag: str
    severity: Severity
    meaning: str
    remedy: str


@cache
def flag_kinds() -> Mapping[str, FlagKind]:
    """Return every flag of this version by its name, the gravest first.

    Examples
    --------
    >>> flag_kinds()["uncertain"].severity
    'information'
    """
    text = (files(__package__) / "flags.csv").read_text(encoding="utf-8")
    rows: Iterable[Any] = csv.DictReader(text.splitlines())
    return MappingProxyType({row["flag"]: FlagKind(**row) for row in rows})


def flag_kind(flag: str) -> FlagKind:
    """Look a flag up; one that this version does not know needs a person.

    Examples
    --------
    >>> flag_kind("from_the_future").severity
    'needs_you'
    """
    unknown = FlagKind(
        flag,
        "needs_you",
        "a flag that this version does not know",
        "see the manual of the version that made the dataset",
    )
    return flag_kinds().get(flag, unknown)
