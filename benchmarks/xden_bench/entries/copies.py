"""Entries that are copies of others, told by their arrays and by the errors of their objects."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import pyarrow as pa
from jaxtyping import Float64

from xden1k.errors import DataError
from xden_bench.entries.admission import EnteredError, board_of, is_trivial_entry, owner
from xden_bench.entries.untrusted import read_limited, read_table
from xden_bench.scoring.metrics import METRICS
from xden_bench.scoring.names import skeleton
from xden_bench.scoring.protocol import load_rules

__all__ = [
    "NEAR",
    "Likeness",
    "agree",
    "came",
    "likeness",
    "precedes",
    "refuse_earlier_copy",
]

Entry = Mapping[str, Any]
UNREADABLE: Final = (DataError, OSError, pa.ArrowException, KeyError, TypeError, ValueError)
"""What reading a damaged file of objects may raise."""
NEAR: Final[Mapping[str, float]] = {"density_mae_g_cm3": 0.05, "iou_a": 0.015}
"""Median over objects of the relative difference of two errors, below which they are a copy.

By the metric that ranks. Densities: of the entries of protocol v2 the nearest of two honest
methods, networks of one design with other inputs, are 0.085 apart; noise of a thousandth on every
voxel makes 0.004 where errors are a tenth of the density. IoU: an error of 50 % differs by little
whatever a method does, so that seeds of one network, and the nearest two networks, are 0.023
apart, and one that learned is 0.045 from a rule that did not; other labels for one in a hundred
points make 0.006 to 0.011, and cost 0.4 to 0.8 % of IoU, for two in a hundred 0.013 to 0.021."""


class Likeness(NamedTuple):
    """What an entry is recognised by: its arrays, and the errors of its objects."""

    arrays_sha256: str | None
    errors: Float64[np.ndarray, "objects"]
    near: float


def likeness(entry: Entry) -> Likeness:
    """Read it from an entry that has the scores of its objects (``object_scores``)."""
    name = load_rules(entry["protocol"]).rank_by
    errors = np.abs(np.array(entry["object_scores"][name], dtype=np.float64) - METRICS[name].best)
    return Likeness(entry.get("arrays_sha256"), errors, NEAR[name])


def agree(one: Likeness, other: Likeness) -> bool:
    """Whether two entries have the same arrays, or errors as near as no two methods have."""
    if one.arrays_sha256 is not None and one.arrays_sha256 == other.arrays_sha256:
        return True
    if one.errors.shape != other.errors.shape:
        return False
    larger, gap = np.maximum(one.errors, other.errors), np.abs(one.errors - other.errors)
    apart = np.divide(gap, larger, out=np.zeros_like(larger), where=larger > 0)
    return bool(np.median(apart[~np.isnan(larger)]) < one.near)


def came(row: Entry) -> tuple[str, str, str]:
    """Sort rows by when they came; of one day, by checksum."""
    return row["date"], row["submission_sha256"], row["method"]["name"]


def refuse_earlier_copy(entry: Entry, others: Iterable[tuple[Path, Entry]], results: Path) -> None:
    """Refuse a copy of an entry that is there, if its date or checksum would put it first.

    Parameters
    ----------
    entry
        The one that is to be added, with the scores of its objects.
    others
        Those that are there: :func:`xden_bench.entries.admission.light_entries`.
    results
        The folder that these lie in.

    Raises
    ------
    EnteredError
        If it is one.
    """
    own = likeness(entry)
    for path, other in others:
        if board_of(entry) != board_of(other) or not precedes(entry, other):
            continue
        theirs = None
        with suppress(*UNREADABLE):  # read_entries tells of it
            data = read_limited((results / path).with_suffix(".parquet"))
            theirs = likeness({**other, "object_scores": read_table(data).to_pydict()})
        if theirs is not None and agree(own, theirs):
            raise EnteredError(
                f"its errors are nearly those of {path}, which was entered before: by date and "
                "checksum it would come first, and take its rank"
            )


def precedes(one: Entry, other: Entry) -> bool:
    """Whether one comes before another author's, which would have no rank if they were copies.

    Trivial methods do not: W505 tells of these.

    Parameters
    ----------
    one, other
        Entries or rows.
    """
    if is_trivial_entry(one) or is_trivial_entry(other):
        return False
    return came(one) < came(other) and not _of_one_author(one, other)


def _of_one_author(one: Entry, other: Entry) -> bool:
    """Whether two entries are of one team; unsigned ones if they have one name."""
    if owner(one) != owner(other):
        return False
    names = (skeleton(each["method"]["name"]) for each in (one, other))
    return owner(one) is not None or len({*names}) == 1
