"""Commands on installed methods: baseline."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xden1k.commands import LOCAL_ROOT, json_option, key_values, open_root, print_json
from xden1k.errors import DataError
from xden_bench.commands.shared import (
    FILE,
    FOLDER,
    command_line,
    parse_command,
    progress_bar,
    root_option,
)

if TYPE_CHECKING:
    from xden1k.folder import DatasetFolder
    from xden1k.predictions import MethodMeta
    from xden_bench.methods.running import Report

__all__ = ["baseline", "run_again"]


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
@click.option(
    "--task",
    type=click.Choice(["densities", "segments"]),
    default="densities",
    show_default=True,
    help="What it is asked for: preds.npz, or segments.npz for `xden-bench segment`.",
)
@click.option("--seed", default=0, show_default=True, help="Of methods that draw random numbers.")
@click.option("--budget", metavar="AMOUNT", help="Of training: 20epochs, 90s. [default: its own]")
@click.option(
    "--train-objects",
    type=int,
    metavar="N",
    help="Learn from N training objects, drawn by the seed; those of fewer are among them."
    " [default: all]",
)
@click.option("--views", type=FOLDER, help="Scenes with colour pictures, in place of --pictures.")
@click.option(
    "--pictures", metavar="NAME", help="How phantoms are drawn: flat or shaded. [default: shaded]"
)
@click.option("--model", type=FOLDER, help="What it learned before, in place of learning.")
@click.option("--save", type=FOLDER, help="Keep what it learns in this new folder.")
@click.option(
    "--set", "settings", metavar="KEY=VALUE", multiple=True, help="Of the method; repeatable."
)
@click.option(
    "--from", "built", type=LOCAL_ROOT, help="With the NAME root: the dataset folder to submit."
)
@click.option("--hardware", default="", help="What the seconds per object are measured on.")
@click.option("--out", type=FILE, help="The submission to write. [default: NAME.npz]")
@json_option
@click.pass_context
def baseline(
    context: click.Context,
    /,
    list_all: bool,
    root: Path | str | None,
    out: Path | None,
    as_json: bool,
    **asked: Any,
) -> None:
    """Run an installed method and write its submission.

    Methods are found by the entry-point group xden1k.predictors; any package can add one. The name
    root submits a dataset folder that the builder made: --from BUILT.

    A run that was interrupted goes on where it stopped when the same command is given again. What
    it has is in the hidden folder .OUT.partial until then.
    """
    if list_all:
        _echo_methods(as_json)
        return
    _check(asked)
    out = out or Path(f"{asked['name']}.npz")
    report = _run(asked, open_root(root), out, command_line(context))
    if as_json:
        meta = json.loads(report.meta.to_json())
        print_json({"file": str(out), "meta": meta, "mass_native_g": dict(report.mass_native_g)})
    else:
        _echo_report(out, report)


def run_again(command: str, folder: DatasetFolder, out: Path) -> MethodMeta:
    """Run a method by the printed command of its row.

    The command is parsed as ``xden-bench baseline`` parses it, and no shell sees it; its ``--root``
    and ``--out`` give way to the arguments, and its ``--save`` is left out, so that nothing else
    is written.

    Parameters
    ----------
    command
        As an entry has it.
    folder
        The dataset.
    out
        The submission to write.

    Raises
    ------
    DataError
        If it is another command, or its options are none, or the method fails on them.
    """
    asked = parse_command(command, baseline) | {"save": None}
    try:
        _check(asked)
    except click.UsageError as err:
        raise DataError(f"{command!r}: {err.format_message()}") from err
    return _run(asked, folder, out, command).meta


def _check(asked: Mapping[str, Any]) -> None:
    if asked["name"] is None:
        raise click.UsageError("Give the NAME of a method, or --list.")
    if (asked["name"] == "root") != (asked["built"] is not None):
        raise click.UsageError("The name root and the option --from go together.")


def _run(asked: Mapping[str, Any], folder: DatasetFolder, out: Path, command: str) -> Report:
    """Run the method that was asked for."""
    from xden1k.folder import open_folder
    from xden1k.predictor import Budget
    from xden_bench.methods import apart
    from xden_bench.methods.baseline import find_pictures
    from xden_bench.methods.rebuilt import Rebuilt
    from xden_bench.methods.running import Options, run_predictor
    from xden_bench.scoring.protocol import load_segment_protocol

    built, target, budget = asked["built"], asked["target"], asked["budget"]
    method = apart.Method(asked["name"], key_values(asked["settings"]))
    predictor = method.load() if built is None else Rebuilt(open_folder(built), target)
    options = Options(
        target=target,
        seed=asked["seed"],
        budget=Budget.parse(budget) if budget else None,
        model=asked["model"],
        save=asked["save"],
        pictures=find_pictures(predictor, asked["views"], asked["pictures"]),
        command=command,
        hardware=asked["hardware"],
        points_seed=load_segment_protocol().points_seed if asked["task"] == "segments" else None,
        train_objects=asked["train_objects"],
    )
    run = (folder, asked["split"], out, options, progress_bar)
    if built is not None:
        return run_predictor(predictor, *run)
    return apart.run_apart(method, predictor, *run)


def _echo_report(out: Path, report: Report) -> None:
    from statistics import median

    meta = report.meta
    notes = f" ({meta.notes})" if meta.notes else ""
    seconds = meta.seconds_per_object
    took = "" if seconds is None else f", {seconds:g} s an object"
    click.echo(f"{out}: {meta.method}, track {meta.track}, split {meta.split}{took}{notes}")
    if report.continued:
        click.echo(f"continued: {report.continued} objects were predicted before")
    if masses := report.mass_native_g.values():
        click.echo(f"mass by its own rule, never scored: median {median(masses):.4g} g")


def _echo_methods(as_json: bool) -> None:
    from dataclasses import asdict

    from tabulate import tabulate

    from xden_bench.methods.baseline import list_predictors

    methods = [asdict(one) for one in list_predictors()]
    if as_json:
        print_json(methods)
    else:
        click.echo(tabulate(methods, headers="keys"))
