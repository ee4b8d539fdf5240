"""Commands on the results: leaderboard."""

from __future__ import annotations

from pathlib import Path

import click

from xden1k.commands import json_option, print_json
from xden_bench.commands.shared import FILE, FOLDER, RESULTS

__all__ = ["leaderboard"]


@click.command(epilog="Example: xden-bench leaderboard --check")
@click.option("--check", is_flag=True, help="Only fail if the file does not match the results.")
@click.option("--results", type=FOLDER, default=RESULTS, show_default=True, help="The entries.")
@click.option(
    "--out", type=FILE, default="LEADERBOARD.md", show_default=True, help="The file to rewrite."
)
@json_option
def leaderboard(check: bool, results: Path, out: Path, as_json: bool) -> None:
    """Rewrite LEADERBOARD.md from the results."""
    from xden_bench.leaderboard import check_leaderboard, render, write_leaderboard
    from xden_bench.result import read_entries

    entries = read_entries(results)
    (check_leaderboard if check else write_leaderboard)(entries, out)
    if as_json:
        print_json({"file": str(out), "entries": list(entries)})
    elif not check:
        click.echo(render(entries))
    if not as_json:
        click.echo(f"{out}: {len(entries)} entries{', up to date' if check else ''}")
