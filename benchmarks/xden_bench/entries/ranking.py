"""Which rows of a table can be told apart, and the ranks that follow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from jaxtyping import Bool, Float64

from xden1k.errors import DataError
from xden_bench.methods.rebuilt import NAMES as REBUILT
from xden_bench.scoring.bootstrap import CI95, SAME, resampled_means
from xden_bench.scoring.metrics import METRICS
from xden_bench.scoring.protocol import is_trivial, load_protocol

__all__ = ["TRIVIAL", "Entry", "better", "rank_labels", "ranks", "unranked_because"]

Entry = Mapping[str, Any]
"""As :func:`xden_bench.entries.result.read_entries` gives it."""

TRIVIAL: Final = "trivial"


def better(
    losses: Float64[np.ndarray, "objects rows"], resamples: int, seed: int
) -> Bool[np.ndarray, "rows rows"]:
    """Whether row i is better than row j beyond doubt, on the same objects.

    It is where the 95 % percentile bootstrap interval of the mean difference per object lies below
    zero. Two intervals overlap long before their difference is in doubt: what makes an object hard
    for one method makes it hard for another, and the difference does not see that.

    Parameters
    ----------
    losses
        Shape (objects, rows), lower is better.
    resamples, seed
        As in :func:`xden_bench.scoring.bootstrap.resampled_means`.

    Examples
    --------
    >>> hard, easy = [9.0, 9.5], [1.0, 1.5]
    >>> better(np.array([hard, easy, hard, easy]), 1000, 0).tolist()
    [[False, True], [False, False]]
    """
    drawn = resampled_means(losses, resamples, seed)
    highs = [np.quantile(drawn - row[:, None], CI95[1], axis=0) for row in drawn.T]
    beyond: Bool[np.ndarray, "rows rows"] = -SAME > np.array(highs).T
    return beyond


def ranks(rows: Sequence[Entry]) -> list[int | None]:
    """Rank of each row: one more than the number of rows that are :func:`better`.

    Rows that :func:`unranked_because` gives a reason for have no rank and push nobody down.

    Parameters
    ----------
    rows
        Of one table, in any order.

    Raises
    ------
    DataError
        If two rows were scored on different objects.
    """
    places = [place for place, row in enumerate(rows) if unranked_because(row) is None]
    found: list[int | None] = [None] * len(rows)
    if places:
        rules = load_protocol(rows[0]["protocol"])
        losses = _losses([rows[place] for place in places], rules.rank_by)
        beaten = better(losses, rules.bootstrap_resamples, rules.bootstrap_seed).sum(axis=0)
        for place, count in zip(places, beaten, strict=True):
            found[place] = 1 + int(count)
    return found


def rank_labels(rows: Sequence[Entry]) -> list[str]:
    """Ranks as they are printed: ``1=`` where rows share one, nothing where there is none.

    Parameters
    ----------
    rows
        Of one table, in any order.
    """
    found = ranks(rows)
    return [
        "" if rank is None else f"{rank}{'=' if found.count(rank) > 1 else ''}" for rank in found
    ]


def unranked_because(row: Entry) -> str | None:
    """Why a row is printed without a rank, or None if it has one.

    All an entry says of itself can only take its rank away here, so that nothing is gained by
    saying it falsely. :func:`xden_bench.methods.trivial.check_trivial` keeps the names of the
    trivial methods for those.
    """
    if row.get("disqualified"):
        return str(row["disqualified"])
    if is_trivial(row["method"]["name"], load_protocol(row["protocol"])):
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
    return None


def _losses(rows: Sequence[Entry], metric: str) -> Float64[np.ndarray, "objects rows"]:
    """Loss of every object in every row."""
    columns = [row["object_scores"] for row in rows]
    if any(one["object_id"] != columns[0]["object_id"] for one in columns):
        names = sorted({row["method"]["name"] for row in rows})
        raise DataError(f"rows of one table were scored on different objects: {names}")
    values = np.array([one[metric] for one in columns], dtype=np.float64).T
    return METRICS[metric].loss(values)
