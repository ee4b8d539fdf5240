"""LEADERBOARD.md, made from the results: the part between two markers is never written by hand."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from tabulate import tabulate

from xden1k.errors import DataError
from xden1k.values.modality import TRACKS
from xden_bench.entries.durable import write_text
from xden_bench.entries.ranking import TRIVIAL, Entry, rank_labels, ranks, unranked_because
from xden_bench.scoring.metrics import METRICS
from xden_bench.scoring.protocol import load_protocol

__all__ = [
    "check_leaderboard",
    "group_tables",
    "ranks",
    "render",
    "tables",
    "unranked_because",
    "write_leaderboard",
]

BEGIN: Final = "<!-- results: begin (made by xden-bench leaderboard, do not edit) -->"
END: Final = "<!-- results: end -->"

HEADER: Final = f"""# Leaderboard

How dense is every voxel of an object, where is its centre of mass, and what does it weigh?
The rules, and how to enter a method: [benchmarks/README.md](benchmarks/README.md).

How to read the tables:

- A value is the mean over objects, in brackets its 95 % bootstrap interval. ↓ lower is better,
  ↑ higher is better. Density MAE is over the volume inside the outer surface, enclosed cavities
  included. MAPE, ALDE and MnRE are three errors of the mass; MAPE alone would favour methods that
  predict too little.
- Methods are ranked by density MAE. A rank is one more than the number of rows that are better
  beyond doubt: the 95 % interval of the difference on the same objects excludes zero. Rows that
  share a rank are a tie, `1=`.
- *Rows in italics* are trivial and never ranked: nothing (`zero`), 1 g/cm³ everywhere (`water`),
  and the median density of the training objects, of all or by category. A method has to beat them.
  Another row without a rank says why in its footnote.
- Tables of different tracks, datasets or sources (`scan`: the scanner's objects, `phantom`:
  simulated ones) are never compared.

{BEGIN}
{END}
"""

PRINTED: Final = (
    "density_mae_g_cm3",
    "com_l1_cm",
    "mass_mape",
    "mass_alde",
    "mass_mnre",
    "density_crps_g_cm3",
    "density_within_1sd",
)
"""Metrics of the tables, where a row has them; the others are in the results."""

PAPER_ROWS: Final = (
    ("NeRF2Physics", "1.157", "0.523", "1.174"),
    ("GaussianProperty", "1.295", "0.632", "1.247"),
    ("Pixie", "1.228", "0.547", "0.713"),
)
"""Density MAE, CoM, mass MAPE as the XDen-1K paper prints them (arXiv 2512.10668)."""

OLD_VERSIONS: Final = """## Older metric versions

