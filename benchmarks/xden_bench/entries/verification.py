"""Does an entry's number come out again? Every number of it against those found now."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from xden1k.errors import DataError
from xden_bench.entries.result import figures, object_columns
from xden_bench.scoring.bootstrap import SAME
from xden_bench.scoring.protocol import load_protocol
from xden_bench.scoring.reference import Reference
from xden_bench.scoring.score import Score

__all__ = ["Deviation", "Verification", "check_reference", "verify"]


@dataclass(frozen=True, slots=True)
class Deviation:
    """A number of an entry that did not come out again.

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
    """

    numbers: int
    largest_relative_difference: float
    deviations: tuple[Deviation, ...]
    same_file: bool


def check_reference(entry: Mapping[str, Any], reference: Reference) -> None:
    """Refuse to verify an entry where its numbers cannot come out again.

    Raises
    ------
    DataError
        If the dataset or the metrics' code is not what the entry was made with.
    """
    data, rules = entry["dataset"], load_protocol(entry["protocol"])
    for name, stated, found in (
        ("manifest", data["manifest_sha256"], reference.manifest_sha256),
        ("split", data["split"], reference.split),
        ("metric version", entry["metric_version"], rules.metric_version),
    ):
        if stated != found:
            raise DataError(f"the entry is of {name} {stated!r}, here is {found!r}")


def verify(entry: Mapping[str, Any], score: Score, tolerance: float = 1e-5) -> Verification:
    """Compare every number of an entry with a score made now.

    Parameters
    ----------
    entry
        From :func:`xden_bench.entries.result.read_entry`.
    score
        Of its submission, or of one made anew.
    tolerance
        Relative: what another machine may change. Differences up to 1e-6 never count.
    """
    found = {
        **figures(score.objects, score.protocol),
        "object_scores": object_columns(score),
        "track": score.meta.track,
        "target": score.meta.target,
    }
    stated, made = (dict(_leaves({key: one[key] for key in found})) for one in (entry, found))
    both = [
        (stated[where], made[where])
        for where in stated.keys() & made.keys()
        if _is_number(stated[where]) and _is_number(made[where])
    ]
    return Verification(
        numbers=len(both),
        largest_relative_difference=max((_relative(*pair) for pair in both), default=0.0),
        deviations=tuple(
            Deviation(where, stated.get(where), made.get(where))
            for where in sorted(stated.keys() | made.keys())
            if not _same(stated.get(where), made.get(where), tolerance)
        ),
        same_file=score.submission_sha256 == entry["submission_sha256"],
    )


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
    return isinstance(value, int | float) and not isinstance(value, bool)


def _relative(one: float, other: float) -> float:
    """Difference as a share of the larger, 0 where it never counts."""
    apart = abs(one - other)
    return 0.0 if apart <= SAME else apart / max(abs(one), abs(other))


def _same(one: Any, other: Any, tolerance: float) -> bool:
    if _is_number(one) and _is_number(other):
        return math.isclose(one, other, rel_tol=tolerance, abs_tol=SAME)
    return type(one) is type(other) and bool(one == other)
