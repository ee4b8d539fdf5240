"""``xden-build bench-scanner``: captures by another simulator, to judge the builder by."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from xden1k.commands import json_option, print_json
from xden_builder.commands.shared import FOLDER, progress_bar, workers_option

__all__ = ["bench_scanner"]


@click.command(epilog="Example: xden-build bench-scanner bench --count 24 --seed 1")
@click.argument("out", type=FOLDER)
@click.option("--count", type=click.IntRange(min=1), required=True, help="Objects to make.")
@click.option("--seed", type=click.IntRange(min=0), required=True, help="Which, and which scanner.")
@click.option("--size", type=click.IntRange(min=64), default=256, show_default=True)
@click.option(
    "--screen",
    type=click.Choice(["csi", "gos", "counting"]),  # SCREENS, whose import takes SciPy's time
    default="csi",
    show_default=True,
    help="What stops the photons.",
)
@click.option(
    "--filter",
    "copper",
    type=click.Choice(["told", "untold"]),
    default="told",
    show_default=True,
    help="Whether scanner.toml tells of the copper in the beam.",
)
@click.option(
    "--scatter",
    type=click.FloatRange(min=0.0),
    show_default="1.2 to 2, drawn for each object",
    help="Factor on single scatter.",
)
@click.option("--weighed", is_flag=True, help="Objects were on a scale, which errs by 0.5 %.")
@click.option(
    "--unannotated",
    type=click.FloatRange(0.0, 1.0),
    default=0.0,
    show_default=True,
    help="Share of the objects of which one part has no mesh.",
)
@workers_option
@json_option
def bench_scanner(
    out: Path,
    count: int,
    seed: int,
    size: int,
    screen: str,
    copper: Any,
    scatter: float | None,
    weighed: bool,
    unannotated: float,
    workers: int,
    as_json: bool,
) -> None:
    """Simulate captures by another simulator than ours: gVirtualXray, SpekPy and xraylib.

    Only the shapes and names are those of `xden-build phantoms`. The tube, the scanner's errors
    and the objects are drawn by --seed; the truth stands beside each object, for
    `xden-build evaluate OUT` and `--rebuilt`. Needs the extra [peers].
    """
    from xden_builder.phantoms.peer.setup import BenchSettings
    from xden_builder.phantoms.peer.writer import write_bench

    settings = BenchSettings(seed, size, screen, scatter, unannotated)
    with progress_bar(count) as bar:
        write_bench(
            out,
            count,
            settings,
            copper=copper,
            weighed=weighed,
            workers=workers,
            progress=lambda _: bar.update(),
        )
    if as_json:
        print_json({"out": str(out), "count": count, "seed": seed, "screen": screen})
    else:
        click.echo(f"{out}: captures of {count} objects by gVirtualXray and SpekPy, seed {seed}")
