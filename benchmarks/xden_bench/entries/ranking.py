"""Which rows of a table can be told apart, and the ranks that follow."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Any, Final

import numpy as np
from jaxtyping import Bool, Float64
from scipy.stats import t as student_t

from xden1k.errors import DataError
from xden_bench.methods.rebuilt import NAMES as REBUILT
from xden_bench.scoring.bootstrap import SAME
from xden_bench.scoring.intervals import sampled
from xden_bench.scoring.metrics import METRICS
from xden_bench.scoring.protocol import Rules, is_trivial, load_rules
from xden_bench.scoring.studentised import Sampled

__all__ = [
    "MERGED",
    "TRIVIAL",
    "Entry",
    "critical_distance",
    "dense_ranks",
    "no_interval_because",
    "rank_label",
    "rank_labels",
    "ranks",
    "row_losses",
    "trusted_interval",
    "trusted_metrics",
    "unranked_because",
    "unsure_because",
    "worse_beyond_doubt",
    "worse_rows",
]

Entry = Mapping[str, Any]
"""As :func:`xden_bench.entries.reading.read_entries` gives it."""

TRIVIAL: Final = "trivial"
MERGED: Final = "merged"
"""Key of the reason why a row counts as another: :mod:`xden_bench.entries.merging`."""

LABELLED: Final = frozenset({"materials", "xray"})
"""A method that is told the materials and measures them is right but for a few objects."""


def worse_beyond_doubt(
    sample: Sampled, error: float, methods: int
) -> Bool[np.ndarray, "rows rows"]:
    """Whether row i is worse than row j beyond doubt, on the same objects.

    The mean difference in units of its standard error lies above :func:`critical_distance`. The
    relation is transitive, since standard errors keep the triangle inequality and the critical
    distance is the same for all pairs.

    Parameters
    ----------
    sample
        Of the losses, lower is better, a column for each row.
    error, methods
        See :func:`critical_distance`.

    Examples
    --------
    >>> from xden_bench.scoring.clusters import category_sums
    >>> sums = category_sums(np.array([[0.1, 0.5], [0.2, 0.7], [0.1, 0.6]]), ["a", "b", "c"])
    >>> worse_beyond_doubt(sums, error=0.05, methods=2).tolist()
    [[False, False], [True, False]]
    """
    critical = critical_distance(error, methods, sample.degrees_of_freedom)
    influences, means = sample.influences, sample.means
    apart = means[:, None] - means
    errors = np.array(
        [np.linalg.norm(influences - one[:, None], axis=0) for one in influences.T]
    ).reshape(apart.shape)
    if not np.isfinite(critical):
        return np.zeros_like(apart, dtype=bool)
    worse: Bool[np.ndarray, "rows rows"] = (apart > SAME) & (apart > critical * errors)
    return worse


@lru_cache
def critical_distance(error: float, methods: int, degrees_of_freedom: int) -> float:
    """How many standard errors a difference must have to be beyond doubt.

    Student's distribution, and the Bonferroni bound over all ordered pairs of so many methods:
    whatever the dependence, the probability that any two of them are told apart, if all are equal,
    is at most ``error``. It does not depend on how many rows a table has, so that no row can change
    what is known of two others. Infinite without a degree of freedom.

    Examples
    --------
    >>> round(critical_distance(0.05, 2, 100), 3), round(critical_distance(0.05, 30, 100), 3)
    (1.984, 4.015)
    """
    if degrees_of_freedom < 1:
        return np.inf
    return float(student_t.isf(error / (methods * (methods - 1)), degrees_of_freedom))


def dense_ranks(means: Sequence[float], worse: Bool[np.ndarray, "rows rows"]) -> Sequence[int]:
    """Rank of each row, in the order of the means, dense.

    A row shares the rank of the one above it, unless it is worse beyond doubt than one that has
    this rank: then it opens the next.

    Parameters
    ----------
    means
        Of each row, lower is better.
    worse
        From :func:`worse_beyond_doubt`.

    Examples
    --------
    >>> worse = np.array([[False, False, False], [False, False, False], [True, False, False]])
    >>> dense_ranks([0.1, 0.2, 0.3], worse)
    [1, 1, 2]
    """
    found, rank = [0] * len(means), 0
    group: list[int] = []
    for row in np.argsort(means, kind="stable").tolist():
        if not group or worse[row, group].any():
            rank, group = rank + 1, []
        group.append(row)
        found[row] = rank
    return found


def ranks(rows: Sequence[Entry]) -> list[int | None]:
    """Rank of each row by :func:`dense_ranks`.

    Rows that :func:`unranked_because` gives a reason for have no rank and push nobody down. No row
    of a protocol before v2 has one.

    Parameters
    ----------
    rows
        Of one table, in any order.

    Raises
    ------
    DataError
        If two rows were scored on different objects.
    """
    found: list[int | None] = [None] * len(rows)
    places = [place for place, row in enumerate(rows) if unranked_because(row) is None]
    if not places or not (rules := load_rules(rows[0]["protocol"])).is_ranked:
        return found
    counted = [rows[place] for place in places]
    losses, categories = row_losses(counted, rules.rank_by)
    worse = worse_rows(losses, categories, rules)
    for place, rank in zip(places, dense_ranks(losses.mean(axis=0).tolist(), worse), strict=True):
        found[place] = rank
    return found


def rank_label(rank: int | None, ranks: Sequence[int | None]) -> str:
    """Return a rank as it is printed: with ``=`` where rows share it, nothing where there is none.

    Examples
    --------
    >>> rank_label(1, [1, 1, None]), rank_label(3, [1, 1, 3]), rank_label(None, [1, None])
    ('1=', '3', '')
    """
    return "" if rank is None else f"{rank}{'=' if ranks.count(rank) > 1 else ''}"


def rank_labels(rows: Sequence[Entry]) -> list[str]:
    """Ranks of a table by :func:`rank_label`.

    Parameters
    ----------
    rows
        Of one table, in any order.
    """
    found = ranks(rows)
    return [rank_label(rank, found) for rank in found]


def unranked_because(row: Entry) -> str | None:
    """Why a row is printed without a rank, or None if it has one.

    All an entry says of itself can only take its rank away here, so that nothing is gained by
    saying it falsely. :func:`xden_bench.methods.trivial.check_trivial` keeps the names of the
    trivial methods for those.
    """
    if row.get("disqualified"):
        return str(row["disqualified"])
    if is_trivial(row["method"]["name"], load_rules(row["protocol"])):
        return TRIVIAL
    if "truth" in row["method"]["inputs"]:
        return "oracle: it is told what only the truth tells"
    if "materials" in row["method"]["inputs"]:
        return "it is told the material of each part"
    remade = row.get("recomputed", {}).get("how") == "remade"
    if not remade and any(warning.startswith("W504") for warning in row["warnings"]):
        return "its values are those of the reference"
    if any(warning.startswith("W505") for warning in row["warnings"]):
        return "its values are those of a trivial method"
    if row["method"]["name"] in REBUILT and "scan" in row["dataset"]["source"].split("+"):
        return "circular: on scans the truth is the builder's own reconstruction"
    reason: str | None = row.get(MERGED)
    return reason


def no_interval_because(inputs: Iterable[str]) -> str | None:
    """Why no mean of a method has an interval, or None if its means may have one.

    Who is told the materials and measures them in X-rays is right but for a few objects, which make
    its mean, and a sample has them or lacks them. A sample that lacks them does not show it, so
    that what a method declares decides, not its scores: docs/method/scoring.md has the numbers.

    Parameters
    ----------
    inputs
        What the method declares to look at.

    Examples
    --------
    >>> no_interval_because(["parts", "xray", "materials"])
    'no intervals: its means are made by a few objects, which a sample has or lacks'
    >>> no_interval_because(["parts", "xray"])
    """
    if not {*inputs} >= LABELLED:
        return None
    return "no intervals: its means are made by a few objects, which a sample has or lacks"


def unsure_because(row: Entry) -> str | None:
    """Say the same of a row; nothing of one by a protocol before ranks, which has no intervals."""
    is_ranked = load_rules(row["protocol"]).is_ranked
    return no_interval_because(row["method"]["inputs"]) if is_ranked else None


def trusted_interval(row: Entry, metric: str) -> Sequence[float] | None:
    """Return both ends of the 95 % interval of a row's mean; None where it would cover less.

    So it is by a protocol before v2, of an oracle, whose few errors are all tail, and where
    :func:`no_interval_because` gives a reason.

    Parameters
    ----------
    row
        That has the metric.
    metric
        Its name.
    """
    inputs = row["method"]["inputs"]
    if not load_rules(row["protocol"]).is_ranked or "truth" in inputs:
        return None
    if no_interval_because(inputs):
        return None
    ends: Sequence[float] | None = row["metrics"][metric]["ci95"]
    return ends


def trusted_metrics(row: Entry) -> dict[str, dict[str, Any]]:
    """Metrics of a row, without the intervals that :func:`trusted_interval` withholds."""
    return {
        name: {**one, "ci95": trusted_interval(row, name)} for name, one in row["metrics"].items()
    }


def worse_rows(
    losses: Float64[np.ndarray, "objects rows"], categories: Sequence[str], rules: Rules
) -> Bool[np.ndarray, "rows rows"]:
    """Which rows are worse by the mean, and beyond doubt by the bounded loss.

    ``loss / (loss + scale)`` ends at 1: a few objects that are far off neither decide nor widen
    the doubt until nothing can be told apart. A loss that has bounds itself is taken as it is.
    """
    bounded = losses / (losses + rules.rank_scale) if rules.rank_scale else losses
    return worse_beyond_doubt(
        sampled(bounded, categories, rules), rules.rank_error, rules.rank_methods
    )


def row_losses(
    rows: Sequence[Entry], metric: str
) -> tuple[Float64[np.ndarray, "objects rows"], Sequence[str]]:
    """Loss of every object in every row, and their categories; without objects left out of it."""
    columns = [row["object_scores"] for row in rows]
    if any(one["object_id"] != columns[0]["object_id"] for one in columns):
        names = sorted({row["method"]["name"] for row in rows})
        raise DataError(f"rows of one table were scored on different objects: {names}")
    values = np.array([one[metric] for one in columns], dtype=np.float64).T
    counts = ~np.isnan(values).any(axis=1)
    categories = np.array(columns[0]["category"])[counts]
    return METRICS[metric].loss(values[counts]), categories.tolist()
