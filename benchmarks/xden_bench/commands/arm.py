"""``xden-bench manip arm``: what a real arm's joints would bear in simulated picks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from xden1k.commands import json_option, print_json
from xden_bench.commands.shared import FILE, FOLDER, interval_text, progress_bar

if TYPE_CHECKING:
    from xden_bench.manip.torques import BurdenLine

__all__ = ["arm"]


@click.command(
    epilog="Example: xden-bench manip arm scenes rows/*.json --menagerie mujoco_menagerie"
)
@click.argument("scenes", type=FOLDER)
@click.argument("rows", type=FILE, nargs=-1, required=True)
@click.option(
    "--menagerie",
    type=FOLDER,
    required=True,
    envvar="MENAGERIE_ROOT",
    help="Your checkout of mujoco_menagerie.  [or MENAGERIE_ROOT]",
)
@json_option
def arm(scenes: Path, rows: tuple[Path, ...], menagerie: Path, as_json: bool) -> None:
    """Compute joint torques of a Franka Panda that lifts and holds what ROWS took of SCENES.

    The arm's model is your own copy: nothing is downloaded. The arm does not pick; its joints are
    asked to hold each object rigidly in the grasp that was taken. Everything is simulated.
    """
    from xden_bench.manip.arm import MODEL, load_arm
    from xden_bench.manip.arm_protocol import load_arm_protocol
    from xden_bench.manip.rows import read_rows
    from xden_bench.manip.scenes import open_scenes
    from xden_bench.manip.torques import burden_lines

    rules = load_arm_protocol()
    model, opened = load_arm(menagerie, rules), open_scenes(scenes)
    found = burden_lines(model, opened, read_rows(rows), opened.rules.statistics, progress_bar)
    if as_json:
        told = {"simulated": True, "rules": rules.name, "model": MODEL, "sha256": model.sha256}
        print_json({**told, "lines": [asdict(one) for one in found]})
        return
    click.echo(f"Simulated; {rules.name}, {MODEL} of sha256 {model.sha256[:12]}. Torques in N·m.")
    _echo(found)


def _echo(found: Sequence[BurdenLine]) -> None:
    from tabulate import tabulate

    headings = (
        *("row", "last joint", "95 %", "vs uniform", "95 %", "in the lift", "vs uniform"),
        *("mean", "vs uniform", "by the object", "vs uniform", "out of reach"),
    )
    for stratum in dict.fromkeys(one.stratum for one in found):
        click.echo(f"\nstratum {stratum}")
        rows = [_cells(one) for one in found if one.stratum == stratum]
        click.echo(tabulate(rows, headings, disable_numparse=True))


def _cells(line: BurdenLine) -> list[str]:
    figures, less = line.figures, line.against["uniform"]
    last = "last_nm"
    return [
        line.name,
        f"{figures[last].mean:.3f}",
        interval_text(figures[last], ".3f"),
        f"{less[last].mean:+.3f}",
        interval_text(less[last], "+.3f"),
        *(
            text
            for name in ("lift_nm", "mean_nm", "added_nm")
            for text in (f"{figures[name].mean:.3f}", f"{less[name].mean:+.3f}")
        ),
        f"{figures['out_of_reach'].mean:.1%}",
    ]
