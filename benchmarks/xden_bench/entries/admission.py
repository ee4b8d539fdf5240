"""Who may enter what: copies, names that belong to others, and how often a team may."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Final

from xden1k.errors import DataError
from xden_bench.entries.entry_form import OF_FIRST_SCHEMA, read_form
from xden_bench.methods.baseline import builtin_names
from xden_bench.methods.rebuilt import NAMES as REBUILT
from xden_bench.scoring.names import skeleton
from xden_bench.scoring.protocol import is_trivial, load_rules

__all__ = [
    "EnteredError",
    "Owners",
    "Quota",
    "board_of",
    "check_admission",
    "is_trivial_entry",
    "light_entries",
    "owner",
]

Entry = Mapping[str, Any]
PAPER_NAMES: Final = ("NeRF2Physics", "GaussianProperty", "Pixie")
"""Methods of the table in the XDen-1K paper."""
FORMER_NAMES: Final = (
    *("nerf2physics", "nerf2physics-thickness", "pixie", "pixie-full"),
    *("gaussian-property", "gaussian-property-weighted", "gaussian-property-parts"),
)
"""What methods of this package were called while v1 was the protocol: no row has them since."""
STYLE: Final = "-style"
ZERO_SHOT: Final = "-zero-shot"
"""Stands for it in the name of a row that was made with the setting ``zero_shot``."""
ADDITIONS: Final = re.compile(
    r"\b(official|original|authors?|paper|reference|genuine|real|true|baseline|ours|by|the|of"
    r"|re-?implement\w*|implementation|final|v?\d[\d.]*)\b"
)
"""Words that make no other method of a name."""


class EnteredError(DataError):
    """A submission is among the results already."""


@dataclass(frozen=True, slots=True)
class Quota:
    """How often a team may enter; what it withdraws counts too.

    A desk that takes submissions from the web asks :func:`check_admission` with its own quota
    before it writes; entries without a team are limited by whoever takes them.

    Parameters
    ----------
    a_day
        Entries of one date.
    in_all
        Entries of one table's dataset, split and protocol.
    """

    a_day: int = 5
    in_all: int = 100


def owner(entry: Entry) -> str | None:
    """Public key of the team that entered it; None if it is not signed."""
    team = entry.get("team")
    return None if team is None else str(team["public_key"])


def is_trivial_entry(entry: Entry) -> bool:
    """Whether it has the name of one of its protocol's trivial methods."""
    return is_trivial(entry["method"]["name"], load_rules(entry["protocol"]))


def light_entries(results: Path) -> list[tuple[Path, dict[str, Any]]]:
    """Place and content of every entry below a folder, the oldest first, without its objects.

    What is no entry is left out.

    Parameters
    ----------
    results
        Folder of all entries.
    """
    found = []
    for path in sorted(results.rglob("*.json")):
        try:
            found.append((path.relative_to(results), read_form(path)))
        except (DataError, OSError):
            continue  # a note, or read_entries tells of it
    return sorted(found, key=lambda one: (one[1]["date"], str(one[0])))


def check_admission(
    entry: Entry,
    others: Iterable[tuple[Path, Entry]],
    quota: Quota | None = None,
    *,
    by_anyone: bool = False,
) -> None:
    """Refuse an entry that is a copy, takes another's name, or is one too many.

    Parameters
    ----------
    entry
        The one that is to be added.
    others
        Those that are there, from :func:`light_entries`.
    quota
        Of its team; None = the default.
    by_anyone
        Whether nobody looks who sends it: then an unsigned entry is no seed of another's method.

    Raises
    ------
    EnteredError
        If its arrays are entered already, under whatever name, inputs or file. Trivial methods,
        which have no rank, may agree: on categories nobody has seen two of them do.
    DataError
        If its name or its team's belongs to another, or the team has used up its quota.
    """
    known, owners = list(others), Owners()
    trivial = is_trivial_entry(entry)
    for path, other in known:
        same = board_of(entry) == board_of(other)
        if same and not trivial and entry["arrays_sha256"] == other.get("arrays_sha256"):
            raise EnteredError(f"these very predictions are entered already: {path}")
    for path, other in known:
        with suppress(DataError):  # of two that are there, the first has the name
            owners.admit(path, other)
    owners.admit(Path("this submission"), entry)
    if by_anyone and owner(entry) is None:
        _check_seed(entry, known)
    _check_quota(entry, [other for _, other in known], quota or Quota())


