"""What the leaderboard page shows, for its template. Text of strangers stays text."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final
from urllib.parse import urlencode

import numpy as np

from xden1k.errors import MissingObjectError
from xden1k.values.types import PRIVATE
from xden_bench.entries.leaderboard import PRINTED, TRACK_TITLES
from xden_bench.entries.merging import entries_of, few_seeds, seed_spread
from xden_bench.entries.ranking import Entry, rank_label, unranked_because, unsure_because
from xden_bench.entries.result import entry_path
from xden_bench.entries.unseen import DROP_HEADINGS, drop_rows
from xden_bench.scoring.metrics import METRICS
from xden_bench.scoring.protocol import load_rules
from xden_bench.serve.names import alphabets, is_link
from xden_bench.serve.standings import Snapshot, Table, place_of

__all__ = [
    "ORACLE",
    "Asked",
    "best_first",
    "board_values",
    "facts",
    "group_table",
    "how_made",
    "kind",
    "link",
    "metric_choices",
]

RESULTS: Final = "benchmarks/results"
"""Where entries lie in a checkout, for the commands that are shown."""
ORACLE: Final = "oracle"
"""What the reason of a row begins with that is told what only the truth tells."""
BY_CATEGORY: Final = {"heading": "by category", "href": "", "chosen": False, "sort": ""}
"""Heading of the mean over categories, which sorts no table."""
_KEY_DIGITS: Final = 8


@dataclass(frozen=True, slots=True)
class Asked:
    """What a visitor asked for; None = the first.

    Parameters
    ----------
    table
        From :func:`_address`.
    track
        Of the table.
    metric
        That sorts it.
    row
        Place of an entry, which is shown in full: its table and track hold, whatever else is asked.
    """

    table: str | None = None
    track: str | None = None
    metric: str | None = None
    row: str | None = None


def board_values(snapshot: Snapshot, asked: Asked) -> dict[str, Any]:
    """Return everything the template names but the chart.

    Raises
    ------
    MissingObjectError
        If there is no such table, track, metric or row.
    """
    if not snapshot.tables:
        return {"is_current": snapshot.is_current, "rows": [], "unranked": []}
    table, tracks = _chosen(snapshot, asked)
    first = table.rows[0]
    rules = load_rules(first["protocol"])
    asked = replace(asked, table=_address(first), track=first["track"])
    names = metric_choices(table.rows)
    metric = asked.metric or names[0]
    if metric not in names:
        raise MissingObjectError(f"no row of the table has the metric {metric}")
    columns = [metric, *(name for name in names if name in PRINTED and name != metric)]
    ordered = best_first(table.rows, metric)
    shown = [_line(row, table, columns, asked) for row in ordered]
    headings = [_heading(name, metric, asked) for name in columns]
    if rules.is_ranked:
        headings.insert(1, BY_CATEGORY)
    return {
        "is_current": snapshot.is_current,
        "title": _title(first),
        "track": first["track"],
        "metric": metric,
        "table": table,
        "titles": _titles(snapshot, asked),
        "tracks": [
            {
                "name": one,
                "title": TRACK_TITLES[one],
                "href": link(Asked(table=asked.table, track=one)),
                "chosen": one == asked.track,
            }
            for one in tracks
        ],
        "metrics": [
            {"value": name, "title": METRICS[name].heading, "chosen": name == metric}
            for name in names
        ],
        "address": asked.table,
        "headings": headings,
        "is_ranked": rules.is_ranked,
        "protocol": rules.name,
        "ranked_by": METRICS[rules.rank_by].title,
        "has_intervals": any(_ends(row, metric) for row in table.rows),
        "interval_objects": rules.min_interval_objects,
        "interval_categories": rules.min_interval_categories,
        "rows": [one for one in shown if one["rank"]],
        "unranked": [one for one in shown if not one["rank"]],
        "groups": [*_drop(table, snapshot), *_groups(ordered, metric)],
    }


def link(asked: Asked) -> str:
    """Return the address of the page that shows something."""
    pairs = {"table": asked.table, "track": asked.track, "metric": asked.metric, "row": asked.row}
    if asked.row:
        name = asked.row.rpartition("/")[2]
        return f"/board?{urlencode({'row': asked.row}, safe='/')}#{name}"
    return f"/board?{urlencode({key: text for key, text in pairs.items() if text}, safe='/')}"


def metric_choices(rows: Sequence[Entry]) -> list[str]:
    """Name of each metric that a row of a table has, the ranking one first."""
    first = load_rules(rows[0]["protocol"]).rank_by
    names = [name for name in METRICS if any(name in row["metrics"] for row in rows)]
    return sorted(names, key=lambda name: name != first)


def kind(row: Entry) -> str:
    """Say why a row stands apart: ``trivial``, ``oracle: ...`` or another reason; else nothing."""
    return unranked_because(row) or ""


def best_first(rows: Sequence[Entry], metric: str) -> list[Entry]:
    """Rows that have a metric, best mean first, equal ones by name; then the others."""
    have = [row for row in rows if metric in row["metrics"]]
    means = np.array([row["metrics"][metric]["mean"] for row in have], dtype=np.float64)
    losses = METRICS[metric].loss(means).tolist()
    order = sorted(range(len(have)), key=lambda at: (losses[at], have[at]["method"]["name"]))
    return [*(have[at] for at in order), *(row for row in rows if metric not in row["metrics"])]


def group_table(rows: Sequence[Entry], metric: str, by: str) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of the table by ``category`` or ``size``: one column for each method.

    No rows of the split private: a group may be a single object, whose score tells its answer.
    """
    shown = [row for row in rows if row["dataset"]["split"] != PRIVATE]
    groups = list(dict.fromkeys(name for row in shown for name in row[f"by_{by}"]))
    table = []
    for group in groups:
        found = [row[f"by_{by}"].get(group) for row in rows]
        count = max(one["n_objects"] for one in found if one)
        table.append([group, str(count), *(_group_cell(one, metric) for one in found)])
    return [by, "objects", *(row["method"]["name"] for row in rows)], table


