"""LEADERBOARD.md, made from the results: the part between two markers is never written by hand."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from tabulate import tabulate

from xden1k.errors import DataError
from xden1k.values.modality import TRACKS
from xden_bench.entries.durable import write_text
from xden_bench.entries.markdown import code, link, plain
from xden_bench.entries.merging import few_seeds, merged_rows, place, seed_spread, silent_on_cost
from xden_bench.entries.ranking import (
    TRIVIAL,
    Entry,
    rank_labels,
    ranks,
    trusted_interval,
    unranked_because,
    unsure_because,
)
from xden_bench.entries.unseen import drop_table, track_title
from xden_bench.scoring.metrics import METRICS
from xden_bench.scoring.protocol import PROTOCOLS, SEGMENT_PROTOCOLS, load_rules

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

- A value is the mean over objects; ↓ lower is better, ↑ higher is better. *By category* is the mean
  over categories. Brackets are 95 % intervals over categories, which hang together; of `unseen`
  over the objects of its thirty categories. They stand only where simulations show that they cover:
  at least 300 objects of 100 categories, or 10 of each unseen one, no heavy tail, and no method
  that is told the truth, or the materials beside X-rays.
- Density MAE is over the volume inside the outer surface, enclosed cavities included; the relative
  density error is the same over the density there. MAPE, ALDE and MnRE are three errors of the
  mass; MAPE alone would favour methods that predict too little.
- Methods are ordered by density MAE. A row shares the rank above it, `1=`, unless it is worse
  beyond doubt than a row of that rank; in a table of up to 30 equal methods any two are told apart
  at most one time in twenty.
- A method of a team has one row: the mean over its seeds, ± their standard deviation. Copies stand
  below the row whose values they have, without a rank.
- *Rows in italics* are trivial and never ranked: nothing (`zero`), 1 g/cm³ everywhere (`water`),
  and the median density of the training objects, of all or by category. A method has to beat them.
  Another row without a rank says why in its footnote.
- Tables of different tracks, datasets, splits or sources (`scan`: the scanner's objects, `phantom`:
  simulated ones) are never compared, but for the drop from `test` to `unseen`, categories that no
  training object is of.

{BEGIN}
{END}
"""

PRINTED: Final = (
    "density_mae_g_cm3",
    "density_relative_error",
    "com_l1_cm",
    "com_l1_share",
    "mass_mape",
    "mass_alde",
    "mass_mnre",
    "density_crps_g_cm3",
    "density_within_1sd",
    "iou_a",
    "iou_b_material",
    "iou_b_part",
    "iou_c",
)
"""Metrics of the tables, where a row has them; the others are in the results."""

COSTS: Final = {
    "processor_seconds_per_object": "processor s / object",
    "peak_memory_gb": "GB",
}
"""Columns of what a method's process took, by what an entry calls it; only where a row tells it."""

PAPER_ROWS: Final = (
    ("NeRF2Physics", "1.157", "0.523", "1.174"),
    ("GaussianProperty", "1.295", "0.632", "1.247"),
    ("Pixie", "1.228", "0.547", "0.713"),
)
"""Density MAE, CoM, mass MAPE as the XDen-1K paper prints them (arXiv 2512.10668)."""

OLD_PROTOCOLS: Final = """## Older protocols

Kept, and remade by their own rules. Means alone: the percentile intervals of these protocols cover
too little, and their ranks followed from them."""

OLD_VERSIONS: Final = """## Older metric versions

Scored before a correction of the metrics' code. These rows are kept, and never ranked together with
those above."""

TRACK_TITLES: Final = {
    "geometry": "outer surface alone",
    "rgb": "colour pictures",
    "rgb_parts": "colour pictures and part ids",
    "xray": "X-rays",
}


