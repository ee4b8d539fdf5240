"""The board for programs: JSON, CSV, and the history of the results."""

from __future__ import annotations

import csv
import io
import subprocess
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from xden_bench.entries.ranking import Entry
from xden_bench.entries.standing import no_rank_because
from xden_bench.scoring.metrics import METRICS
from xden_bench.serve.board import Asked, link
from xden_bench.serve.standings import Snapshot, Table, place_of

__all__ = ["board_csv", "board_json", "history"]

_KEPT: Final = (
    *("method", "protocol", "metric_version", "track", "target", "dataset", "n_objects"),
    *("metrics", "submission_sha256", "xden_version", "commit", "date", "status", "warnings"),
)
_LOG: Final = ("git", "log", "--no-show-signature", "--format=%x00%H%x09%cI%x09%s", "--name-status")


def board_json(snapshot: Snapshot) -> dict[str, Any]:
    """Return every table with its rows and ranks, of JSON's types.

    ``is_current`` is false where the results have changed and cannot be read.
    """
    tables = [[row for _, row in _rows(table)] for table in snapshot.tables]
    return {"is_current": snapshot.is_current, "tables": tables}


def board_csv(snapshot: Snapshot) -> str:
    """Return one line for each row of every table: its ranks, means and intervals.

    Text that a spreadsheet would take for a formula has an apostrophe before it.
    """
    stream = io.StringIO()
    metrics = [one for one in METRICS if any(one in row["metrics"] for row in snapshot.entries)]
    ends = [f"{one}{end}" for one in metrics for end in ("", "_low", "_high")]
    names = ["protocol", "metric_version", "dataset", "manifest_sha256", "split", "source"]
    names += ["target", "track", "rank", "not_ranked", "method", "n_objects", *ends]
    writer = csv.DictWriter(stream, [*names, "status", "date", "submission_sha256", "link"])
    writer.writeheader()
    for table in snapshot.tables:
        writer.writerows(_flat(row, found) for row, found in _rows(table))
    return stream.getvalue()


def history(results: Path) -> list[dict[str, Any]]:
    """Return the commits that changed the results, the newest first.

    Parameters
    ----------
    results
        Folder of the entries; outside a git repository, or without git, there is no history.

    Returns
    -------
    list of dict
        ``commit``, ``date``, ``subject``, and ``added``, ``changed``, ``removed``: places of
        entries.
    """
    if not results.is_dir():
        return []
    try:
        found = subprocess.run(  # noqa: S603 - no text of a stranger
            [*_LOG, "--relative", "--", "."],
            cwd=results,
            capture_output=True,
            check=True,
            encoding="utf-8",
        )
    except (subprocess.CalledProcessError, FileNotFoundError):
        return []
    return [_commit(text) for text in found.stdout.split("\0")[1:]]


def _rows(table: Table) -> Iterator[tuple[Entry, dict[str, Any]]]:
    """Each row with what a program gets of it."""
    for row, rank in zip(table.rows, table.ranks, strict=True):
        yield (
            row,
            {
                "rank": rank,
                "not_ranked": no_rank_because(row) if rank is None else None,
                "link": link(Asked(row=place_of(row))),
                **{key: row[key] for key in _KEPT},
            },
        )


def _flat(row: Entry, found: Mapping[str, Any]) -> dict[str, Any]:
    data = row["dataset"]
    same = ("protocol", "metric_version", "target", "track", "n_objects", "status", "date")
    line = {
        **{key: row[key] for key in (*same, "submission_sha256")},
        **{key: data[key] for key in ("manifest_sha256", "split", "source")},
        **{key: found[key] for key in ("rank", "not_ranked", "link")},
        "dataset": data["revision"],
        "method": row["method"]["name"],
    }
    for name, one in row["metrics"].items():
        low, high = one.get("ci95") or (None, None)
        line |= {name: one["mean"], f"{name}_low": low, f"{name}_high": high}
    return {key: _harmless(value) for key, value in line.items()}


def _harmless(value: Any) -> Any:
    risky = isinstance(value, str) and value.startswith(("=", "+", "-", "@"))
    return f"'{value}" if risky else value


def _commit(text: str) -> dict[str, Any]:
    head, *changes = (line for line in text.splitlines() if line)
    commit, date, subject = head.split("\t", 2)
    places: dict[str, list[str]] = {"added": [], "changed": [], "removed": []}
    ways = {"A": "added", "M": "changed", "D": "removed"}
    for change in changes:
        way, _, path = change.partition("\t")
        if path.endswith(".json") and way in ways:
            places[ways[way]].append(path.removesuffix(".json"))
    return {"commit": commit, "date": date, "subject": subject, **places}
