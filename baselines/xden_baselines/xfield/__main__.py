"""``python -m xden_baselines.xfield``: what a trained network is good for beside a submission."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import click

from xden1k.commands import (
    DONE_IN_PART,
    LOCAL_ROOT,
    ROOT,
    Group,
    json_option,
    key_values,
    open_root,
    print_json,
)

__all__ = ["cli"]

PROGRAM = "python -m xden_baselines.xfield"
STATE = "state"
"""Where ``xden-bench baseline --save`` keeps what a method has saved."""


@click.group(cls=Group)
def cli() -> None:
    """Use a trained X-Field for more than a submission."""


@cli.command(epilog=f"Example: {PROGRAM} parts FIT ROOT --out PARTS")
@click.argument("fit", type=click.Path(path_type=Path, file_okay=False, exists=True))
@click.argument("root", type=LOCAL_ROOT)
@click.option(
    "--out", type=click.Path(path_type=Path, file_okay=False), required=True, help="Parts' folder."
)
@click.option("--device", default="cpu", show_default=True, help="Of the network: cpu or cuda.")
@click.option("--threads", type=click.IntRange(min=1), default=1, show_default=True)
@json_option
def parts(fit: Path, root: Path, out: Path, device: str, threads: int, as_json: bool) -> None:
    """Divide objects into parts, by their radiographs and outer surface.

    FIT is what `xden-bench baseline --save` wrote, or its folder `state`, ROOT what `xden-build run
    --outer-only` made.
    Writes --out/OBJECT_ID/parts/region-N.ply: closed, disjoint meshes that fill the outer surface
    but for voids, as `xden-build run --parts` reads them. Run again to go on. Exits with 3 if some
    objects were refused; they are listed.
    """
    from tqdm import tqdm

    from xden1k.errors import ObjectError, about, of_dataset
    from xden1k.folder import open_folder
    from xden_baselines.xfield.parts import write_parts
    from xden_baselines.xfield.saved import saved_method

    fit = fit / STATE if (fit / STATE).is_dir() else fit
    method, folder = saved_method(fit, device=device, threads=threads), open_folder(root)
    made: dict[str, str] = {}
    refused: dict[str, str] = {}
    for object_id in tqdm(folder.ids(), unit="object", disable=None, leave=False):
        try:
            with of_dataset(folder.root), about(object_id):
                made[object_id] = write_parts(method, fit, folder, object_id, out)
        except ObjectError as err:
            refused[object_id] = str(err)
    if as_json:
        print_json({"out": str(out), "objects": made, "refused": refused})
    else:
        states = list(made.values())
        counts = [f"{states.count(state)} {state}" for state in ("made", "kept")]
        click.echo(f"{out}: {', '.join(counts)}, {len(refused)} refused, by {method.name}")
    for why in refused.values():
        click.echo(f"refused: {why}", err=True)
    if refused:
        raise SystemExit(DONE_IN_PART)


@cli.command(epilog="Example: torchrun --nproc-per-node 4 -m xden_baselines.xfield train x-field")
@click.argument("method", metavar="METHOD")
@click.option("--root", type=ROOT, help="Dataset folder. [default: as xden-bench]")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@click.option("--budget", metavar="AMOUNT", help="Of training: 20epochs. [default: its own]")
@click.option(
    "--set", "settings", metavar="KEY=VALUE", multiple=True, help="Of the method; repeatable."
)
@json_option
def train(
    method: str,
    root: Path | None,
    seed: int,
    budget: str | None,
    settings: tuple[str, ...],
    as_json: bool,
) -> None:
    """Train a variant in all processes that torchrun has started on this machine.

    What is trained lies in the user's cache. `xden-bench baseline METHOD` with the same root, seed,
    budget and settings takes it up from there and learns no more. Without torchrun it is one
    process. Run again after a kill to go on after the last epoch.
    """
    from xden1k.errors import DataError, of_dataset
    from xden1k.format.cache import LIMIT_VARIABLE, cache_limit
    from xden1k.predictor import Budget, Examples
    from xden_baselines.xfield.crew import joined
    from xden_baselines.xfield.saved import method_of

    chosen = method_of(method, **key_values(settings))
    allowed = Budget.parse(budget) if budget else None
    folder = open_root(root)
    if not cache_limit():
        raise DataError(f"{LIMIT_VARIABLE} is 0: what is trained would not be kept")
    with joined(chosen.settings.device) as crew, of_dataset(folder.root):
        report = chosen.train_ahead(
            Examples(folder, "train", chosen.reads), seed=seed, budget=allowed, crew=crew
        )
    if not crew.first:
        return
    if as_json:
        print_json({"method": method, "processes": crew.count, **asdict(report)})
    else:
        click.echo(f"{method}: {report.summary}, by {crew.count} processes")


if __name__ == "__main__":
    cli(prog_name=PROGRAM)