def render(entries: Iterable[Entry], sections: Sequence[str] = ()) -> str:
    """Text between the markers.

    The order of the entries does not matter. Tables of an older protocol or metric version come
    last.

    Parameters
    ----------
    entries
        From :func:`xden_bench.entries.reading.read_entries`.
    sections
        Of other benchmarks.
    """
    every = tables(entries)
    ranked = [rows for rows in every if load_rules(rows[0]["protocol"]).is_ranked]
    current = [rows for rows in ranked if not _is_old(rows[0])]
    drops = [drop_table(rows, every) for rows in current]
    old = [rows for rows in ranked if _is_old(rows[0])]
    older = [rows for rows in every if rows not in ranked]
    return "\n\n".join(
        [
            *([_section(rows, _guests(rows, every)) for rows in current] or ["No entries yet."]),
            *filter(None, drops),
            *sections,
            *_part(OLD_VERSIONS, old),
            *_part(OLD_PROTOCOLS, older),
            _paper_section(),
        ]
    )


def _part(title: str, every: Sequence[Sequence[Entry]]) -> list[str]:
    """Title and tables of a part of the page; nothing without a table."""
    return [title, *map(_section, every)] if every else []


def tables(entries: Iterable[Entry]) -> list[list[Entry]]:
    """Rows of each table, the best first.

    One table for each protocol, metric version, dataset, split, source, target and track; nothing
    is ranked across. What is one row is told by :func:`xden_bench.entries.merging.merged_rows`.

    Parameters
    ----------
    entries
        From :func:`xden_bench.entries.reading.read_entries`, in any order.
    """
    found: dict[tuple[Any, ...], list[Entry]] = {}
    for entry in entries:
        found.setdefault(_table_key(entry), []).append(entry)
    return [merged_rows(found[key], _of_other_tracks(key, found)) for key in sorted(found)]


def _of_other_tracks(
    key: tuple[Any, ...], found: Mapping[tuple[Any, ...], list[Entry]]
) -> list[Entry]:
    """Entries of the tables that differ from one by their track alone."""
    keys = [other for other in found if other[:-1] == key[:-1] and other != key]
    return [entry for other in keys for entry in found[other]]


