"""Which entries of a table are one row: seeds of a method, entries sent again, copies.

A method of a team has one row, its seeds the mean of it. Whatever does not count by itself stays
below the row that it belongs to, with the reason, and has no rank.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import product, starmap
from pathlib import Path
from statistics import fmean, stdev
from typing import Any, Final, NamedTuple

import numpy as np
from jaxtyping import Float64

from xden_bench.entries.ranking import MERGED, Entry, unranked_because
from xden_bench.entries.result import entry_path, figures, objects_of
from xden_bench.scoring.metrics import METRICS
from xden_bench.scoring.protocol import load_rules

__all__ = [
    "entries_of",
    "few_seeds",
    "holds",
    "merged_rows",
    "place",
    "seed_spread",
    "silent_on_cost",
]

_COSTS: Final[Mapping[str, Callable[[Sequence[float]], float]]] = {
    "seconds_per_object": fmean,
    "processor_seconds_per_object": fmean,
    "peak_memory_gb": max,
}
"""What a row's seeds cost it, of those that tell."""
_MEASURED: Final = ("processor_seconds_per_object", "peak_memory_gb")
"""Costs that entries made before they were measured lack."""
NEAR: Final[Mapping[str, float]] = {"density_mae_g_cm3": 0.05, "iou_a": 0.015}
"""Median over objects of the relative difference of two errors, below which they are a copy.

By the metric that ranks. Densities: of the entries of protocol v2 the nearest of two honest
methods, networks of one design with other inputs, are 0.085 apart; noise of a thousandth on every
voxel makes 0.004 where errors are a tenth of the density. IoU: an error of 50 % differs by little
whatever a method does, so that seeds of one network, and the nearest two networks, are 0.023
apart, and one that learned is 0.045 from a rule that did not; other labels for one in a hundred
points make 0.006 to 0.011, and cost 0.4 to 0.8 % of IoU, for two in a hundred 0.013 to 0.021."""


def merged_rows(entries: Iterable[Entry]) -> list[Entry]:
    """Rows of one table, the best first, each followed by those that count as it.

    Parameters
    ----------
    entries
        Of one table, in any order.

    Returns
    -------
    list
        Entries as they came; a method of several seeds is one whose numbers are the means over its
        seeds, with the seeds' entries under the key ``seeds``. The key
        :data:`xden_bench.entries.ranking.MERGED` has the reason where one counts as another.
    """
    every = list(entries)
    families = [_family(members) for members in _methods(_standing(every))]
    families = _without_copies(sorted(families, key=lambda family: _came(family[0])))
    families += [[one] for one in every if one.get("disqualified")]
    families.sort(key=lambda family: place(family[0]))
    return [row for family in families for row in family]


def entries_of(row: Entry) -> Sequence[Entry]:
    """Entries that a row is made of: those of its seeds, or itself."""
    seeds: Sequence[Entry] = row.get("seeds", (row,))
    return seeds


def holds(row: Entry, path: Path) -> bool:
    """Whether a row is made of the entry that lies at a place among the results."""
    return any(entry_path(one) == path for one in entries_of(row))


def place(row: Entry) -> tuple[Any, ...]:
    """Sort rows of a table by mean, then by name."""
    loss = _loss(row)
    return loss, row["method"]["name"], row["submission_sha256"]


def seed_spread(row: Entry, metric: str) -> float | None:
    """Return the standard deviation of a mean over seeds; None for a single one."""
    means = [one["metrics"][metric]["mean"] for one in row.get("seeds", ())]
    return stdev(means) if means else None


def few_seeds(row: Entry) -> str:
    """Say that a trained row with a rank is of fewer seeds than its protocol asks for; else "".

    The spread of such a row is not known.
    """
    least = load_rules(row["protocol"]).min_seeds
    trained = row["method"]["training_data"] and unranked_because(row) is None
    if not trained or len(entries_of(row)) >= least:
        return ""
    return f"trained, with fewer than {least} seeds: its spread is not known"


def silent_on_cost(row: Entry) -> str:
    """Say that a row's costs are of some of its seeds, since others tell none; else ""."""
    every = entries_of(row)
    told = [one for one in every if any(one["method"].get(key) is not None for key in _MEASURED)]
    if len(told) in (0, len(every)):
        return ""
    return f"processor time and memory of {len(told)} of its {len(every)} seeds"


def _loss(row: Entry) -> float:
    name = load_rules(row["protocol"]).rank_by
    mean: float = row["metrics"][name]["mean"]
    return -mean if METRICS[name].higher_is_better else mean


