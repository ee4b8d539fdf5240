"""``xden-bench disturb``: a copy of a dataset folder with disturbed radiographs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xden1k.commands import LOCAL_ROOT, json_option, print_json
from xden_bench.commands.shared import FOLDER, progress_bar

if TYPE_CHECKING:
    from xden1k.folder import DatasetFolder
    from xden_bench.datasets.disturbances import Disturbance

__all__ = ["disturb"]


@click.command(epilog="Example: xden-bench disturb data --out shifted --split test --shift-px 3")
@click.argument("root", type=LOCAL_ROOT)
@click.option("--out", type=FOLDER, required=True, help="Dataset folder to make.")
@click.option("--split", help="Copy this one alone.  [default: all]")
@click.option("--swap", is_flag=True, help="Give each object another's radiographs of its split.")
@click.option("--mean", is_flag=True, help="Make each object's shadow its mean transmission.")
@click.option("--shift-px", metavar="N", type=click.IntRange(min=0), help="Shift by N pixels.")
@click.option(
    "--scale",
    metavar="FACTOR",
    type=click.FloatRange(0.5, 2),
    help="Enlarge about the image's centre; 1.05 is 5 %.",
)
@click.option(
    "--noise",
    metavar="FACTOR",
    type=click.FloatRange(min=1),
    help="Add noise, to FACTOR times what is beside the object.",
)
@click.option(
    "--mesh-error",
    metavar="DEG CM",
    type=(click.FloatRange(min=0), click.FloatRange(min=0)),
    help="Tell radiographs as if meshes were turned and moved.",
)
@click.option("--seed", default=0, show_default=True, help="Of what is drawn.")
@json_option
def disturb(
    root: Path, out: Path, split: str | None, seed: int, as_json: bool, **asked: Any
) -> None:
    """Copy the dataset folder ROOT with disturbed radiographs: one disturbance a copy.

    For methods that learned on ROOT: `xden-bench baseline NAME --model FIT --root OUT` runs one on
    the copy. Truth and meshes stay as they are. Scores on a copy can be looked at and compared, but
    not submitted.
    """
    from xden1k.folder import open_folder
    from xden_bench.datasets import chosen_splits
    from xden_bench.datasets import disturb as write_disturbed

    folder = open_folder(root)
    splits = chosen_splits(folder, split)
    disturbance = _disturbance(asked, folder, splits, seed)
    made = write_disturbed(folder, out, disturbance, splits, seed=seed, progress=progress_bar)
    assert made.disturbed is not None
    if as_json:
        print_json({"root": str(out), "splits": made.splits, "disturbed": asdict(made.disturbed)})
    else:
        click.echo(f"{out}: {made.objects} objects, whose radiographs {made.disturbed.radiographs}")


def _disturbance(
    asked: Mapping[str, Any], folder: DatasetFolder, splits: tuple[str, ...], seed: int
) -> Disturbance:
    """Return the one that was asked for."""
    from xden_bench.datasets.disturbances import (
        Averaged,
        Enlarged,
        Misplaced,
        Noisier,
        Shifted,
    )
    from xden_bench.datasets.exchange import Exchanged

    make: Mapping[str, Callable[[Any], Disturbance]] = {
        "swap": lambda _: Exchanged.drawn(folder, splits, seed),
        "mean": lambda _: Averaged(),
        "shift_px": Shifted,
        "scale": Enlarged,
        "noise": Noisier,
        "mesh_error": lambda sizes: Misplaced(*sizes),
    }
    given = [name for name in make if asked[name] is not None and asked[name] is not False]
    if len(given) != 1:
        options = ", ".join("--" + name.replace("_", "-") for name in make)
        raise click.UsageError(f"Give one of {options}; got {len(given)}.")
    return make[given[0]](asked[given[0]])
