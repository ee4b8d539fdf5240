"""``xden-bench appearance``: what a method misjudges on view, and what no picture shows."""

from __future__ import annotations

from dataclasses import asdict, astuple
from pathlib import Path

import click

from xden1k.commands import json_option, print_json
from xden_bench.commands.shared import (
    FILE,
    open_reference,
    progress_bar,
    protocol_option,
    root_option,
    split_option,
)

__all__ = ["appearance"]

HEADINGS = ("method", "density MAE, g/cm³", "recognition", "hidden", "from the eye")


@click.command(epilog="Example: xden-bench appearance mine.npz --eye seen-materials.npz")
@click.argument("submissions", type=FILE, nargs=-1, required=True)
@click.option("--eye", type=FILE, required=True, help="Submission of a perfect eye.")
@root_option
@split_option
@protocol_option
@json_option
def appearance(
    submissions: tuple[Path, ...],
    eye: Path,
    root: Path | str | None,
    split: str,
    protocol: str,
    as_json: bool,
) -> None:
    """Split the density error of SUBMISSIONS by what can be seen from outside.

    A perfect eye is told the true material of the visible surface and fills the object with it:
    `xden-bench baseline seen-materials`. What a method makes wrong where that eye is right is
    recognition; the rest is hidden in the object. The two add up to the density MAE.
    """
    from tabulate import tabulate

    from xden_bench.scoring.hidden import split_errors
    from xden_bench.scoring.protocol import load_protocol

    reference, rules = open_reference(root, split), load_protocol(protocol)
    found = [split_errors(path, eye, reference, rules, progress_bar) for path in submissions]
    if as_json:
        print_json([asdict(one) for one in found])
        return
    rows = [astuple(one)[:-1] for one in found]
    click.echo(tabulate(rows, HEADINGS, floatfmt=".3f"))
    click.echo(f"means over {found[0].objects} objects, by the eye {eye}")
