"""LEADERBOARD.md, made from the results: the part between two markers is never written by hand."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from tabulate import tabulate

from xden1k.errors import DataError
from xden1k.modality import TRACKS
from xden_bench.metrics import METRICS
from xden_bench.protocol import is_trivial, load_protocol
from xden_bench.rebuilt import Rebuilt
from xden_bench.result import write_text

__all__ = ["check_leaderboard", "ranks", "render", "unranked_because", "write_leaderboard"]

Entry = Mapping[str, Any]

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
- Methods are ranked by density MAE. Rows whose intervals overlap are not told apart: the rank
  counts the rows that are better beyond both intervals.
- *Rows in italics* are trivial and never ranked: nothing (`zero`), 1 g/cm³ everywhere (`water`),
  and the median density of the training objects, of all or by category. A method has to beat them.
  Another row without a rank says why in its footnote.
- Tables of different tracks, datasets or sources (`scan`: the scanner's objects, `phantom`:
  simulated ones) are never compared.

{BEGIN}
{END}
"""

PRINTED: Final = ("density_mae_g_cm3", "com_l1_cm", "mass_mape", "mass_alde", "mass_mnre")
"""Metrics of the tables; the others are in the results."""

TRIVIAL: Final = "trivial"

PAPER_ROWS: Final = (
    ("NeRF2Physics", "1.157", "0.523", "1.174"),
    ("GaussianProperty", "1.295", "0.632", "1.247"),
    ("Pixie", "1.228", "0.547", "0.713"),
)
"""Density MAE, CoM, mass MAPE as the XDen-1K paper prints them (arXiv 2512.10668)."""

TRACK_TITLES: Final = {
    "geometry": "outer surface alone",
    "rgb": "colour pictures",
    "rgb_parts": "colour pictures and part ids",
    "xray": "X-rays",
}


def render(entries: Iterable[Entry]) -> str:
    """Text between the markers.

    One table for each protocol, dataset, split, source, target and track; nothing is ranked
    across. The order of the entries does not matter.

    Parameters
    ----------
    entries
        From :func:`xden_bench.result.read_entries`.
    """
    tables: dict[tuple[Any, ...], list[Entry]] = {}
    for entry in entries:
        tables.setdefault(_table_key(entry), []).append(entry)
    sections = [_section(tables[key]) for key in sorted(tables)]
    if not sections:
        sections = ["No entries yet."]
    return "\n\n".join([*sections, _paper_section()])


def ranks(rows: Sequence[Entry]) -> list[int | None]:
    """Rank of each row: one more than the number of rows that are better beyond both intervals.

    Rows whose intervals overlap are not told apart. Rows that :func:`unranked_because` gives a
    reason for have no rank and push nobody down.

    Parameters
    ----------
    rows
        Of one table.
    """
    rules = load_protocol(rows[0]["protocol"])
    name = rules.rank_by
    sign = -1 if METRICS[name].higher_is_better else 1

    def interval(row: Entry) -> tuple[float, float]:
        low, high = sorted(sign * end for end in row["metrics"][name]["ci95"])
        return low, high

    ranked = [row for row in rows if unranked_because(row) is None]
    highs = [interval(row)[1] for row in ranked]
    return [
        1 + sum(high < interval(row)[0] for high in highs) if row in ranked else None
        for row in rows
    ]


def unranked_because(row: Entry) -> str | None:
    """Why a row is printed without a rank, or None if it has one.

    All an entry says of itself can only take its rank away here, so that nothing is gained by
    saying it falsely. :func:`xden_bench.baseline.check_trivial` keeps the names of the trivial
    methods for those.
    """
    if is_trivial(row["method"]["name"], load_protocol(row["protocol"])):
        return TRIVIAL
    if any(warning.startswith("W504") for warning in row["warnings"]):
        return "its values are those of the reference"
    if row["method"]["name"] == Rebuilt.name and "scan" in row["dataset"]["source"].split("+"):
        return "circular: on scans the truth is the builder's own reconstruction"
    return None


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
    if text.count(BEGIN) != 1 or text.count(END) != 1 or text.index(BEGIN) > text.index(END):
        raise DataError(f"{path}: the lines {BEGIN!r} and {END!r} must each be there once")
    before, rest = text.split(BEGIN)
    return f"{before}{BEGIN}\n\n{section}\n\n{END}{rest.split(END)[1]}"