def group_tables(entries: Iterable[Entry], by: str, metric: str | None = None) -> str:
    """One metric by category or by size: a line for each group, a column for each method.

    Parameters
    ----------
    entries
        From :func:`xden_bench.entries.reading.read_entries`.
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


def write_leaderboard(entries: Iterable[Entry], path: Path, sections: Sequence[str] = ()) -> None:
    """Rewrite the part between the markers, as :func:`render` makes it; a new file is begun.

    Raises
    ------
    DataError
        If the file does not have each marker once.
    """
    old = path.read_text(encoding="utf-8") if path.exists() else HEADER
    write_text(path, _with_section(old, render(entries, sections), path))


def check_leaderboard(entries: Iterable[Entry], path: Path, sections: Sequence[str] = ()) -> None:
    """Compare the file with the results, as :func:`render` has them.

    Raises
    ------
    DataError
        If they disagree, or the file is missing or does not have each marker once.
    """
    if not path.exists():
        raise DataError(f"{path} is missing: run xden-bench leaderboard")
    old = path.read_text(encoding="utf-8")
    if _with_section(old, render(entries, sections), path) != old:
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
        (*PROTOCOLS, *SEGMENT_PROTOCOLS).index(entry["protocol"]),
        -entry["metric_version"],
        data["revision"],
        data["manifest_sha256"],
        data["split"],
        data["source"],
        entry["target"],
        TRACKS.index(entry["track"]),
    )


def _guests(rows: Sequence[Entry], every: Sequence[Sequence[Entry]]) -> list[Entry]:
    """Rows to read a table of segments by that were entered for another track."""
    if rows[0]["protocol"] not in SEGMENT_PROTOCOLS:
        return []
    *own, track = _table_key(rows[0])
    keys = ((other, *_table_key(other[0])) for other in every)
    alike = (row for other, *key, its in keys if key == own and its != track for row in other)
    return [row for row in alike if unranked_because(row) == TRIVIAL]


def _with_guests(rows: Sequence[Entry], guests: Sequence[Entry]) -> list[tuple[Entry, str]]:
    """Rows with their ranks, and guests without one where their means belong."""
    found = [*zip(rows, rank_labels(rows), strict=True)]
    for guest in guests:
        worse = (number for number, (row, _) in enumerate(found) if place(row) > place(guest))
        found.insert(next(worse, len(found)), (guest, ""))
    return found


def _section(rows: Sequence[Entry], guests: Sequence[Entry] = ()) -> str:
    """One table with its title and notes."""
    rules = load_rules(rows[0]["protocol"])
    metrics = [one for one in PRINTED if any(one in row["metrics"] for row in rows)]
    columns = [METRICS[one].heading for one in metrics]
    if rules.is_ranked:
        arrow = METRICS[rules.rank_by].heading.rsplit(maxsplit=1)[-1]
        columns.insert(1 + metrics.index(rules.rank_by), f"by category {arrow}")
    headings = ["rank", "method", *columns, "looks at"]
    costs = [key for key in COSTS if any(row["method"].get(key) is not None for row in rows)]
    headings += ["trained on", "external data", "s / object"]
    headings += [*(COSTS[key] for key in costs), "status", "date"]
    table = [_row(row, label, metrics, costs) for row, label in _with_guests(rows, guests)]
    return "\n\n".join(
        [
            _title(rows[0]),
            tabulate(table, headings, tablefmt="pipe", disable_numparse=True),
            "How each row was made, and its footnotes:",
            "\n".join([*map(_details, rows), *map(_elsewhere, guests)]),
        ]
    )


def _is_old(row: Entry) -> bool:
    return bool(row["metric_version"] != load_rules(row["protocol"]).metric_version)


def _group_table(rows: Sequence[Entry], key: str, metric: str | None) -> str:
    name = metric or load_rules(rows[0]["protocol"]).rank_by
    if lacking := [row["method"]["name"] for row in rows if name not in row["metrics"]]:
        raise DataError(f"no {name} in the rows {lacking}; there are {list(rows[0]['metrics'])}")
    table = [
        (
            plain(group),
            one["n_objects"],
            *(_mean(row[key][group]["metrics"], name) for row in rows),
        )
        for group, one in rows[0][key].items()
    ]
    headings = [METRICS[name].heading, "objects", *(plain(row["method"]["name"]) for row in rows)]
    text = tabulate(table, headings, tablefmt="pipe", disable_numparse=True)
    return f"{_title(rows[0])}\n\n{text}"


def _title(row: Entry) -> str:
    data = row["dataset"]
    version = f", metric version {row['metric_version']}" if _is_old(row) else ""
    choices = load_rules(row["protocol"]).open_choices
    said = "; ".join(f"{name.replace('_', ' ')}: {text}" for name, text in choices.items())
    return (
        f"## {track_title(row)}, split {code(data['split'])}: {TRACK_TITLES[row['track']]}\n\n"
        f"Source of the objects: **{plain(data['source'])}**. Target `{row['target']}`, "
        f"split {code(data['split'])}, {row['n_objects']} objects, dataset "
        f"{plain(data['revision'])} (manifest {code(data['manifest_sha256'][:12])}), "
        f"protocol {plain(row['protocol'])}{version}. "
        "Means over objects."
        + _left_out(row)
        + (f"\n\nChoices that the paper leaves open: {said}." if choices else "")
    )


def _left_out(row: Entry) -> str:
    """Say how many objects the ranking metric leaves out, where it does."""
    rank_by = load_rules(row["protocol"]).rank_by
    count = row.get("left_out", {}).get(rank_by, 0)
    return f" {METRICS[rank_by].title}: without {count} objects of one region." if count else ""


def _row(row: Entry, label: str, metrics: Sequence[str], costs: Sequence[str]) -> list[str]:
    method = row["method"]
    return [
        label,
        _marked_name(row),
        *(text for one in metrics for text in _figures(row, one)),
        plain(", ".join(method["inputs"])) or "nothing",
        plain(", ".join(method["training_data"])) or "nothing",
        "yes" if method["external_data"] else "no",
        _amount(method["seconds_per_object"], ""),
        *(_amount(method.get(key), "-") for key in costs),
        plain(" ".join([row["status"], row.get("recomputed", {}).get("date", "")]).strip()),
        plain(row["date"]),
    ]


def _amount(value: float | None, absent: str) -> str:
    return absent if value is None else f"{value:.2g}"


def _marked_name(row: Entry) -> str:
    """Name of a row's method: trivial ones in italics, withdrawn ones struck out."""
    name = plain(row["method"]["name"])
    mark = "~~" if "withdrawn" in row else "*" if unranked_because(row) == TRIVIAL else ""
    return f"{mark}{name}{mark}"


