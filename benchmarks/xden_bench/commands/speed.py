"""The command that measures how long scoring takes."""

from __future__ import annotations

import tempfile
from pathlib import Path

import click

from xden1k.commands import json_option, open_root, print_json
from xden_bench.commands.shared import FILE, root_option, split_option

__all__ = ["speed"]


@click.command(epilog="Example: xden-bench speed preds.npz")
@click.argument("submission", type=FILE, required=False)
@root_option
@split_option
@click.option(
    "--repeats",
    type=click.IntRange(min=1),
    default=5,
    show_default=True,
    help="Runs of each kind; the median holds.",
)
@json_option
def speed(
    submission: Path | None, root: Path | str | None, split: str, repeats: int, as_json: bool
) -> None:
    """Measure scoring against reading the same arrays, in one run.

    Without a SUBMISSION, water is scored.
    """
    from dataclasses import asdict

    from xden_bench.methods.baseline import find_predictor, run_predictor
    from xden_bench.scoring.protocol import load_protocol
    from xden_bench.speed import measure_speed

    folder = open_root(root)
    with tempfile.TemporaryDirectory() as scratch:
        if submission is None:
            submission = Path(scratch) / "water.npz"
            run_predictor(find_predictor("water"), folder, split, submission)
        measured = measure_speed(submission, folder.path, split, load_protocol(), repeats)
    if as_json:
        print_json({**asdict(measured), "ratio": measured.ratio})
    else:
        click.echo(
            f"{measured.objects} objects: reading {measured.read_seconds:.3f} s, checking and "
            f"scoring (reading included) {measured.score_seconds:.3f} s, ratio {measured.ratio:.2f}"
        )