@dataclass(frozen=True, slots=True)
class Owners:
    """Whose the names of methods and teams are: of whoever was admitted with one first."""

    _first: dict[tuple[str, str], tuple[Path, str | None]] = field(default_factory=dict)

    def admit(self, path: Path, entry: Entry) -> None:
        """Take the names of an entry down as its owner's.

        Raises
        ------
        DataError
            If one belongs to another key, or is kept for a method of this package or the paper.
        """
        _check_reserved(path, entry)
        names = [("method", entry["method"]["name"])]
        names += [("team", entry["team"]["name"])] if "team" in entry else []
        for kind, name in names:
            first, key = self._first.get((kind, skeleton(name)), (path, owner(entry)))
            if key != owner(entry):
                raise DataError(f"{path}: the {kind} name {name!r} belongs to the entry {first}")
        self._first.update({(kind, skeleton(name)): (path, owner(entry)) for kind, name in names})


def _check_seed(entry: Entry, known: Iterable[tuple[Path, Entry]]) -> None:
    """Refuse another seed of a method that is there: a row is the mean over its seeds.

    One of a seed that is there can do no harm, since the better entry counts.
    """
    name, seed = entry["method"]["name"], entry["method"]["seed"]
    alike = [
        (path, other["method"]["seed"])
        for path, other in known
        if skeleton(name) == skeleton(other["method"]["name"])
        and board_of(entry) == board_of(other)
    ]
    if alike and seed not in [one for _, one in alike]:
        path, other = alike[0]
        here, there = ("no seed" if one is None else f"seed {one}" for one in (seed, other))
        raise DataError(
            f"{name!r} is entered already, of {there} ({path}), and nothing shows that this one, "
            f"of {here}, is of the same author: choose another name, and sign its entries if there "
            "are more seeds (xden-bench submit --signing-key)"
        )


def _check_reserved(path: Path, entry: Entry) -> None:
    """Keep the names of the methods that come with this package, and of the paper's, for these."""
    method = entry["method"]
    bare = skeleton(ADDITIONS.sub(" ", method["name"].casefold()))
    name = _reserved().get(skeleton(method["name"])) or _reserved().get(bare)
    if name is None or is_trivial_entry(entry):
        return  # a trivial method's values are compared with its own
    asked = "root" if name in REBUILT else name.replace(ZERO_SHOT, STYLE)
    former = name in FORMER_NAMES and entry["protocol"] not in OF_FIRST_SCHEMA
    made = _words(method["command"])[:3] == ["xden-bench", "baseline", asked]
    if name in PAPER_NAMES or former:
        raise DataError(f"{path}: the name {method['name']!r} is too near to one of the paper's")
    if method["name"] != name or not made:
        expected = f"what `xden-bench baseline {asked}` made"
        raise DataError(f"{path}: the name {method['name']!r} is kept for {expected}")


@cache
def _reserved() -> dict[str, str]:
    """Names by their skeleton; what the paper and this package call alike is this package's."""
    builtin = builtin_names()
    zero_shot = (one.replace(STYLE, ZERO_SHOT) for one in builtin if STYLE in one)
    names = (*PAPER_NAMES, *FORMER_NAMES, *REBUILT, *builtin, *zero_shot)
    return {skeleton(one): one for one in names}


def _words(command: str) -> list[str]:
    try:
        return shlex.split(command)
    except ValueError:
        return []


def _check_quota(entry: Entry, others: Iterable[Entry], quota: Quota) -> None:
    if (key := owner(entry)) is None:
        return
    own = [one for one in others if owner(one) == key and board_of(one) == board_of(entry)]
    today = sum(one["date"] == entry["date"] for one in own)
    name = entry["team"]["name"]
    if today >= quota.a_day:
        raise DataError(f"the team {name!r} has entered {today} of {quota.a_day} on this day")
    if len(own) >= quota.in_all:
        raise DataError(f"the team {name!r} has entered {len(own)} of {quota.in_all} in all")


def board_of(entry: Entry) -> tuple[str, ...]:
    """Return what two entries must be scored by and on to be copies of each other."""
    data = entry["dataset"]
    return entry["protocol"], data["manifest_sha256"], data["split"], entry["target"]