Scored before a correction of the metrics' code. These rows are kept, and never ranked together with
those above."""

TRACK_TITLES: Final = {
    "geometry": "outer surface alone",
    "rgb": "colour pictures",
    "rgb_parts": "colour pictures and part ids",
    "xray": "X-rays",
}


def render(entries: Iterable[Entry]) -> str:
    """Text between the markers.

    The order of the entries does not matter. Tables of an older metric version come last.

    Parameters
    ----------
    entries
        From :func:`xden_bench.entries.result.read_entries`.
    """
    every = tables(entries)
    current = [_section(rows) for rows in every if not _is_old(rows[0])] or ["No entries yet."]
    old = [_section(rows) for rows in every if _is_old(rows[0])]
    return "\n\n".join([*current, *([OLD_VERSIONS] if old else []), *old, _paper_section()])


def tables(entries: Iterable[Entry]) -> list[list[Entry]]:
    """Rows of each table, the best first.

    One table for each protocol, metric version, dataset, split, source, target and track; nothing
    is ranked across.

    Parameters
    ----------
    entries
        From :func:`xden_bench.entries.result.read_entries`, in any order.
    """
    found: dict[tuple[Any, ...], list[Entry]] = {}
    for entry in entries:
        found.setdefault(_table_key(entry), []).append(entry)
    return [sorted(found[key], key=_place) for key in sorted(found)]


def group_tables(entries: Iterable[Entry], by: str, metric: str | None = None) -> str:
    """One metric by category or by size: a line for each group, a column for each method.

    Parameters
    ----------
    entries
        From :func:`xden_bench.entries.result.read_entries`.
    by
        ``category`` or ``size``.
    metric
        One that every row has; None = that of the ranking.

    Raises
    ------
    DataError
        If a row does not have the metric.
    """
    return "\n\n".join(_group_table(rows, f"by_{by}", metric) for rows in tables(entries))


def write_leaderboard(entries: Iterable[Entry], path: Path) -> None:
    """Rewrite the part between the markers; a file that is not there is begun.

    Raises
    ------
    DataError
        If the file does not have each marker once.
    """
    old = path.read_text(encoding="utf-8") if path.exists() else HEADER
    write_text(path, _with_section(old, render(entries), path))


def check_leaderboard(entries: Iterable[Entry], path: Path) -> None:
    """Compare the file with the results.

    Raises
    ------
    DataError
        If they disagree, or the file is missing or does not have each marker once.
    """
    if not path.exists():
        raise DataError(f"{path} is missing: run xden-bench leaderboard")
    old = path.read_text(encoding="utf-8")
    if _with_section(old, render(entries), path) != old:
        raise DataError(f"{path} does not match the results: run xden-bench leaderboard")


def _with_section(text: str, section: str, path: Path) -> str:
    """Replace what stands between the markers, which are whole lines."""
    lines = text.split("\n")
    places = [place for place, line in enumerate(lines) if line in (BEGIN, END)]
    if [lines[place] for place in places] != [BEGIN, END]:
        raise DataError(f"{path}: the lines {BEGIN!r} and {END!r} must each be there once")
    first, last = places
    return "\n".join([*lines[: first + 1], "", section, "", *lines[last:]])


def _table_key(entry: Entry) -> tuple[Any, ...]:
    data = entry["dataset"]
    return (
        entry["protocol"],
        -entry["metric_version"],
        data["revision"],
        data["manifest_sha256"],
        data["split"],
        data["source"],
        entry["target"],
        TRACKS.index(entry["track"]),
    )


def _section(rows: Sequence[Entry]) -> str:
    """One table with its title and notes."""
    metrics = [one for one in PRINTED if any(one in row["metrics"] for row in rows)]
    headings = ["rank", "method", *(METRICS[one].heading for one in metrics), "looks at"]
    headings += ["trained on", "external data", "s / object", "status", "date"]
    labels = rank_labels(rows)
    table = [_row(row, label, metrics) for row, label in zip(rows, labels, strict=True)]
    return "\n\n".join(
        [
            _title(rows[0]),
            tabulate(table, headings, tablefmt="pipe", disable_numparse=True),
            "How each row was made, and its footnotes:",
            "\n".join(_details(row) for row in rows),
        ]
    )


def _is_old(row: Entry) -> bool:
    return bool(row["metric_version"] != load_protocol(row["protocol"]).metric_version)


def _place(row: Entry) -> tuple[Any, ...]:
    """Sort rows of a table by mean, then by name."""
    name = load_protocol(row["protocol"]).rank_by
    mean = row["metrics"][name]["mean"]
    loss = -mean if METRICS[name].higher_is_better else mean
    return loss, row["method"]["name"], row["submission_sha256"]


def _group_table(rows: Sequence[Entry], key: str, metric: str | None) -> str:
    name = metric or load_protocol(rows[0]["protocol"]).rank_by
    if lacking := [row["method"]["name"] for row in rows if name not in row["metrics"]]:
        raise DataError(f"no {name} in the rows {lacking}; there are {list(rows[0]['metrics'])}")
    table = [
        (
            _plain(group),
            one["n_objects"],
            *(_figure(row[key][group]["metrics"], name) for row in rows),
        )
        for group, one in rows[0][key].items()
    ]
    headings = [METRICS[name].heading, "objects", *(_plain(row["method"]["name"]) for row in rows)]
    text = tabulate(table, headings, tablefmt="pipe", disable_numparse=True)
    return f"{_title(rows[0])}\n\n{text}"


def _title(row: Entry) -> str:
    data = row["dataset"]
    version = f", metric version {row['metric_version']}" if _is_old(row) else ""
    choices = load_protocol(row["protocol"]).open_choices
    said = "; ".join(f"{name.replace('_', ' ')}: {text}" for name, text in choices.items())
    return (
        f"## Track `{row['track']}`: {TRACK_TITLES[row['track']]}\n\n"
        f"Source of the objects: **{_plain(data['source'])}**. Target `{row['target']}`, "
        f"split {_code(data['split'])}, {row['n_objects']} objects, dataset "
        f"{_plain(data['revision'])} (manifest {_code(data['manifest_sha256'][:12])}), "
        f"protocol {_plain(row['protocol'])}{version}. "
        "Means over objects with 95 % bootstrap intervals."
        + (f"\n\nChoices that the paper leaves open: {said}." if choices else "")
    )


def _row(row: Entry, label: str, metrics: Sequence[str]) -> list[str]:
    method = row["method"]
    return [
        label,
        _marked_name(row),
        *(_figure(row["metrics"], one) for one in metrics),
        _plain(", ".join(method["inputs"])) or "nothing",
        _plain(", ".join(method["training_data"])) or "nothing",
        "yes" if method["external_data"] else "no",
        "" if method["seconds_per_object"] is None else f"{method['seconds_per_object']:.2g}",
        _plain(" ".join([row["status"], row.get("recomputed", {}).get("date", "")]).strip()),
        _plain(row["date"]),
    ]


def _marked_name(row: Entry) -> str:
    """Name of a row's method: trivial ones in italics, withdrawn ones struck out."""
    name = _plain(row["method"]["name"])
    mark = "~~" if "withdrawn" in row else "*" if unranked_because(row) == TRIVIAL else ""
    return f"{mark}{name}{mark}"


