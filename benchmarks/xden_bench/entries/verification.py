"""Does an entry come out again? All that it says against what is found now."""

from __future__ import annotations

import datetime
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from operator import eq
from typing import Any, Final

from xden1k.errors import DataError
from xden_bench.entries.entry_form import FIRST_SCHEMA, MEASURED
from xden_bench.entries.result import entry_of, object_columns
from xden_bench.scoring.bootstrap import SAME
from xden_bench.scoring.protocol import load_rules
from xden_bench.scoring.reference import RECOMPUTED, Reference
from xden_bench.scoring.score import Score

__all__ = ["Deviation", "Verification", "check_reference", "deviations", "verify"]


NOT_VERIFIABLE: Final = ("command", "commit", "date", "xden_version")
"""Of the place and time of a scoring: only a signature vouches for them."""
OF_ONE_RUN: Final = (
    *("arrays_sha256", "submission_sha256", "method.seconds_per_object"),
    *(f"method.{key}" for key in sorted(MEASURED)),
)
"""What another run of the same method changes: its cost, and the last digit on another machine."""


@dataclass(frozen=True, slots=True)
class Deviation:
    """What an entry says and what did not come out again.

    Parameters
    ----------
    where
        Its place, such as ``metrics.mass_mape.mean``.
    entry, found
        What the entry says and what came out; None where one of them has nothing there.
    """

    where: str
    entry: Any
    found: Any

    def __str__(self) -> str:
        return f"{self.where}: the entry has {self.entry}, found {self.found}"


@dataclass(frozen=True, slots=True)
class Verification:
    """What came of verifying an entry.

    Parameters
    ----------
    numbers
        How many were compared.
    largest_relative_difference
        Of those that agree within the tolerance and of all others.
    deviations
        What does not agree.
    same_file
        Whether the submission is, byte for byte, that of the entry.
    compared
        Keys of the entry whose values were compared, whole.
    not_verifiable
        Places whose values nobody can find again.
    """

    numbers: int
    largest_relative_difference: float
    deviations: tuple[Deviation, ...]
    same_file: bool
    compared: tuple[str, ...]
    not_verifiable: tuple[str, ...]


def check_reference(entry: Mapping[str, Any], reference: Reference) -> None:
    """Refuse to verify an entry where its numbers cannot come out again.

    Raises
    ------
    DataError
        If the dataset or the metrics' code is not what the entry was made with.
    """
    data, rules = entry["dataset"], load_rules(entry["protocol"])
    for name, stated, found in (
        ("manifest", data["manifest_sha256"], reference.manifest_sha256),
        ("split", data["split"], reference.split),
        ("metric version", entry["metric_version"], rules.metric_version),
    ):
        if stated != found:
            raise DataError(f"the entry is of {name} {stated!r}, here is {found!r}")


def verify(
    entry: Mapping[str, Any], score: Score, reference: Reference, tolerance: float = 1e-5
) -> Verification:
    """Make an entry anew from its submission and compare all that it says.

    Texts, checksums and declarations must be the same, numbers up to a tolerance. Of the schema
    before this one, warnings are compared by their codes: they were worded otherwise.

    Parameters
    ----------
    entry
        From :func:`xden_bench.entries.reading.read_entry`.
    score
        From :func:`xden_bench.methods.trivial.score_told`, of its submission or of one made anew.
    reference
        The truth it was made with.
    tolerance
        Relative: what another machine may change. Differences up to 1e-6 never count.
    """
    same_file = score.submission_sha256 == entry["submission_sha256"]
    found = _made_again(entry, score, reference)
    skipped = (*NOT_VERIFIABLE, *(() if same_file else OF_ONE_RUN))
    stated, made = (
        {where: one for where, one in _leaves(values) if where not in skipped}
        for values in (_comparable(entry, found.keys()), _comparable(found, found.keys()))
    )
    both = [
        (stated[where], made[where])
        for where in stated.keys() & made.keys()
        if _is_number(stated[where]) and _is_number(made[where])
    ]
    return Verification(
        numbers=len(both),
        largest_relative_difference=max((_relative(*pair) for pair in both), default=0.0),
        deviations=_deviations(stated, made, partial(_same, tolerance=tolerance)),
        same_file=same_file,
        compared=tuple(sorted(found.keys() - set(skipped))),
        not_verifiable=tuple(sorted(skipped)),
    )


def deviations(stated: Mapping[str, Any], made: Mapping[str, Any]) -> tuple[Deviation, ...]:
    """Every number and text in which two nested values differ at all.

    Parameters
    ----------
    stated, made
        What a file says, and what came out.

    Examples
    --------
    >>> print(*deviations({"a": [1, 2]}, {"a": [1, 3]}))
    a[1]: the entry has 2, found 3
    """
    return _deviations(dict(_leaves(stated)), dict(_leaves(made)), eq)


def _deviations(
    stated: Mapping[str, Any], made: Mapping[str, Any], same: Callable[[Any, Any], bool]
) -> tuple[Deviation, ...]:
    return tuple(
        Deviation(where, stated.get(where), made.get(where))
        for where in sorted(stated.keys() | made.keys())
        if not same(stated.get(where), made.get(where))
    )


def _made_again(entry: Mapping[str, Any], score: Score, reference: Reference) -> dict[str, Any]:
    """Return the entry that the submission gives, as far as it can be compared."""
    date = datetime.date.fromisoformat(entry["date"])
    found = entry_of(score, reference, command=entry["command"], date=date)
    found["object_scores"] = object_columns(score)
    if entry["schema"] == FIRST_SCHEMA:
        found |= {"schema": FIRST_SCHEMA}
        del found["arrays_sha256"]
    if entry["status"] == RECOMPUTED:  # a maintainer's word, told by the note
        found["status"] = RECOMPUTED
    return found


def _comparable(values: Mapping[str, Any], keys: Iterable[str]) -> dict[str, Any]:
    """Those keys of an entry that a scoring makes."""
    kept = {key: values[key] for key in keys if key in values}
    if kept["schema"] == FIRST_SCHEMA:
        kept["warnings"] = [one.partition(":")[0] for one in kept["warnings"]]
    return kept


def _leaves(value: Any, where: str = "") -> Iterator[tuple[str, Any]]:
    """Every number and text in nested dicts and lists, by its place."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _leaves(inner, f"{where}.{key}".lstrip("."))
    elif isinstance(value, list | tuple):
        for place, inner in enumerate(value):
            yield from _leaves(inner, f"{where}[{place}]")
    else:
        yield where, value


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and not _is_nan(value)


def _is_nan(value: Any) -> bool:
    """Whether an object is left out of a metric."""
    return isinstance(value, float) and math.isnan(value)


def _relative(one: float, other: float) -> float:
    """Difference as a share of the larger, 0 where it never counts."""
    apart = abs(one - other)
    return 0.0 if apart <= SAME else apart / max(abs(one), abs(other))


def _same(one: Any, other: Any, tolerance: float) -> bool:
    if _is_number(one) and _is_number(other):
        return math.isclose(one, other, rel_tol=tolerance, abs_tol=SAME)
    return type(one) is type(other) and bool(one == other or (_is_nan(one) and _is_nan(other)))
