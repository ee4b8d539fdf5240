"""``xden-build evaluate``: phantoms, truth against reconstruction."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import click

from xden1k.commands import DONE_IN_PART, json_option, print_json
from xden_builder.commands.shared import progress_bar, workers_option

if TYPE_CHECKING:
    from xden_builder.evaluate.run import Evaluation

__all__ = ["evaluate"]

SEED = 4711
"""Of objects that nothing was developed on."""


@click.command(epilog="Example: xden-build evaluate --count 20 --ablated 5 -o evaluation.md")
@click.argument(
    "captures", type=click.Path(path_type=Path, file_okay=False, exists=True), required=False
)
@click.option("--count", type=click.IntRange(min=1), default=200, show_default=True)
@click.option("--seed", type=click.IntRange(min=0), default=SEED, show_default=True)
@click.option("--size", type=click.IntRange(min=64), default=512, show_default=True)
@click.option(
    "--ablated",
    type=click.IntRange(min=0),
    default=60,
    show_default=True,
    help="Objects to try the fit on without each of its parts.",
)
@workers_option
@click.option(
    "-o",
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write the tables into this file too.",
)
@json_option
def evaluate(
    captures: Path | None,
    count: int,
    seed: int,
    size: int,
    ablated: int,
    workers: int,
    out: Path | None,
    as_json: bool,
) -> None:
    """Rebuild objects whose density is known, and compare.

    CAPTURES is a folder of simulated captures of a tube, evaluated whole; without it, objects are
    simulated by --count, --seed and --size, with every effect of the scanner, pores, and labels
    that err. Exits with 3 if some object could not be evaluated.
    """
    if out and not out.parent.is_dir():
        raise click.UsageError(f"--out: there is no folder {out.parent}")
    with TemporaryDirectory(prefix="xden-evaluate-") as scratch:
        folder = captures or _simulated(Path(scratch) / "captures", count, seed, size, workers)
        report = _evaluated(folder, ablated, workers)
    from xden_builder.evaluate.table import markdown

    tables = markdown(report)
    if as_json:
        print_json(report.to_dict())
    else:
        click.echo(tables)
    if out:
        out.write_text(tables, encoding="utf-8")
    for object_id, why in report.failures:
        click.echo(f"failed: {object_id}: {why}", err=True)
    if report.failures:
        raise SystemExit(DONE_IN_PART)


def _simulated(out: Path, count: int, seed: int, size: int, workers: int) -> Path:
    from xden_builder.phantoms import write_captures
    from xden_builder.phantoms.realism import LIFELIKE
    from xden_builder.phantoms.scanner import Scanner

    with progress_bar(count) as bar:
        write_captures(
            out,
            count,
            seed,
            size=size,
            scanner=Scanner.realistic(),
            realism=LIFELIKE,
            workers=workers,
            progress=lambda _: bar.update(),
        )
    return out


def _evaluated(captures: Path, ablated: int, workers: int) -> Evaluation:
    from xden_builder.capture import CaptureFolder
    from xden_builder.evaluate.run import evaluate

    count = len(CaptureFolder(captures).object_ids)
    with progress_bar(count) as bar:
        return evaluate(captures, ablated=ablated, workers=workers, on_done=lambda _: bar.update())
