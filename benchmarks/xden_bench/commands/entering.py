"""What commands on submissions print, and what they do with an entry."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xden_bench.commands.shared import RESULTS, echo_lines, interval_text

if TYPE_CHECKING:
    from xden1k.folder import DatasetFolder
    from xden_bench.scoring.bootstrap import Estimate
    from xden_bench.scoring.comparison import Comparison
    from xden_bench.scoring.reference import Reference
    from xden_bench.scoring.score import Score

__all__ = [
    "comparison_values",
    "echo_comparison",
    "echo_groups",
    "echo_score",
    "entered",
    "refuse_disturbed",
    "refuse_the_sample",
    "standing_of",
]


def refuse_disturbed(folder: DatasetFolder) -> None:
    """Keep what is scored on disturbed radiographs out of all results.

    Raises
    ------
    DataError
        If the folder is a copy with disturbed radiographs.
    """
    from xden1k.errors import DataError

    if folder.manifest.disturbed:
        raise DataError(
            f"{folder.root}: a copy in which radiographs {folder.manifest.disturbed.radiographs}: "
            "no entry can be made on it, only scored"
        )


def refuse_the_sample(reference: Reference) -> None:
    """Keep scores of the packaged sample out of the results: they have a table of their own.

    Raises
    ------
    DataError
        If the reference is the sample.
    """
    from xden1k.access.hub import SAMPLE
    from xden1k.errors import DataError

    if reference.folder.root == SAMPLE:
        raise DataError(
            f"{len(reference.ids)} objects of the packaged sample are no entry of the leaderboard: "
            "give --root ROOT, a folder that `xden-bench dataset XDen-P2000 --out ROOT` makes, or "
            "--out FOLDER for results of your own"
        )


def entered(path: Path, out: Path | None) -> str:
    """Say where an entry went and what comes next."""
    if out is None and not (RESULTS / "README.md").is_file():
        return (
            f"entered: {path.absolute()}\n"
            "This is no checkout of the repository: to enter the leaderboard, add this file, the "
            f".parquet beside it and what archive holds to {RESULTS} of one, in a pull request."
        )
    more = "" if out is None else f" --results {shlex.quote(str(out))}"
    return f"entered: {path}\n`xden-bench leaderboard{more}` makes the table."


def standing_of(entry: Mapping[str, Any], path: Path) -> str:
    """Say which rank an entry has among those beside it."""
    from xden1k.errors import DataError
    from xden_bench.entries.leaderboard import tables
    from xden_bench.entries.merging import holds
    from xden_bench.entries.ranking import ranks
    from xden_bench.entries.reading import keep_best_of_teams, read_entry
    from xden_bench.entries.result import entry_path, entry_paths
    from xden_bench.entries.standing import standing

    try:
        entries = [read_entry(one) for one in entry_paths(path.parent)]
        keep_best_of_teams(entries)
        own = entry_path(entry)
        rows, row = next((rows, row) for rows in tables(entries) for row in rows if holds(row, own))
        found = ranks(rows)
        return standing(row, found[rows.index(row)], found)
    except DataError as err:
        return f"no rank: {err}"


def echo_score(scored: Score) -> None:
    """Print the metrics of a submission."""
    from tabulate import tabulate

    from xden_bench.entries.ranking import no_interval_because
    from xden_bench.scoring.metrics import METRICS

    meta, unsure = scored.meta, no_interval_because(scored.meta.inputs)
    click.echo(
        f"{meta.method}: track {meta.track}, target {meta.target}, {len(scored.objects)} objects "
        f"({' and '.join(scored.sources)}), protocol {scored.protocol.name}"
    )
    rows = [
        (METRICS[name].heading, f"{one.mean:.4f}", *_beside(one, is_trusted=unsure is None))
        for name, one in scored.metrics.items()
    ]
    headings = ["metric", "mean", "by category", "95 % interval"][: len(rows[0])]
    click.echo(tabulate(rows, headings, disable_numparse=True))
    if unsure and scored.protocol.is_ranked:
        click.echo(unsure)
    echo_lines(None, scored.warnings)


def _beside(one: Estimate, *, is_trusted: bool) -> tuple[str, ...]:
    """Return what is printed beside a mean; nothing by a protocol before v2."""
    if one.macro_mean is None:
        return ()
    return f"{one.macro_mean:.4f}", interval_text(one, ".4f") if is_trusted else "-"


def echo_groups(title: str, groups: Mapping[str, tuple[int, Mapping[str, Estimate]]]) -> None:
    """Print the metrics by group."""
    from tabulate import tabulate

    from xden_bench.scoring.metrics import METRICS

    names = [name for name in METRICS if any(name in found for _, found in groups.values())]
    rows = [
        (group, count, *(f"{found[name].mean:.4f}" if name in found else "-" for name in names))
        for group, (count, found) in groups.items()
    ]
    headings = [title, "objects", *(METRICS[name].heading for name in names)]
    click.echo("\n" + tabulate(rows, headings, disable_numparse=True))


def comparison_values(one: Comparison) -> dict[str, Any]:
    """Return a comparison, of JSON's types."""
    return {**asdict(one), "difference": one.difference.to_json()}


def echo_comparison(a: str, b: str, found: Mapping[str, Comparison]) -> None:
    """Print how far apart two methods are, and where."""
    from tabulate import tabulate

    from xden_bench.scoring.metrics import METRICS

    rows = [
        (
            METRICS[name].heading,
            f"{one.difference.mean:+.4f}",
            interval_text(one.difference, "+.4f"),
            f"{one.p_equal:.3g}",
            f"{one.a_better} : {one.b_better}",
        )
        for name, one in found.items()
    ]
    headings = ["metric", "a - b", "95 % interval", "p (sign test)", "objects a : b"]
    click.echo(f"a: {a}\nb: {b}\n" + tabulate(rows, headings, disable_numparse=True))
    for name, one in found.items():
        if not one.largest:
            continue
        pairs = (f"{pair.object_id} {pair.a:.4g} / {pair.b:.4g}" for pair in one.largest)
        click.echo(f"largest differences in {name}, a / b: {', '.join(pairs)}")