def how_made(row: Entry) -> str:
    """Return the commands that make a row again, and those that check it."""
    commit = f", commit {_one_line(row['commit'])}" if row["commit"] else ""
    lines = [
        f"# xden1k {_one_line(row['xden_version'])}{commit}",
        f"# dataset {_one_line(row['dataset']['revision'])}, manifest sha256 "
        f"{row['dataset']['manifest_sha256']}",
        *(_one_line(command) for one in entries_of(row) for command in _commands(one) if command),
        "",
        "# compare every number with the stored entry",
        *(
            f"xden-bench verify {shlex.quote(f'{RESULTS}/{entry_path(one).as_posix()}')}"
            for one in entries_of(row)
        ),
    ]
    return "\n".join(lines)


def facts(row: Entry) -> list[tuple[str, str, bool]]:
    """Return what a row says of itself: name, text, and whether the text may be a link."""
    method = row["method"]
    links = {key: method[key] for key in ("paper", "code")}
    pairs = {
        "not ranked": kind(row),
        "intervals": unsure_because(row),
        "notes": method["notes"],
        **links,
        "external data": "yes" if method["external_data"] else "no",
        "seconds per object": method["seconds_per_object"],
        "processor seconds per object": method.get("processor_seconds_per_object"),
        "peak memory, GB": method.get("peak_memory_gb"),
        "hardware": method.get("hardware"),
        "objects": row["n_objects"],
        "submission sha256": row["submission_sha256"],
        **_seed_facts(row),
        "erratum": row.get("erratum", {}).get("text"),
        **{f"remark {place}": text for place, text in enumerate(row.get("remarks", ()), start=1)},
        **{f"footnote {place}": text for place, text in enumerate(row["warnings"], start=1)},
        **{f"letters in {key}": alphabets(text or "") for key, text in links.items()},
    }
    return [
        (name, str(text), name in links and is_link(str(text)))
        for name, text in pairs.items()
        if text not in (None, "")
    ]


def _seed_facts(row: Entry) -> dict[str, str]:
    """Return what a row says of the seeds that it is the mean of, or should be."""
    metric = load_rules(row["protocol"]).rank_by
    told = {
        f"seed {one['method']['seed']}": f"{METRICS[metric].heading} "
        f"{one['metrics'][metric]['mean']:.3f}, submission sha256 {one['submission_sha256']}"
        for one in row.get("seeds", ())
    }
    return told | {"seeds": few_seeds(row)}


def _chosen(snapshot: Snapshot, asked: Asked) -> tuple[Table, list[str]]:
    """Return the table asked for, and the tracks beside it."""
    address, track = asked.table, asked.track
    if asked.row is not None:
        if (found := snapshot.row_of(asked.row)) is None:
            raise MissingObjectError("there is no such row")
        _, row = found
        address, track = _address(row), row["track"]
    address = address or _address(snapshot.tables[0].rows[0])
    beside = {
        one.rows[0]["track"]: one for one in snapshot.tables if _address(one.rows[0]) == address
    }
    track = track or next(iter(beside), "")
    if track not in beside:
        raise MissingObjectError("there is no such table")
    return beside[track], list(beside)


def _titles(snapshot: Snapshot, asked: Asked) -> list[dict[str, Any]]:
    found = {_address(table.rows[0]): _title(table.rows[0]) for table in snapshot.tables}
    return [
        {"value": value, "title": title, "chosen": value == asked.table}
        for value, title in found.items()
    ]


