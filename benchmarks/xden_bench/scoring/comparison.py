"""Two methods on the same objects: how far apart they are, how surely, and where."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64
from scipy.stats import binomtest

from xden1k.errors import DataError
from xden_bench.scoring.bootstrap import SAME, Estimate
from xden_bench.scoring.clusters import CategorySums, category_sums
from xden_bench.scoring.intervals import protocol_intervals
from xden_bench.scoring.metrics import METRICS
from xden_bench.scoring.protocol import Rules

__all__ = ["Comparison", "ObjectPair", "Scored", "compare"]


@dataclass(frozen=True, slots=True, eq=False)
class Scored:
    """A method's scores, from a submission or from an entry.

    Parameters
    ----------
    name
        Of the method.
    compared
        Whatever must be the same in two methods to be compared, by name: protocol, dataset, ...
    columns
        Scores of the objects by column: ``object_id``, ``category`` and one for each metric.
    """

    name: str
    compared: Mapping[str, Any]
    columns: Mapping[str, Sequence[Any]]

    @classmethod
    def of(cls, entry: Mapping[str, Any], columns: Mapping[str, Sequence[Any]]) -> Scored:
        """Take what is needed from an entry and the scores of its objects."""
        data = entry["dataset"]
        compared = {
            "protocol": entry["protocol"],
            "metric version": entry["metric_version"],
            "manifest": data["manifest_sha256"],
            "split": data["split"],
            "target": entry["target"],
        }
        return cls(entry["method"]["name"], compared, columns)


@dataclass(frozen=True, slots=True)
class ObjectPair:
    """An object's values under two methods.

    Parameters
    ----------
    object_id
        As in the dataset.
    a, b
        The values.
    """

    object_id: str
    a: float
    b: float


@dataclass(frozen=True, slots=True)
class Comparison:
    """One metric of two methods on the same objects.

    Parameters
    ----------
    difference
        Mean of a - b over objects, and its 95 % interval where the protocol trusts one.
    p_equal
        Of the sign test over categories: how probable so uneven a division is, or one more
        uneven, if a category is as likely to be better in a as in b. Ties are left out (Conover,
        1999, *Practical Nonparametric Statistics*, 3.4). It holds whatever the tails.
    a_better, b_better
        Objects on which a, or b, is better; on the others they are equal.
    largest
        Objects with the largest differences, largest first; none on which they are equal.
    """

    difference: Estimate
    p_equal: float
    a_better: int
    b_better: int
    largest: tuple[ObjectPair, ...]


def compare(a: Scored, b: Scored, protocol: Rules, largest: int = 5) -> Mapping[str, Comparison]:
    """Compare two methods by every metric that both have.

    Paired: both are seen on the same objects, and categories are what is drawn, for the interval
    and for the sign test.

    Parameters
    ----------
    a, b
        Two methods.
    protocol
        Which metrics have an interval; one before v2 has none.
    largest
        How many objects to list.

    Raises
    ------
    DataError
        If they were not scored by the same rules on the same objects.
    """
    for name, value in a.compared.items():
        if value != b.compared[name]:
            raise DataError(
                f"only scores of one {name} can be compared: {a.name} has {value!r}, "
                f"{b.name} {b.compared[name]!r}"
            )
    ids = a.columns["object_id"]
    if list(ids) != list(b.columns["object_id"]):
        raise DataError(f"{a.name} and {b.name} were scored on different objects")
    names = [name for name in protocol.metrics_of(has_sd=True) if name in a.columns]
    names = [name for name in names if name in b.columns]
    values = np.array([[one.columns[name] for name in names] for one in (a, b)], dtype=np.float64)
    known = [np.flatnonzero(~np.isnan(one).any(axis=0)).tolist() for one in values.swapaxes(0, 1)]
    return {
        name: _compared(
            name,
            [ids[i] for i in kept],
            values[:, place, kept],
            [a.columns["category"][i] for i in kept],
            protocol,
            largest,
        )
        for place, (name, kept) in enumerate(zip(names, known, strict=True))
    }


def _compared(
    name: str,
    ids: Sequence[str],
    values: Float64[np.ndarray, "2 objects"],
    categories: Sequence[str],
    protocol: Rules,
    largest: int,
) -> Comparison:
    """Compare by one metric, on the objects for which it is a number."""
    metric, apart_by = METRICS[name], values[0] - values[1]
    intervals = protocol_intervals(apart_by[:, None], categories, [name], protocol)
    difference = Estimate(float(apart_by.mean()), intervals.get(name))
    worse = metric.loss(values[0]) - metric.loss(values[1])
    signs = _signs(worse)
    apart = np.abs(values[0] - values[1])
    order = [i for i in np.argsort(-apart, kind="stable")[:largest] if apart[i] > SAME]
    return Comparison(
        difference,
        _sign_test(category_sums(worse[:, None], categories)),
        int((signs < 0).sum()),
        int((signs > 0).sum()),
        tuple(ObjectPair(ids[i], float(values[0, i]), float(values[1, i])) for i in order),
    )


def _sign_test(worse: CategorySums) -> float:
    """Probability of the division of the categories, by the sign of their mean."""
    signs = _signs(worse.sums[:, 0] / worse.sizes)
    decided = int((signs != 0).sum())
    return float(binomtest(int((signs > 0).sum()), decided).pvalue) if decided else 1.0


def _signs(worse: Float64[np.ndarray, "n"]) -> Float64[np.ndarray, "n"]:
    """Signs, 0 for what only rounding tells apart."""
    signs: Float64[np.ndarray, "n"] = np.sign(np.where(np.abs(worse) <= SAME, 0.0, worse))
    return signs
