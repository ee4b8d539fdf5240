"""How much worse methods are on categories that no training object was of."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

from tabulate import tabulate

from xden_bench.entries.markdown import plain
from xden_bench.entries.ranking import Entry
from xden_bench.scoring.metrics import METRICS
from xden_bench.scoring.protocol import SEGMENT_PROTOCOLS, load_rules

__all__ = ["DROP_HEADINGS", "UNSEEN", "drop_rows", "drop_table"]

UNSEEN: Final = "unseen"
"""The split of the categories that are left out of training."""

DROP_HEADINGS: Final = ("method", "test", "unseen", "drop", "unseen / test")


def drop_table(rows: Sequence[Entry], tables: Sequence[Sequence[Entry]]) -> str:
    """Table of the methods of a split that are also scored on ``unseen``; empty without one.

    Parameters
    ----------
    rows
        Table of the split ``test``; of another split nothing is made.
    tables
        Among which is that of ``unseen``: the same but for the split.
    """
    lines = [[plain(method), *figures] for method, *figures in drop_rows(rows, tables)]
    if not lines:
        return ""
    metric = load_rules(rows[0]["protocol"]).rank_by
    sources = [one["dataset"]["source"] for one in (rows[0], _counterpart(rows, tables)[0])]
    said = sources[0] if len({*sources}) == 1 else f"{sources[0]} (`test`), {sources[1]} (`unseen`)"
    return (
        f"## {track_title(rows[0])}: from seen to unseen categories\n\n"
        f"{METRICS[metric].title}, means over objects; source: {said}. `unseen` has categories "
        "that no training object is of. The objects differ too: a method without training shows by "
        "how much.\n\n"
        f"{tabulate(lines, DROP_HEADINGS, tablefmt='pipe', disable_numparse=True)}"
    )


def track_title(row: Entry) -> str:
    """Return how a table is called: by its track, and what is scored if that is no density."""
    segments = row["protocol"] in SEGMENT_PROTOCOLS
    return f"{'Segments, track' if segments else 'Track'} `{row['track']}`"


def drop_rows(rows: Sequence[Entry], tables: Iterable[Sequence[Entry]]) -> list[list[str]]:
    """Rows of :func:`drop_table` under :data:`DROP_HEADINGS`, the names as they are."""
    if rows[0]["dataset"]["split"] != "test":
        return []
    unseen = _by_method(_counterpart(rows, tables))
    metric = load_rules(rows[0]["protocol"]).rank_by
    return [
        _line(row, unseen[method], metric)
        for method, row in _by_method(rows).items()
        if method in unseen
    ]


def _counterpart(rows: Sequence[Entry], tables: Iterable[Sequence[Entry]]) -> Sequence[Entry]:
    """Find the table of ``unseen`` that goes with another; nothing if there is none."""
    return next((one for one in tables if _is_counterpart(rows[0], one[0])), [])


def _is_counterpart(row: Entry, other: Entry) -> bool:
    """Whether two rows differ by their split alone, which is ``unseen`` in the other."""
    own, others = row["dataset"], other["dataset"]
    keys = ("protocol", "metric_version", "target", "track")
    return others == {**own, "split": UNSEEN, "source": others["source"]} and all(
        row[key] == other[key] for key in keys
    )


def _by_method(rows: Iterable[Entry]) -> dict[tuple[str, str], Entry]:
    """Rows by method and team: of each the first, be it that it counts as another method's.

    On unseen kinds a median by category is that of all objects: that it is a copy is the answer.
    """
    found: dict[tuple[str, str], Entry] = {}
    for row in rows:
        if not row.get("disqualified"):
            team = row.get("team", {}).get("public_key", "")
            found.setdefault((row["method"]["name"], team), row)
    return found


def _line(row: Entry, unseen: Entry, metric: str) -> list[str]:
    """Return method, both means, and how much worse the second is."""
    seen, new = (one["metrics"][metric]["mean"] for one in (row, unseen))
    ratio = f"{new / seen:.2f}" if round(seen, 3) > 0 else ""
    drop = round(new - seen, 3) + 0.0  # never -0.000
    return [row["method"]["name"], f"{seen:.3f}", f"{new:.3f}", f"{drop:+.3f}", ratio]