def _heading(name: str, metric: str, asked: Asked) -> dict[str, Any]:
    chosen = Asked(table=asked.table, track=asked.track, metric=name)
    return {
        "heading": METRICS[name].heading,
        "href": link(chosen),
        "chosen": name == metric,
        "sort": "descending" if METRICS[name].higher_is_better else "ascending",
    }


def _drop(table: Table, snapshot: Snapshot) -> Iterator[dict[str, Any]]:
    """Give the table from seen to unseen categories, where both splits have a method."""
    if cells := drop_rows(table.rows, [one.rows for one in snapshot.tables]):
        metric = METRICS[load_rules(table.rows[0]["protocol"]).rank_by]
        title = f"From seen to unseen categories: {metric.heading}"
        yield {"title": title, "headings": DROP_HEADINGS, "rows": cells}


def _groups(rows: Sequence[Entry], metric: str) -> Iterator[dict[str, Any]]:
    titles = {"category": "By category", "size": "By size of the object"}
    for by, title in titles.items():
        headings, cells = group_table(rows, metric, by)
        if cells:
            yield {
                "title": f"{title}: {METRICS[metric].heading}",
                "headings": headings,
                "rows": cells,
            }


def _line(row: Entry, table: Table, names: Sequence[str], asked: Asked) -> dict[str, Any]:
    """Return a row of the table, for the template."""
    method, place = row["method"], place_of(row)
    rank, team = table.rank_of(row), row.get("team", {}).get("name", "")
    opened = any(place_of(one) == asked.row for one in entries_of(row))
    return {
        "rank": rank_label(rank, table.ranks),
        "name": method["name"],
        "team": team,
        "alphabets": alphabets(team),
        "kind": kind(row),
        "href": link(Asked(row=place)),
        "anchor": place.rpartition("/")[2],
        "figures": _figures(row, names),
        "inputs": ", ".join(method["inputs"]) or "nothing",
        "trained_on": ", ".join(method["training_data"]) or "nothing",
        "status": row["status"],
        "date": row["date"],
        "facts": facts(row) if opened else [],
        "how": how_made(row) if opened else "",
    }


def _figures(row: Entry, names: Sequence[str]) -> list[dict[str, str]]:
    """Cells of the metrics; after the first, where the protocol has it, its mean by category."""
    cells = [_value(row, name) for name in names]
    if load_rules(row["protocol"]).is_ranked:
        macro = row["metrics"].get(names[0], {}).get("macro_mean")
        cells.insert(1, _cell("" if macro is None else f"{macro:.3f}"))
    return cells


def _value(row: Entry, name: str) -> dict[str, str]:
    """Mean, spread over seeds and interval as they are printed; nothing where there is none."""
    if name not in row["metrics"]:
        return _cell("")
    spread, ends = seed_spread(row, name), _ends(row, name)
    return _cell(
        f"{row['metrics'][name]['mean']:.3f}",
        "" if spread is None else f"± {spread:.3f}",
        "[{:.3f}, {:.3f}]".format(*ends) if ends else "",
    )


def _cell(mean: str, spread: str = "", interval: str = "") -> dict[str, str]:
    return {"mean": mean, "spread": spread, "interval": interval}


def _ends(row: Entry, name: str) -> Sequence[float] | None:
    ends: Sequence[float] | None = row["metrics"].get(name, {}).get("ci95")
    return ends


def _group_cell(group: Mapping[str, Any] | None, metric: str) -> str:
    if group is None or metric not in group["metrics"]:
        return ""
    found = group["metrics"][metric]
    return f"{found['mean']:.3f}"  # a group is too small for an interval


def _title(row: Entry) -> str:
    data = row["dataset"]
    return (
        f"{data['source']} · {data['split']} · {row['target']} · "
        f"dataset {data['revision']} ({data['manifest_sha256'][:_KEY_DIGITS]}) · "
        f"protocol {row['protocol']}{_version(row)}"
    )


def _address(row: Entry) -> str:
    """Name a table without its track, for links."""
    place = entry_path(row).parent.parent.as_posix()
    return f"{place}@{row['metric_version']}" if _version(row) else place


def _version(row: Entry) -> str:
    """Name a metric version that is not the protocol's newest."""
    version = row["metric_version"]
    newest = load_rules(row["protocol"]).metric_version
    return "" if version == newest else f", old metric version {version}"


def _commands(entry: Entry) -> tuple[str, str]:
    """Return what made a submission, and what scored it."""
    return entry["method"]["command"], entry["command"]


def _one_line(text: str) -> str:
    """Text of a stranger on one line."""
    return " ".join(text.split())
