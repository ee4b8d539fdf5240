"""``xden-build calibrate``: a scanner's spectrum and geometry by radiographs of phantoms."""

from __future__ import annotations

from pathlib import Path
from shlex import quote

import click

from xden1k.commands import json_option, print_json
from xden_builder.commands.shared import FOLDER

__all__ = ["calibrate"]


@click.command(epilog="Example: xden-build calibrate scans --out calibrated")
@click.argument("captures", type=FOLDER, required=False)
@click.option("--out", type=FOLDER, help="Folder to write: scanner.toml and its evidence.")
@click.option("--phantoms", type=FOLDER, help="Write meshes and drawings of the phantoms there.")
@click.option("--example", type=FOLDER, help="Simulate such scans there, to try the command on.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@click.option("--size", type=click.IntRange(min=256), default=512, show_default=True)
@json_option
def calibrate(
    captures: Path | None,
    out: Path | None,
    phantoms: Path | None,
    example: Path | None,
    seed: int,
    size: int,
    as_json: bool,
) -> None:
    """Find a scanner's spectrum, stray light and geometry by step wedges and balls.

    CAPTURES holds a scanner.toml with what is told, a calibration.toml that says which phantoms
    are where, and the scans. --out gets a scanner.toml for `xden-build run`, plots of the
    residuals, and calibration.json. Nothing is ever overwritten. --phantoms and --example stand
    alone; --seed and --size belong to --example.
    """
    if sum(each is not None for each in (captures, phantoms, example)) != 1:
        raise click.UsageError("give CAPTURES, --phantoms or --example, one of them")
    if (captures is None) != (out is None):
        raise click.UsageError("CAPTURES and --out go together")
    if captures is not None and out is not None:
        _calibrate(captures, out, as_json)
    elif phantoms is not None:
        _write_phantoms(phantoms, as_json)
    elif example is not None:
        _simulate(example, seed, size, as_json)


def _calibrate(captures: Path, out: Path, as_json: bool) -> None:
    from xden_builder.calibrate.run import calibrate_scanner
    from xden_builder.triage.flags import flag_kind

    found = calibrate_scanner(captures, out)
    if as_json:
        print_json(found.to_dict())
        return
    for sentence in found.sentences():
        click.echo(sentence)
    for place, flag in (each.rsplit(":", 1) for each in found.flags):
        kind = flag_kind(flag)
        click.echo(f"{place}: {flag}: {kind.meaning}; {kind.remedy}")
    click.echo(f"{out / 'scanner.toml'}: copy it to your captures; look at the plots beside it")


def _write_phantoms(out: Path, as_json: bool) -> None:
    from xden1k.errors import require

    require("matplotlib", "view")
    from xden_builder.calibrate.drawing import write_designs

    written = [str(path) for path in write_designs(out)]
    if as_json:
        print_json({"written": written})
    else:
        click.echo("\n".join(written))


def _simulate(out: Path, seed: int, size: int, as_json: bool) -> None:
    from xden_builder.calibrate.example import write_example

    write_example(out, seed, size)
    if as_json:
        print_json({"out": str(out), "seed": seed, "size": size})
    else:
        named = quote(str(out))
        click.echo(f"{out}: simulated scans; try xden-build calibrate {named} --out calibrated")
