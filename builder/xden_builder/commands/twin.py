"""``xden-build twin``: a simulated release in the published layout."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from xden1k.commands import json_option, print_json
from xden_builder.commands.shared import FOLDER, progress_bar, workers_option

__all__ = ["twin"]


@click.command(epilog="Example: xden-build twin release --count 6 --seed 1 --variant tiny")
@click.argument("out", type=FOLDER)
@click.option("--count", type=click.IntRange(min=1), required=True, help="Objects to make.")
@click.option("--seed", type=click.IntRange(min=0), required=True, help="Which objects.")
@click.option(
    "--variant",
    type=click.Choice(["A", "B", "tiny"]),
    required=True,
    help="A: soft edges, one scale, named parts; B: hard, stretched, mirrored; tiny: A, but small.",
)
@workers_option
@json_option
def twin(out: Path, count: int, seed: int, variant: Any, workers: int, as_json: bool) -> None:
    """Write simulated objects in the layout of the authors' release, to try `xden import` on.

    The truth goes beside the folder, to OUT.truth.json.
    """
    from xden_builder.published.twin import truth_path, write_twin

    with progress_bar(count) as bar:
        write_twin(out, count, seed, variant, workers=workers, progress=lambda _: bar.update())
    values = {"out": str(out), "truth": str(truth_path(out)), "count": count, "seed": seed}
    if as_json:
        print_json(values | {"variant": variant})
    else:
        click.echo(f"{out}: twin {variant} of {count} objects, seed {seed}; {truth_path(out)}")
