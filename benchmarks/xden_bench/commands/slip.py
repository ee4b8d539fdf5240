"""``xden-bench manip slip``: what statics says of simulated picks."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from xden1k.commands import json_option, print_json
from xden1k.errors import DataError
from xden_bench.commands.shared import FILE, FOLDER, echo_lines

if TYPE_CHECKING:
    from xden_bench.manip.slipping import SlipCheck

__all__ = ["slip"]


@click.command(epilog="Example: xden-bench manip slip scenes rows/*.json --chosen-on quick-scenes")
@click.argument("scenes", type=FOLDER)
@click.argument("rows", type=FILE, nargs=-1, required=True)
@click.option(
    "--chosen-on",
    type=FOLDER,
    required=True,
    help="Scenes on whose objects the patch is chosen; it is tested on the others.",
)
@json_option
def slip(scenes: Path, rows: tuple[Path, ...], chosen_on: Path, as_json: bool) -> None:
    """Compare what ROWS did on SCENES with the slip ratio, by one contact patch for all."""
    from xden_bench.manip.rows import read_rows
    from xden_bench.manip.scenes import open_scenes
    from xden_bench.manip.slipping import fitted_radius_cm, slip_check, slip_trials

    chosen = open_scenes(chosen_on).ids
    trials = slip_trials(open_scenes(scenes), read_rows(rows))
    parts = [
        [one for one in trials if (one.object_id in chosen) is there] for there in (True, False)
    ]
    if not all(parts):
        raise DataError(f"{scenes}: expected objects of {chosen_on}, and others")
    radius_cm = fitted_radius_cm(parts[0])
    found = {
        name: slip_check(part, radius_cm)
        for name, part in zip(("chosen_on", "tested_on"), parts, strict=True)
    }
    if as_json:
        print_json({"simulated": True, **{name: asdict(one) for name, one in found.items()}})
        return
    click.echo(f"Simulated picks; contact patch of {radius_cm:g} cm.")
    for name, one in found.items():
        _echo(name.replace("_", " "), one)


def _echo(name: str, check: SlipCheck) -> None:
    from xden_bench.manip.slipping import CAUSES

    click.echo(f"{name} {check.trials} different trials: agrees with {check.agreement:.1%}")
    echo_lines(None, (f"  {count}: {CAUSES[key]}" for key, count in check.causes.items()))
    places = (f"{key} {wrong} of {of}" for key, (wrong, of) in check.by_object.items())
    click.echo(f"  by object: {', '.join(places)}")
