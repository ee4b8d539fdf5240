"""Two methods on the same objects: how far apart they are, how surely, and where."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64

from xden1k.errors import DataError
from xden_bench.scoring.bootstrap import CI95, SAME, Estimate, resampled_means
from xden_bench.scoring.metrics import METRICS, Metric
from xden_bench.scoring.protocol import Protocol

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
        Scores of the objects by column: ``object_id`` and one for each metric.
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
        Mean of a - b over objects and its 95 % interval.
    a_better_share
        Share of the resamples in which the mean of a is better; an equal one counts half.
    a_better, b_better
        Objects on which a, or b, is better; on the others they are equal.
    largest
        Objects with the largest differences, largest first; none on which they are equal.
    """

    difference: Estimate
    a_better_share: float
    a_better: int
    b_better: int
    largest: tuple[ObjectPair, ...]


def compare(a: Scored, b: Scored, protocol: Protocol, largest: int = 5) -> Mapping[str, Comparison]:
    """Compare two methods by every metric that both have.

    The paired bootstrap: each resample draws objects, and takes both methods on the same ones.

    Parameters
    ----------
    a, b
        Two methods.
    protocol
        For the number and seed of the resamples.
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
    draws = [
        resampled_means(each.T, protocol.bootstrap_resamples, protocol.bootstrap_seed)
        for each in values
    ]
    return {
        name: _compared(
            METRICS[name], ids, values[:, place], [one[:, place] for one in draws], largest
        )
        for place, name in enumerate(names)
    }


def _compared(
    metric: Metric,
    ids: Sequence[str],
    values: Float64[np.ndarray, "2 objects"],
    draws: Sequence[Float64[np.ndarray, "resamples"]],
    largest: int,
) -> Comparison:
    """Compare by one metric."""
    difference = values[0] - values[1]
    low, high = np.quantile(draws[0] - draws[1], CI95)
    signs, wins = (
        np.sign(np.where(np.abs(worse) <= SAME, 0.0, worse))
        for worse in (metric.loss(each[0]) - metric.loss(each[1]) for each in (draws, values))
    )
    apart = np.abs(difference)
    order = [i for i in np.argsort(-apart, kind="stable")[:largest] if apart[i] > SAME]
    return Comparison(
        Estimate(float(difference.mean()), float(low), float(high)),
        float((1 - signs.mean()) / 2),
        int((wins < 0).sum()),
        int((wins > 0).sum()),
        tuple(ObjectPair(ids[i], float(values[0, i]), float(values[1, i])) for i in order),
    )