def _came(row: Entry) -> tuple[str, str, str]:
    """Sort rows by when they came; of one day, by checksum."""
    return row["date"], row["submission_sha256"], row["method"]["name"]


def _standing(entries: Iterable[Entry]) -> list[Entry]:
    """Entries that nothing was said against: the others count for nobody."""
    return [one for one in entries if not one.get("disqualified")]


def _methods(entries: Iterable[Entry]) -> Iterator[list[Entry]]:
    """Entries of one method and team, first come first."""
    found: dict[tuple[str, str], list[Entry]] = {}
    for entry in sorted(entries, key=_came):
        name = entry["method"]["name"].strip().casefold()
        found.setdefault((entry.get("team", {}).get("public_key", ""), name), []).append(entry)
    yield from found.values()


def _family(members: Sequence[Entry]) -> list[Entry]:
    """Row of a method, then what it sent besides: the best entry of each seed counts."""
    best: dict[int | None, Entry] = {}
    for entry in sorted(members, key=place):
        best.setdefault(entry["method"]["seed"], entry)
    seeds = sorted(best.values(), key=_came)
    ids = seeds[0]["object_scores"]["object_id"]
    counted = [one for one in seeds if one["object_scores"]["object_id"] == ids]
    others = [one for one in seeds if one not in counted]
    row = _mean_of_seeds(counted) if len(counted) > 1 else counted[0]
    kept = {one["submission_sha256"] for one in seeds}
    again = [one for one in members if one["submission_sha256"] not in kept]
    return [
        row,
        *(_merged(one, "its objects are others than those of its first seed") for one in others),
        *(_merged(one, "its method and seed have a better entry") for one in again),
    ]


def _mean_of_seeds(seeds: Sequence[Entry]) -> Entry:
    """Row whose objects have the means of their scores over seeds."""
    first, rules = seeds[0], load_rules(seeds[0]["protocol"])
    every = [one["object_scores"] for one in seeds]
    columns = {name: values for name, values in every[0].items() if name not in METRICS}
    for name in set(METRICS).intersection(*every):
        columns[name] = np.mean([one[name] for one in every], axis=0).tolist()
    return {
        **first,
        **figures(objects_of(columns, rules), rules),
        "method": {**first["method"], **_cost(seeds)},
        "object_scores": columns,
        "seeds": sorted(seeds, key=lambda one: one["method"]["seed"] or 0),
    }


def _cost(seeds: Sequence[Entry]) -> dict[str, float | None]:
    """Mean times of an object, and the most memory, over the seeds that tell; None if none does."""
    given = {key: [one["method"].get(key) for one in seeds] for key in _COSTS}
    told = {key: [cost for cost in costs if cost is not None] for key, costs in given.items()}
    return {key: of(told[key]) if told[key] else None for key, of in _COSTS.items()}


def _without_copies(families: Sequence[list[Entry]]) -> list[list[Entry]]:
    """Put every family one of whose entries is a copy below the first that has its values.

    Entries are compared, not rows: means over seeds are nearer to each other than methods are.
    """
    found: list[tuple[list[Entry], list[_Likeness]]] = []
    for family in families:
        own = [_likeness(entry) for entry in entries_of(family[0])]
        original = next(
            (one for one, theirs in found if any(starmap(_agree, product(own, theirs)))), []
        )
        if original:
            reason = f"a copy of {original[0]['method']['name']}, which came first"
            original += [_merged(one, reason) for one in family]
        else:
            found.append((family, own))
    return [family for family, _ in found]


class _Likeness(NamedTuple):
    """What an entry is recognised by: its arrays, and the errors of its objects."""

    arrays_sha256: str | None
    errors: Float64[np.ndarray, "objects"]
    near: float


def _likeness(entry: Entry) -> _Likeness:
    name = load_rules(entry["protocol"]).rank_by
    errors = np.abs(np.array(entry["object_scores"][name], dtype=np.float64) - METRICS[name].best)
    return _Likeness(entry.get("arrays_sha256"), errors, NEAR[name])


def _agree(one: _Likeness, other: _Likeness) -> bool:
    """Whether two entries have the same arrays, or errors as near as no two methods have."""
    if one.arrays_sha256 is not None and one.arrays_sha256 == other.arrays_sha256:
        return True
    if one.errors.shape != other.errors.shape:
        return False
    larger, gap = np.maximum(one.errors, other.errors), np.abs(one.errors - other.errors)
    apart = np.divide(gap, larger, out=np.zeros_like(larger), where=larger > 0)
    return bool(np.median(apart[~np.isnan(larger)]) < one.near)


def _merged(row: Entry, reason: str) -> Mapping[str, Any]:
    return {**row, MERGED: reason}
