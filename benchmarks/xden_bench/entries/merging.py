"""Which entries of a table are one row: seeds of a method, entries sent again, copies.

A method of a team has one row, its seeds the mean of it. Whatever does not count by itself stays
below the row that it belongs to, with the reason, and has no rank.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import product, starmap
from pathlib import Path
from statistics import fmean, stdev
from typing import Any, Final

import numpy as np

from xden_bench.entries.copies import Likeness, agree, came, likeness, precedes
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


def merged_rows(entries: Iterable[Entry], elsewhere: Iterable[Entry] = ()) -> list[Entry]:
    """Rows of one table, the best first, each followed by those that count as it.

    Parameters
    ----------
    entries
        Of one table, in any order.
    elsewhere
        Of the other tracks of the same dataset, split, source, target and protocol: a copy of one
        that came before has no rank, whatever it says that it looks at.

    Returns
    -------
    list
        Entries as they came; a method of several seeds is one whose numbers are the means over its
        seeds, with the seeds' entries under the key ``seeds``. The key
        :data:`xden_bench.entries.ranking.MERGED` has the reason where one counts as another.
    """
    every = list(entries)
    families = [_family(members) for members in _methods(_standing(every))]
    families = _without_copies(sorted(families, key=lambda family: came(family[0])))
    strangers = [(one, likeness(one)) for one in _standing(elsewhere)]
    families = [_unless_copied(family, strangers) for family in families]
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


def _standing(entries: Iterable[Entry]) -> list[Entry]:
    """Entries that nothing was said against: the others count for nobody."""
    return [one for one in entries if not one.get("disqualified")]


def _methods(entries: Iterable[Entry]) -> Iterator[list[Entry]]:
    """Entries of one method and team, first come first."""
    found: dict[tuple[str, str], list[Entry]] = {}
    for entry in sorted(entries, key=came):
        name = entry["method"]["name"].strip().casefold()
        found.setdefault((entry.get("team", {}).get("public_key", ""), name), []).append(entry)
    yield from found.values()


def _family(members: Sequence[Entry]) -> list[Entry]:
    """Row of a method, then what it sent besides: the best entry of each seed counts.

    Members are in the order they came. What is no seed of the first is left out before the best is
    looked for, so that it takes nobody's place.
    """
    apart = [_not_a_seed_of(members[0], one) for one in members]
    pairs = list(zip(members, apart, strict=True))
    best: dict[int | None, Entry] = {}
    for entry in sorted((one for one, reason in pairs if not reason), key=place):
        best.setdefault(entry["method"]["seed"], entry)
    seeds = sorted(best.values(), key=came)
    again = [one for one, reason in pairs if not reason and not any(one is each for each in seeds)]
    return [
        _mean_of_seeds(seeds) if len(seeds) > 1 else seeds[0],
        *(_merged(one, reason) for one, reason in pairs if reason),
        *(_merged(one, "its method and seed have a better entry") for one in again),
    ]


def _not_a_seed_of(first: Entry, one: Entry) -> str:
    """Why an entry is not averaged with the first seed of its method; empty if it is."""
    if one["object_scores"]["object_id"] != first["object_scores"]["object_id"]:
        return "its objects are others than those of its first seed"
    if _declared(one) != _declared(first):
        return "it declares other inputs or training data than its first seed"
    here, there = unranked_because(one), unranked_because(first)
    return "" if here == there else here or f"its first seed has no rank: {there}"


def _declared(entry: Entry) -> Mapping[str, Any]:
    """Give what its seeds have in common, in whatever order it is told."""
    method = entry["method"]
    return {
        "inputs": sorted(method["inputs"]),
        "training_data": sorted(method["training_data"]),
        "external_data": method["external_data"],
    }


def _mean_of_seeds(seeds: Sequence[Entry]) -> Entry:
    """Row whose objects have the means of their scores over seeds."""
    first, rules = seeds[0], load_rules(seeds[0]["protocol"])
    every = [one["object_scores"] for one in seeds]
    columns = {name: values for name, values in every[0].items() if name not in METRICS}
    for name in set(METRICS).intersection(*every):
        columns[name] = np.mean([one[name] for one in every], axis=0).tolist()
    return {
        **first,
        **_known(seeds),
        **figures(objects_of(columns, rules), rules),
        "method": {**first["method"], **_cost(seeds)},
        "object_scores": columns,
        "seeds": sorted(seeds, key=lambda one: one["method"]["seed"] or 0),
    }


def _known(seeds: Sequence[Entry]) -> dict[str, Any]:
    """Give the warnings of all seeds, and that they were recomputed if each of them was.

    W504 of one that was remade says nothing more, as in its own row.
    """
    every = [
        said
        for one in seeds
        for said in one["warnings"]
        if not (said.startswith("W504") and unranked_because(one) is None)
    ]
    known: dict[str, Any] = {"warnings": list(dict.fromkeys(every))}
    if open_ones := [one for one in seeds if "recomputed" not in one]:
        known |= {"status": open_ones[0]["status"], "recomputed": {}}
    return known


def _cost(seeds: Sequence[Entry]) -> dict[str, float | None]:
    """Mean times of an object, and the most memory, over the seeds that tell; None if none does."""
    given = {key: [one["method"].get(key) for one in seeds] for key in _COSTS}
    told = {key: [cost for cost in costs if cost is not None] for key, costs in given.items()}
    return {key: of(told[key]) if told[key] else None for key, of in _COSTS.items()}


def _without_copies(families: Sequence[list[Entry]]) -> list[list[Entry]]:
    """Put every family one of whose entries is a copy below the first that has its values.

    Entries are compared, not rows: means over seeds are nearer to each other than methods are.
    """
    found: list[tuple[list[Entry], list[Likeness]]] = []
    for family in families:
        own = [likeness(entry) for entry in entries_of(family[0])]
        original = next(
            (one for one, theirs in found if any(starmap(agree, product(own, theirs)))), []
        )
        if original:
            reason = f"a copy of {original[0]['method']['name']}, which came first"
            original += [_merged(one, reason) for one in family]
        else:
            found.append((family, own))
    return [family for family, _ in found]


def _unless_copied(family: list[Entry], strangers: Sequence[tuple[Entry, Likeness]]) -> list[Entry]:
    """Take the rank of a family that is a copy of what came before it in another track."""
    row, own = family[0], [likeness(entry) for entry in entries_of(family[0])]
    for other, theirs in strangers:
        if precedes(other, row) and any(agree(one, theirs) for one in own):
            reason = f"a copy of {other['method']['name']}, which came first in {other['track']}"
            return [_merged(row, reason), *family[1:]]
    return family


def _merged(row: Entry, reason: str) -> Mapping[str, Any]:
    return {**row, MERGED: reason}
