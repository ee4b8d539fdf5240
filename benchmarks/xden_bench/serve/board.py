"""What the leaderboard page shows, as plain tables. Text of strangers stays text."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from xden1k.values.types import PRIVATE
from xden_bench.entries.leaderboard import tables
from xden_bench.entries.ranking import TRIVIAL, Entry, ranks, unranked_because
from xden_bench.entries.result import entry_path
from xden_bench.scoring.metrics import METRICS
from xden_bench.scoring.protocol import load_protocol

__all__ = [
    "best_first",
    "board_table",
    "boards",
    "entry_at",
    "facts",
    "group_table",
    "how_made",
    "metric_choices",
    "trivial",
]

Rows = list[list[Any]]

KEY_DIGITS: Final = 8
"""Of the submission's checksum: the key of a row, its last column."""
BEFORE: Final = ("rank", "tie", "method", "source")
AFTER: Final = ("looks at", "trained on", "external data", "status", "date", "submission")


def boards(entries: Iterable[Entry]) -> dict[str, dict[str, Sequence[Entry]]]:
    """Sort entries into the tables they may be compared in: by title, then by track.

    A title has source, split, target, dataset, protocol and, where it is old, metric version.
    Nothing is ranked across.
    """
    found: dict[str, dict[str, Sequence[Entry]]] = {}
    for rows in tables(entries):
        found.setdefault(_title(rows[0]), {})[rows[0]["track"]] = rows
    return found


def metric_choices(rows: Sequence[Entry]) -> list[tuple[str, str]]:
    """Heading and name of each metric that a row of a table has, the ranking one first."""
    first = load_protocol(rows[0]["protocol"]).rank_by
    names = [name for name in METRICS if any(name in row["metrics"] for row in rows)]
    names.sort(key=lambda name: name != first)
    return [(METRICS[name].heading, name) for name in names]


def trivial(row: Entry) -> bool:
    """Whether a row is one of a trivial method."""
    return unranked_because(row) == TRIVIAL


def best_first(rows: Sequence[Entry], metric: str) -> list[Entry]:
    """Rows that have a metric, best mean first, equal ones by name."""
    rows = [row for row in rows if metric in row["metrics"]]
    means = np.array([row["metrics"][metric]["mean"] for row in rows], dtype=np.float64)
    losses = METRICS[metric].loss(means).tolist()
    order = sorted(range(len(rows)), key=lambda at: (losses[at], rows[at]["method"]["name"]))
    return [rows[place] for place in order]


def board_table(rows: Sequence[Entry], metric: str) -> tuple[list[str], Rows]:
    """Headings and rows of the leaderboard, best in the metric first.

    The rank is that of the ranking metric, whichever metric is chosen; a tie is a rank that rows
    share. Means are numbers, so that a table sorts by them; the chosen metric has its
    interval beside it.
    """
    others = [name for _, name in metric_choices(rows) if name != metric]
    found = ranks(rows)
    standing = {
        _key(row): [rank, "=" if rank is not None and found.count(rank) > 1 else ""]
        for row, rank in zip(rows, found, strict=True)
    }
    interval = f"95 % interval of {METRICS[metric].title}"
    headings = [*BEFORE, METRICS[metric].heading, interval]
    headings += [*(METRICS[name].heading for name in others), *AFTER]
    ordered = best_first(rows, metric)
    return headings, [[*standing[_key(row)], *_row(row, metric, others)] for row in ordered]


def entry_at(rows: Sequence[Entry], cells: Sequence[Any]) -> Entry | None:
    """Find the entry of a row of :func:`board_table`, however the page has sorted it."""
    return next((row for row in rows if cells and _key(row) == cells[-1]), None)


def group_table(rows: Sequence[Entry], metric: str, by: str) -> tuple[list[str], Rows]:
    """Headings and rows of the table by ``category`` or ``size``: one column for each method.

    No rows of the split private: a group may be a single object, whose score tells its answer.
    """
    ordered = best_first(rows, metric)
    shown = [row for row in ordered if row["dataset"]["split"] != PRIVATE]
    groups = list(dict.fromkeys(name for row in shown for name in row[f"by_{by}"]))
    table = []
    for group in groups:
        found = [row[f"by_{by}"].get(group) for row in ordered]
        count = max(one["n_objects"] for one in found if one)
        table.append([group, count, *(_group_cell(one, metric) for one in found)])
    return [by, "objects", *(row["method"]["name"] for row in ordered)], table


def how_made(row: Entry, results: Path) -> str:
    """Return the commands that make a row again, and those that check it."""
    method = row["method"]
    place = shlex.quote((results / entry_path(row)).as_posix())
    commit = f", commit {_line(row['commit'])}" if row["commit"] else ""
    lines = [
        f"# xden1k {_line(row['xden_version'])}{commit}",
        f"# dataset {_line(row['dataset']['revision'])}, manifest sha256 "
        f"{row['dataset']['manifest_sha256']}",
        *(_line(command) for command in (method["command"], row["command"]) if command),
        "",
        "# compare every number with the stored entry",
        f"xden-bench verify {place}",
    ]
    return "\n".join(lines)


def facts(row: Entry) -> Rows:
    """Return what a row says of itself, one line each: name and text."""
    method = row["method"]
    reason = unranked_because(row)
    pairs = {
        "method": method["name"],
        "not ranked": reason,
        "notes": method["notes"],
        "paper": method["paper"],
        "code": method["code"],
        "seconds per object": method["seconds_per_object"],
        "objects": row["n_objects"],
        "submission sha256": row["submission_sha256"],
        **{f"footnote {place}": text for place, text in enumerate(row["warnings"], start=1)},
    }
    return [[name, str(text)] for name, text in pairs.items() if text not in (None, "")]


def _title(row: Entry) -> str:
    data = row["dataset"]
    return (
        f"{data['source']} · {data['split']} · {row['target']} · "
        f"dataset {data['revision']} ({data['manifest_sha256'][:KEY_DIGITS]}) · "
        f"protocol {row['protocol']}{_version(row)}"
    )


def _version(row: Entry) -> str:
    """Name a metric version that is not the protocol's newest."""
    version = row["metric_version"]
    newest = load_protocol(row["protocol"]).metric_version
    return "" if version == newest else f", old metric version {version}"


def _key(row: Entry) -> str:
    return str(row["submission_sha256"][:KEY_DIGITS])


def _row(row: Entry, metric: str, others: Sequence[str]) -> list[Any]:
    method, found = row["method"], row["metrics"]
    mark = " (trivial)" if trivial(row) else ""
    low, high = found[metric]["ci95"]
    return [
        f"{method['name']}{mark}",
        row["dataset"]["source"],
        _rounded(found[metric]["mean"]),
        f"{low:.3f} to {high:.3f}",
        *(_rounded(found[name]["mean"]) if name in found else None for name in others),
        ", ".join(method["inputs"]) or "nothing",
        ", ".join(method["training_data"]) or "nothing",
        "yes" if method["external_data"] else "no",
        row["status"],
        row["date"],
        _key(row),
    ]


def _group_cell(group: Mapping[str, Any] | None, metric: str) -> str:
    if group is None or metric not in group["metrics"]:
        return ""
    found = group["metrics"][metric]
    low, high = found["ci95"]
    return f"{found['mean']:.3f} [{low:.3f}, {high:.3f}]"


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")


def _line(text: str) -> str:
    """Text of a stranger on one line."""
    return " ".join(text.split())