def _figure(metrics: Mapping[str, Any], name: str) -> str:
    """Mean and interval; empty where a row does not have the metric."""
    if name not in metrics:
        return ""
    low, high = metrics[name]["ci95"]
    return f"{metrics[name]['mean']:.3f} [{low:.3f}, {high:.3f}]"


def _details(row: Entry) -> str:
    """One list item: commands, version, checksum, notes and warnings."""
    method = row["method"]
    commands = [_code(one) for one in (method["command"], row["command"]) if one]
    commit = row["commit"] or ""
    shown = f", commit {_code(commit[:12] + _dirty(commit))}" if commit else ""
    reason = unranked_because(row) or ""
    facts = [
        f"**{_plain(method['name'])}**: {', then '.join(commands)}",
        f"xden1k {_plain(row['xden_version'])}{shown}",
        f"submission {_code(row['submission_sha256'][:12])}",
        *([f"team {_plain(row['team']['name'])}"] if "team" in row else []),
        *([f"not ranked: {_plain(reason)}"] if reason not in ("", TRIVIAL) else []),
        *([f"erratum: {_plain(row['erratum']['text'])}"] if "erratum" in row else []),
        *map(_plain, row.get("remarks", ())),
        *(_plain(text) for text in (method["notes"], *row["warnings"]) if text),
        *(_link(method[key]) for key in ("paper", "code") if method[key]),
    ]
    return "- " + "; ".join(facts)


def _dirty(commit: str) -> str:
    return "-dirty" if commit.endswith("-dirty") else ""


def _paper_section() -> str:
    headings = ["method", "density MAE ↓", "CoM, cm ↓", "mass MAPE ↓"]
    table = tabulate(PAPER_ROWS, headings, tablefmt="pipe", disable_numparse=True)
    return (
        "## Reported by the paper, protocol unknown\n\n"
        "As printed in the XDen-1K paper (arXiv 2512.10668), never ranked and not comparable with "
        "the tables above: the paper gives neither the unit of density (only g/cm³ fits), nor the "
        "split, the voxels averaged over, or the rule for the mass. The MAPE is a ratio there "
        f"too, so two of the three score worse than predicting no mass at all, 1.000.\n\n{table}"
    )


def _plain(text: str) -> str:
    """Text that Markdown shows as it is, whatever a stranger put into it.

    A ``<`` becomes an entity: what reads the page as HTML knows of no other escape.
    """
    return re.sub(r"([\\`*_\[\]>|~&$])", r"\\\1", text).replace("<", "&lt;")


def _code(text: str) -> str:
    """Text as code, also in a table; with a ``<``, which stays one in backticks, as HTML."""
    if "<" in text:
        return f"<code>{_plain(text)}</code>"
    return "`{}`".format(text.replace("`", "'").replace("|", "\\|"))


def _link(text: str) -> str:
    """Turn a plain web address into a link, anything else into text."""
    return f"<{text}>" if re.fullmatch(r"https?://[\w./:~%?=&#+-]+", text) else _plain(text)
