"""The section of LEADERBOARD.md on simulated picks, made from the rows that are entered."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from tabulate import tabulate

from xden1k.errors import DataError
from xden_bench.entries.markdown import code, plain
from xden_bench.manip.item import STRATA, Stratum
from xden_bench.manip.protocol import ObjectRules, load_manip_protocol
from xden_bench.manip.rows import Row, read_rows
from xden_bench.manip.table import AGAINST, Against, Line, is_step, lines
from xden_bench.scoring.bootstrap import Estimate

__all__ = ["PICKS", "entered_rows", "picks_sections"]

PICKS: Final = "picks"
"""Folder of entered rows, beside that of the results: a folder a table."""
COMMIT: Final = "[0-9a-f]{40}"
HEADINGS: Final = (
    *("row", "held ↑", "vs `uniform`", "p", "regret ↓", "p", "axial error, cm", "ladder"),
    *("wrist, N·m", "turn, °", "width, cm", "height, cm", "looks at"),
)


def entered_rows(folder: Path) -> tuple[Row, ...]:
    """Read the rows of one table as they were entered.

    Raises
    ------
    DataError
        If a row departs from the protocol, or the code that made it is in no commit.
    """
    paths = sorted(folder.glob("*.json"))
    rows = read_rows(paths)
    for path, row in zip(paths, rows, strict=True):
        if row.facts["varied"] or row.facts["homogeneous"]:
            raise DataError(f"{path}: departs from the protocol, so it cannot be entered")
        if not re.fullmatch(COMMIT, str(row.facts["commit"])):
            raise DataError(
                f"{path}: expected a row by the code of a commit, got {row.facts['commit']!r}: "
                "commit what was changed and run again"
            )
    return rows


def picks_sections(results: Path) -> tuple[str, ...]:
    """Sections of all tables that are entered beside the results; none where there are none."""
    folders = sorted({path.parent for path in results.with_name(PICKS).rglob("*.json")})
    return tuple(_section(entered_rows(folder)) for folder in folders)


def _section(rows: Sequence[Row]) -> str:
    rules = load_manip_protocol()
    found = lines(rows, rules.statistics)
    return "\n\n".join(
        [
            _title(rows[0].facts),
            *(_table(stratum, rows, found, rules.objects) for stratum in STRATA),
            "How the rows were made:",
            "\n".join([*_runs(rows), *(_details(row) for row in rows if row.is_submission)]),
        ]
    )


def _title(facts: Mapping[str, Any]) -> str:
    data = facts["dataset"]
    return (
        f"## Simulated picks, split {code(data['split'])}, tier {facts['tier']}\n\n"
        "**Simulated** in MuJoCo with phantoms; no robot was used. Of many grasps the one nearest "
        "to a row's centre of mass is taken: [how](docs/manual/manipulation.md). Dataset "
        f"{plain(data['revision'])} (manifest {code(data['manifest_sha256'][:12])}), protocol "
        f"{facts['protocol']}, MuJoCo {facts['mujoco']}, scenes "
        f"{code(facts['scenes_sha256'][:12])} by {code(_prepared(facts))}. Rows are ordered by "
        "success and have no ranks; controls are in italics. Brackets are bootstrap intervals over "
        "objects, p is of the sign test over them, *regret* is the success lost against `true`, "
        "*ladder* the success of the true centre shifted by as much along the longest axis."
    )


def _prepared(facts: Mapping[str, Any]) -> str:
    split = facts["dataset"]["split"]
    return f"xden-bench manip prepare ROOT --out SCENES --tier {facts['tier']} --split {split}"


def _table(stratum: Stratum, rows: Sequence[Row], found: Sequence[Line], rules: ObjectRules) -> str:
    objects, draws = rows[0].held(stratum).shape
    where = {
        "off": f"over {rules.off_cm:g} cm from the centroid",
        "balanced": f"under {rules.balanced_cm:g} cm from the centroid",
    }
    by_name = {row.name: row for row in rows}
    shown = [one for one in found if one.stratum == stratum and not _is_shifted(one.name)]
    shown.sort(key=lambda one: (-one.success, one.name))
    table = [_cells(one, by_name[one.name]) for one in shown]
    title = (
        f"### Stratum *{stratum}*: centre of mass {where[stratum]}\n\n"
        f"{objects} objects, {draws} trials of each."
    )
    return f"{title}\n\n{tabulate(table, HEADINGS, tablefmt='pipe', disable_numparse=True)}"


def _is_shifted(name: str) -> bool:
    return is_step(name) and name not in AGAINST


def _cells(line: Line, row: Row) -> list[str]:
    figures = line.figures
    return [
        plain(row.name) if row.is_submission else f"*{row.name}*",
        _percent(line.over_objects),
        *_compared(line.against["uniform"], 1),
        *_compared(line.against["true"], -1),
        "-" if line.axial_error_cm is None else f"{line.axial_error_cm:.2f}",
        "-" if line.expected is None else f"{line.expected:.1%}",
        f"{figures['wrist_moment_nm']:.3f}",
        f"{figures['turn_deg']:.1f}",
        f"{figures['width_cm']:.1f}",
        f"{figures['height_cm']:.1f}",
        plain(", ".join(row.facts["inputs"])) or "-",
    ]


def _percent(one: Estimate) -> str:
    if one.interval is None:
        return f"{one.mean:.1%}"
    low, high = one.interval
    return f"{one.mean:.1%} [{100 * low:.1f}, {100 * high:.1f}]"


def _compared(against: Against, sign: int) -> tuple[str, str]:
    difference = 100 * sign * against.difference.mean + 0.0  # no minus before zero
    return f"{difference:+.1f}", f"{against.objects.p_equal:.2g}"


def _runs(rows: Sequence[Row]) -> Iterator[str]:
    """One list item for each command, with the rows that it made."""
    made: dict[tuple[str, str, str], list[str]] = {}
    for row in rows:
        run = tuple(str(row.facts[name]) for name in ("command", "xden_version", "commit"))
        made.setdefault((run[0], run[1], run[2]), []).append(row.name)
    for (command, version, commit), names in made.items():
        by = f"xden1k {plain(version)}, commit {code(commit[:12])}"
        yield f"- {code(command)}, {by}: {plain(', '.join(names))}"


def _details(row: Row) -> str:
    """One list item for a method: what made its file, and what is missing in it."""
    facts, empty = row.facts, len(row.facts["without_mass"])
    told = [
        *([code(facts["submission_command"])] if facts["submission_command"] else []),
        f"submission {code(facts['submission_sha256'][:12])}",
        *([f"{empty} objects without mass, so at their centroid"] if empty else []),
    ]
    return f"- **{plain(row.name)}**: {'; '.join(told)}"