def _table_key(entry: Entry) -> tuple[Any, ...]:
    data = entry["dataset"]
    return (
        entry["protocol"],
        data["revision"],
        data["manifest_sha256"],
        data["split"],
        data["source"],
        entry["target"],
        TRACKS.index(entry["track"]),
    )


def _section(rows: Sequence[Entry]) -> str:
    """One table with its title and notes."""
    rules = load_protocol(rows[0]["protocol"])
    name = rules.rank_by
    rows = sorted(
        rows,
        key=lambda row: (
            row["metrics"][name]["mean"] * (-1 if METRICS[name].higher_is_better else 1),
            row["method"]["name"],
            row["submission_sha256"],
        ),
    )
    headings = ["rank", "method", *(METRICS[one].heading for one in PRINTED), "looks at"]
    headings += ["trained on", "external data", "status", "date"]
    table = [_row(row, rank) for row, rank in zip(rows, ranks(rows), strict=True)]
    return "\n\n".join(
        [
            _title(rows[0]),
            tabulate(table, headings, tablefmt="pipe", disable_numparse=True),
            "How each row was made, and its footnotes:",
            "\n".join(_details(row) for row in rows),
        ]
    )


def _title(row: Entry) -> str:
    data = row["dataset"]
    return (
        f"## Track `{row['track']}`: {TRACK_TITLES[row['track']]}\n\n"
        f"Source of the objects: **{_plain(data['source'])}**. Target `{row['target']}`, "
        f"split `{_code(data['split'])}`, {row['n_objects']} objects, dataset "
        f"{_plain(data['revision'])} (manifest `{_code(data['manifest_sha256'][:12])}`), "
        f"protocol {_plain(row['protocol'])}. Means over objects with 95 % bootstrap intervals."
    )


def _row(row: Entry, rank: int | None) -> list[str]:
    method = row["method"]
    name = _plain(method["name"])
    return [
        "" if rank is None else str(rank),
        f"*{name}*" if unranked_because(row) == TRIVIAL else name,
        *(_figure(row["metrics"][one]) for one in PRINTED),
        _plain(", ".join(method["inputs"])) or "nothing",
        _plain(", ".join(method["training_data"])) or "nothing",
        "yes" if method["external_data"] else "no",
        _plain(row["status"]),
        _plain(row["date"]),
    ]


def _figure(metric: Mapping[str, Any]) -> str:
    low, high = metric["ci95"]
    return f"{metric['mean']:.3f} [{low:.3f}, {high:.3f}]"


def _details(row: Entry) -> str:
    """One list item: commands, version, checksum, notes and warnings."""
    method = row["method"]
    commands = [f"`{_code(one)}`" for one in (method["command"], row["command"]) if one]
    commit = (
        f", commit `{_code(row['commit'][:12])}{_dirty(row['commit'])}`" if row["commit"] else ""
    )
    reason = unranked_because(row)
    facts = [
        f"**{_plain(method['name'])}**: {', then '.join(commands)}",
        f"xden1k {_plain(row['xden_version'])}{commit}",
        f"submission `{_code(row['submission_sha256'][:12])}`",
        *([f"not ranked: {reason}"] if reason not in (None, TRIVIAL) else []),
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
    """Text that Markdown shows as it is, whatever a stranger put into it."""
    return re.sub(r"([\\`*_\[\]<>|~&$])", r"\\\1", text)


def _code(text: str) -> str:
    """Text that can stand between backticks in a table."""
    return text.replace("`", "'").replace("|", "\\|")


def _link(text: str) -> str:
    """Turn a plain web address into a link, anything else into text."""
    return f"<{text}>" if re.fullmatch(r"https?://[\w./:~%?=&#+-]+", text) else _plain(text)
