"""``xden-bench manip verify``: a row of simulated picks, made again."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xden1k.commands import json_option, print_json
from xden1k.errors import DataError
from xden_bench.commands.entries import SHOWN
from xden_bench.commands.manip import run
from xden_bench.commands.methods import run_again
from xden_bench.commands.picking import controls_asked, numbers_asked, submissions_asked
from xden_bench.commands.shared import (
    FILE,
    FOLDER,
    echo_lines,
    open_reference,
    parse_command,
    progress_bar,
    root_option,
)

if TYPE_CHECKING:
    from xden_bench.manip.choosing import Chooser
    from xden_bench.manip.rows import Row
    from xden_bench.manip.scenes import Scenes

__all__ = ["verify"]

NOT_VERIFIABLE = ("command", "xden_version", "commit")
"""Of the place and time of a run: a row that is made again says them after the first."""


@click.command(epilog="Example: xden-bench manip verify rows/true.json scenes")
@click.argument("row", type=FILE)
@click.argument("scenes", type=FOLDER)
@click.option("--submission", type=FILE, help="The row's.  [default: made anew by its command]")
@root_option
@click.option(
    "--workers", type=click.IntRange(min=1), default=1, show_default=True, help="Processes."
)
@json_option
def verify(
    row: Path,
    scenes: Path,
    submission: Path | None,
    root: Path | str | None,
    workers: int,
    as_json: bool,
) -> None:
    """Run the command that ROW prints again on SCENES, and compare the bytes.

    A method's row needs its dataset, and its submission, or the method runs again. Exit code 1 if
    anything differs.
    """
    from xden_bench.entries.verification import deviations
    from xden_bench.manip.rows import read_rows
    from xden_bench.manip.scenes import open_scenes

    (stated,), opened = read_rows([row]), open_scenes(scenes)
    opened.refuse_others(stated.facts)
    with tempfile.TemporaryDirectory() as scratch:
        chooser = _chooser(stated, opened, submission, root, Path(scratch))
        made = _made_again(stated, opened, chooser, Path(scratch) / "rows", workers)
        same = made.read_bytes() == row.read_bytes()
        found = deviations(*(json.loads(path.read_text("utf-8")) for path in (row, made)))
    if as_json:
        print_json({"simulated": True, "same": same, "deviations": [asdict(one) for one in found]})
    else:
        said = "the same bytes" if same else f"other bytes, {len(found)} values differ"
        click.echo(f"{row}: {said}; not verifiable: {', '.join(NOT_VERIFIABLE)}")
        echo_lines(None, found[:SHOWN])
    if not same:
        raise SystemExit(1)


def _chooser(
    row: Row, scenes: Scenes, submission: Path | None, root: Path | str | None, scratch: Path
) -> Chooser:
    """Who made a row; a submission that is made anew stands for the row's own."""
    items = {item.object_id: item for item in scenes.items()}
    if not row.is_submission:
        (control,) = controls_asked(items, scenes, (row.name,), no_controls=False)
        return control
    remade = submission is None
    path = submission or scratch / "remade.npz"
    if remade:
        folder = open_reference(root, scenes.facts["dataset"]["split"]).folder
        run_again(row.facts["submission_command"], folder, path)
    (chooser,) = submissions_asked([path], items, scenes, root)
    stated = row.facts["submission_sha256"]
    if not remade and chooser.submission_sha256 != stated:
        raise DataError(f"{path} is not the row's submission: its sha256 is another")
    return replace(chooser, submission_sha256=stated)


def _made_again(row: Row, scenes: Scenes, chooser: Chooser, out: Path, workers: int) -> Path:
    """Write a row anew, by what its command asks of all rows."""
    from xden_bench.manip.running import Tries, Variant, run_rows

    asked: Mapping[str, Any] = parse_command(row.facts["command"], run, group=["manip"])
    try:
        numbers = numbers_asked(asked["vary"])
    except click.UsageError as err:
        raise DataError(f"{row.facts['command']!r}: {err.format_message()}") from err
    variant = Variant(numbers, asked["friction_scale"], asked["homogeneous"])
    facts = {name: row.facts[name] for name in NOT_VERIFIABLE}
    tries = Tries(scenes, (chooser,), variant)
    (path,) = run_rows(tries, out, facts, workers, progress_bar)
    return path