def _figures(row: Entry, name: str) -> list[str]:
    """Cells of a metric: mean, spread over seeds and interval; by category too if it ranks."""
    rules, found = load_rules(row["protocol"]), row["metrics"].get(name, {})
    spread = seed_spread(row, name) if found else None
    cell = _mean(row["metrics"], name)
    digits = METRICS[name].digits
    cell += "" if spread is None else f" ± {spread:.{digits}f}"
    if found and (ends := trusted_interval(row, name)):
        cell += f" [{ends[0]:.{digits}f}, {ends[1]:.{digits}f}]"
    if rules.is_ranked and name == rules.rank_by:
        return [cell, f"{found['macro_mean']:.{digits}f}"]
    return [cell]


def _mean(metrics: Mapping[str, Any], name: str) -> str:
    """Mean; empty where a row does not have the metric."""
    return f"{metrics[name]['mean']:.{METRICS[name].digits}f}" if name in metrics else ""


def _details(row: Entry) -> str:
    """One list item: commands, version, checksum, notes and warnings."""
    method = row["method"]
    commands = [code(one) for one in (method["command"], row["command"]) if one]
    commit = row["commit"] or ""
    shown = f", commit {code(commit[:12] + _dirty(commit))}" if commit else ""
    reason = unranked_because(row) or ""
    unsure = unsure_because(row)
    facts = [
        f"**{plain(method['name'])}**: {', then '.join(commands)}",
        f"xden1k {plain(row['xden_version'])}{shown}",
        f"submission {code(row['submission_sha256'][:12])}",
        *([f"team {plain(row['team']['name'])}"] if "team" in row else []),
        *([f"not ranked: {plain(reason)}"] if reason not in ("", TRIVIAL) else []),
        *([plain(unsure)] if unsure else []),
        *([f"erratum: {plain(row['erratum']['text'])}"] if "erratum" in row else []),
        *map(plain, row.get("remarks", ())),
        *_seed_notes(row),
        *([f"seconds on {plain(method['hardware'])}"] if method.get("hardware") else []),
        *(plain(text) for text in (method["notes"], *row["warnings"]) if text),
        *(link(method[key]) for key in ("paper", "code") if method[key]),
    ]
    return "- " + "; ".join(facts)


def _elsewhere(guest: Entry) -> str:
    """One list item of a row that stands in its own table too."""
    name, track = plain(guest["method"]["name"]), guest["track"]
    return f"- **{name}**: entered for the track `{track}`, shown to read the others by"


def _seed_notes(row: Entry) -> list[str]:
    """Which seeds a row is the mean of, which its costs are of, or that it should be of more."""
    rules, seeds = load_rules(row["protocol"]), row.get("seeds", ())
    notes = [
        f"seed {one['method']['seed']}: {one['metrics'][rules.rank_by]['mean']:.3f}, "
        f"submission {code(one['submission_sha256'][:12])}"
        for one in seeds
    ]
    return [*notes, *filter(None, [silent_on_cost(row), few_seeds(row)])]


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
