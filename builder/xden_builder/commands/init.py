"""``xden-build init``: the files of a capture folder that a lab fills in."""

from __future__ import annotations

from pathlib import Path
from shlex import quote

import click

from xden1k.commands import json_option, print_json
from xden_builder.commands.shared import FOLDER

__all__ = ["init"]


@click.command(epilog="Example: xden-build init captures")
@click.argument("folder", metavar="DIR", type=FOLDER)
@json_option
def init(folder: Path, as_json: bool) -> None:
    """Write a scanner.toml, an objects.csv and a parts.csv to fill in.

    They hold every key and column, with the values of an example. What is there is never
    overwritten. `xden-build check DIR` says what is still to be done.
    """
    from xden_builder.capture.starting import write_template

    written = write_template(folder)
    if as_json:
        print_json({"written": [str(path) for path in written]})
    else:
        for path in written:
            click.echo(path)
        click.echo(f"fill them in, then: xden-build check {quote(str(folder))}")
