"""The command that makes the leaderboard."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from xden1k.commands import json_option, print_json
from xden_bench.commands.shared import FILE, FOLDER, RESULTS

__all__ = ["leaderboard"]


@click.command(epilog="Example: xden-bench leaderboard --check")
@click.option("--check", is_flag=True, help="Only fail if the file does not match the results.")
@click.option(
    "--by", type=click.Choice(["category", "size"]), help="Print tables by group; write nothing."
)
@click.option("--metric", help="Of the tables by group. [default: the one that ranks]")
@click.option(
    "--eval-results",
    "hub_folder",
    type=FOLDER,
    help="Write the Hub's .eval_results/*.yaml of the ranked rows here, and nothing else.",
)
@click.option("--repo-id", metavar="ID", help="Of the dataset on the Hub, for --eval-results.")
@click.option("--results", type=FOLDER, default=RESULTS, show_default=True, help="The entries.")
@click.option(
    "--out", type=FILE, default="LEADERBOARD.md", show_default=True, help="The file to rewrite."
)
@json_option
def leaderboard(
    check: bool,
    by: str | None,
    metric: str | None,
    hub_folder: Path | None,
    repo_id: str | None,
    results: Path,
    out: Path,
    as_json: bool,
) -> None:
    """Rewrite LEADERBOARD.md from the results, or print other tables of them.

    Rows of `xden-bench manip run` in the folder picks beside the results have their own section.
    A file that is no sound entry is left out and named; with --check it is an error.
    """
    from xden_bench.entries.leaderboard import check_leaderboard, render, write_leaderboard
    from xden_bench.entries.reading import read_entries, read_sound_entries
    from xden_bench.manip.section import picks_sections

    if check + (by is not None) + (hub_folder is not None) > 1:
        raise click.UsageError("Of --check, --by and --eval-results give one.")
    if metric and not by:
        raise click.UsageError("The option --metric goes with --by.")
    entries, problems = (read_entries(results), ()) if check else read_sound_entries(results)
    for problem in problems:
        click.echo(f"left out: {problem}", err=True)
    if by:
        _print_groups(entries, by, metric, as_json)
    elif hub_folder:
        _write_for_hub(entries, hub_folder, repo_id, as_json)
    else:
        sections = picks_sections(results)
        (check_leaderboard if check else write_leaderboard)(entries, out, sections)
        if as_json:
            print_json({"file": str(out), "entries": [_without_objects(one) for one in entries]})
            return
        if not check:
            click.echo(render(entries, sections))
        click.echo(f"{out}: {len(entries)} entries{', up to date' if check else ''}")


def _print_groups(
    entries: Sequence[Mapping[str, Any]], by: str, metric: str | None, as_json: bool
) -> None:
    from xden_bench.entries.leaderboard import group_tables

    if as_json:
        kept = ("method", "protocol", "track", "target", "dataset", f"by_{by}")
        print_json([{key: one[key] for key in kept} for one in entries])
    else:
        click.echo(group_tables(entries, by, metric))


def _write_for_hub(
    entries: Sequence[Mapping[str, Any]], folder: Path, repo_id: str | None, as_json: bool
) -> None:
    from xden1k.access.hub import REPO_ID
    from xden_bench.entries.eval_results import left_out_because, write_eval_results

    left_out = {
        one["method"]["name"]: reason for one in entries if (reason := left_out_because(one))
    }
    kept = [one for one in entries if left_out_because(one) is None]
    written = [str(path) for path in write_eval_results(kept, folder, repo_id or REPO_ID)]
    if as_json:
        print_json({"files": written, "left_out": left_out})
    else:
        for line in [*written, *(f"left out: {name}: {why}" for name, why in left_out.items())]:
            click.echo(line)


def _without_objects(entry: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in entry.items() if key != "object_scores"}
