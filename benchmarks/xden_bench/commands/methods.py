"""Commands on installed methods: baseline."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xden1k.commands import json_option, open_root, print_json
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
    from xden1k.predictions import SubmissionMeta

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
@click.option("--seed", default=0, show_default=True, help="Of methods that draw random numbers.")
@click.option(
    "--from", "built", type=FOLDER, help="With the NAME root: the dataset folder to submit."
)
@click.option("--out", type=FILE, help="The submission to write. [default: NAME.npz]")
@json_option
@click.pass_context
def baseline(
    context: click.Context,
    /,
    list_all: bool,
    root: Path | None,
    out: Path | None,
    as_json: bool,
    **asked: Any,
) -> None:
    """Run an installed method and write its submission.

    Methods are found by the entry-point group xden1k.predictors; any package can add one. The name
    root submits a dataset folder that the builder made: --from BUILT.
    """
    if list_all:
        _echo_methods(as_json)
        return
    _check(asked)
    out = out or Path(f"{asked['name']}.npz")
    meta = _run(asked, open_root(root), out, command_line(context))
    if as_json:
        print_json({"file": str(out), "meta": json.loads(meta.to_json())})
    else:
        notes = f" ({meta.notes})" if meta.notes else ""
        click.echo(f"{out}: {meta.method}, track {meta.track}, split {meta.split}{notes}")


def run_again(command: str, folder: DatasetFolder, out: Path) -> SubmissionMeta:
    """Run a method by the printed command of its row.

    The command is parsed as ``xden-bench baseline`` parses it, and no shell sees it; its ``--root``
    and ``--out`` give way to the arguments.

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
    asked = parse_command(command, baseline)
    try:
        _check(asked)
    except click.UsageError as err:
        raise DataError(f"{command!r}: {err.format_message()}") from err
    return _run(asked, folder, out, command)


def _check(asked: Mapping[str, Any]) -> None:
    if asked["name"] is None:
        raise click.UsageError("Give the NAME of a method, or --list.")
    if (asked["name"] == "root") != (asked["built"] is not None):
        raise click.UsageError("The name root and the option --from go together.")


def _run(
    asked: Mapping[str, Any], folder: DatasetFolder, out: Path, command: str
) -> SubmissionMeta:
    """Run the method that was asked for."""
    from xden1k.folder import open_folder
    from xden_bench.baseline import find_predictor, run_predictor
    from xden_bench.rebuilt import Rebuilt

    built, target = asked["built"], asked["target"]
    return run_predictor(
        find_predictor(asked["name"]) if built is None else Rebuilt(open_folder(built), target),
        folder,
        asked["split"],
        out,
        target=target,
        seed=asked["seed"],
        command=command,
        progress=progress_bar,
    )


def _echo_methods(as_json: bool) -> None:
    from dataclasses import asdict

    from tabulate import tabulate

    from xden_bench.baseline import list_predictors

    methods = [asdict(one) for one in list_predictors()]
    if as_json:
        print_json(methods)
    else:
        click.echo(tabulate(methods, headers="keys"))
