"""``xden-bench manip mechanics``: placing and pushing, in simulation and by statics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from xden1k.commands import json_option, print_json
from xden_bench.commands.shared import FOLDER, progress_bar

if TYPE_CHECKING:
    from xden_bench.manip.mechanics import Mechanics

__all__ = ["mechanics"]


@click.command(epilog="Example: xden-bench manip mechanics scenes")
@click.argument("scenes", type=FOLDER)
@json_option
def mechanics(scenes: Path, as_json: bool) -> None:
    """Tilt, lay at an edge and push the objects of SCENES, and compare that with closed forms.

    Everything that this gives is simulated. Objects that would roll are left out, and counted.
    """
    from xden_bench.manip.mechanics import creep_of, mechanics_of
    from xden_bench.manip.mechanics_protocol import load_mechanics_protocol
    from xden_bench.manip.scenes import open_scenes

    opened, rules = open_scenes(scenes), load_mechanics_protocol()
    items = {one.object_id: one for one in opened.items()}
    creep = {name: creep_of(one, opened.rules) for name, one in items.items()}
    tried = [
        mechanics_of(items[name], opened.rules.solver, rules) for name in progress_bar(opened.ids)
    ]
    found = [one for one in tried if one is not None]
    if as_json:
        told = [asdict(one) for one in found]
        resting = {name: asdict(one) for name, one in creep.items()}
        print_json({"simulated": True, "rules": rules.name, "resting": resting, "objects": told})
        return
    click.echo(
        f"Simulated, {rules.name}: {len(found)} of {len(items)} objects stand, the others would "
        f"roll. At rest none creeps more than {max(one.speed_mm_s for one in creep.values()):.2g} "
        f"mm/s, or sinks deeper than {max(one.penetration_mm for one in creep.values()):.2g} mm."
    )
    _echo(found, rules.push.band)


def _echo(found: Sequence[Mechanics], band: float) -> None:
    from tabulate import tabulate

    headings = ("object_id", "tips at, °", "by statics", "by the centroid", "edge", "pushes")
    rows = [
        (
            one.object_id,
            f"{one.simulated_deg:.1f}",
            f"{one.foretold_deg:.1f}",
            "-" if one.uniform_deg is None else f"{one.uniform_deg:.1f}",
            f"{sum(trial.agrees for trial in one.edges)} of {len(one.edges)}",
            f"{sum(trial.agrees for trial in one.pushes)} of {len(one.pushes)}",
        )
        for one in found
    ]
    click.echo(tabulate(rows, headings, disable_numparse=True))
    errors = sorted(abs(one.simulated_deg - one.foretold_deg) for one in found)
    click.echo(
        f"tilt: {sum(error <= 5 for error in errors)} of {len(errors)} within 5°, largest "
        f"difference {errors[-1]:.1f}°"
    )
    edges = [trial for one in found for trial in one.edges]
    for name in ("true", "uniform", "beyond"):
        laid = [trial for trial in edges if trial.assumed == name]
        click.echo(
            f"edge, {name}: {len(laid)} of {2 * len(found)} can be laid down, "
            f"{sum(one.stays for one in laid)} stay; statics agrees with "
            f"{sum(one.agrees for one in laid)}"
        )
    pushes = [trial for one in found for trial in one.pushes]
    clear = [trial for trial in pushes if not trial.is_near(band)]
    click.echo(
        f"pushes: statics agrees with {sum(one.agrees for one in pushes)} of {len(pushes)}, and "
        f"with {sum(one.agrees for one in clear)} of {len(clear)} over {band:.0%} from the limit"
    )
