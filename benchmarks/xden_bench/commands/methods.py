"""Commands on installed methods: baseline."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from xden1k.commands import json_option, open_root, print_json
from xden_bench.commands.shared import FILE, FOLDER, command_line, progress_bar, root_option

__all__ = ["baseline"]


@click.command(epilog="Example: xden-bench baseline water --split test --out water.npz")
@click.argument("name", required=False)
@click.option("--list", "list_all", is_flag=True, help="List the methods that are installed.")
@root_option
@click.option("--split", default="test", show_default=True, help="Split to predict.")
@click.option(
    "--target",
    type=click.Choice(["density", "apparent_density"]),
    default="density",
    show_default=True,
    help="What to learn and predict.",
)
@click.option("--seed", default=0, show_default=True, help="Of methods that draw random numbers.")
@click.option(
    "--from", "built", type=FOLDER, help="With the NAME root: the dataset folder to submit."
)
@click.option("--out", type=FILE, help="The submission to write. [default: NAME.npz]")
@json_option
@click.pass_context
def baseline(
    context: click.Context,
    name: str | None,
    list_all: bool,
    root: Path | None,
    split: str,
    target: Any,
    seed: int,
    built: Path | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Run an installed method and write its submission.

    Methods are found by the entry-point group xden1k.predictors; any package can add one. The name
    root submits a dataset folder that the builder made: --from BUILT.
    """
    from xden1k.folder import open_folder
    from xden_bench.baseline import find_predictor, run_predictor
    from xden_bench.rebuilt import Rebuilt

    if list_all:
        _echo_methods(as_json)
        return
    if name is None:
        raise click.UsageError("Give the NAME of a method, or --list.")
    if (name == "root") != (built is not None):
        raise click.UsageError("The name root and the option --from go together.")
    out = out or Path(f"{name}.npz")
    meta = run_predictor(
        find_predictor(name) if built is None else Rebuilt(open_folder(built), target),
        open_root(root),
        split,
        out,
        target=target,
        seed=seed,
        command=command_line(context),
        progress=progress_bar,
    )
    if as_json:
        print_json({"file": str(out), "meta": json.loads(meta.to_json())})
    else:
        notes = f" ({meta.notes})" if meta.notes else ""
        click.echo(f"{out}: {meta.method}, track {meta.track}, split {split}{notes}")


def _echo_methods(as_json: bool) -> None:
    from dataclasses import asdict

    from tabulate import tabulate

    from xden_bench.baseline import list_predictors

    methods = [asdict(one) for one in list_predictors()]
    if as_json:
        print_json(methods)
    else:
        click.echo(tabulate(methods, headers="keys"))
