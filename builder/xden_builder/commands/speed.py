"""``xden-build speed``: our ways against others, and growth."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from xden1k.commands import json_option, print_json
from xden_builder.commands.shared import progress_bar

if TYPE_CHECKING:
    from xden_builder.speed.growth import Cost
    from xden_builder.speed.ratios import Comparison

__all__ = ["speed"]


@click.command(epilog="Example: xden-build speed --growth -o growth.png")
@click.option(
    "--size",
    type=click.IntRange(min=64),
    default=1024,
    show_default=True,
    help="Pixels a side of the comparisons.",
)
@click.option("--growth", is_flag=True, help="Measure growth with pixels, faces and parts instead.")
@click.option(
    "-o",
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Draw the growth into this PNG too.",
)
@json_option
def speed(size: int, growth: bool, out: Path | None, as_json: bool) -> None:
    """Measure our ways against others, as ratios in one run; or how time and memory grow."""
    if growth:
        _growth(out, as_json)
        return
    if out:
        raise click.UsageError("--out draws the growth: it needs --growth")
    from xden_builder.speed.ratios import comparisons

    rows = list(comparisons(size))
    if as_json:
        print_json([row.to_dict() for row in rows])
    else:
        _echo_comparisons(rows)


def _growth(out: Path | None, as_json: bool) -> None:
    from xden_builder.speed.growth import cases, costs, draw_growth

    chosen, rows = cases(), []
    with progress_bar(len(chosen), "case") as bar:
        for row in costs(chosen):
            rows.append(row)
            bar.update()
    if as_json:
        print_json([row.to_dict() for row in rows])
    else:
        _echo_growth(rows)
    if out:
        draw_growth(rows, out)


def _echo_growth(rows: list[Cost]) -> None:
    from tabulate import tabulate

    from xden_builder.speed.growth import AXES, along

    costs = {row.case: row for row in rows}
    headers = ["varied", "", "path lengths, CPU s", "fit, CPU s", "start, MB", "+ lengths", "+ fit"]
    table = [
        (
            axis,
            f"{getattr(row.case, axis):,}",
            *(f"{seconds:.3f}" for seconds in (row.lengths_s, row.fit_s)),
            *(f"{memory:.0f}" for memory in (row.start_mb, row.lengths_mb, row.fit_mb)),
        )
        for axis in AXES
        for row in map(costs.__getitem__, along(axis))
    ]
    aligned = ("left", *["right"] * 6)
    click.echo(tabulate(table, headers, disable_numparse=True, colalign=aligned))


def _echo_comparisons(rows: list[Comparison]) -> None:
    from tabulate import tabulate

    for row in rows:
        table = [
            ("ours: " + row.ours, f"{row.ours_s:.4f}", f"{row.ours_error:.1e}"),
            (row.other, f"{row.other_s:.4f}", f"{row.other_error:.1e}"),
        ]
        digits = 0 if row.ratio > 10 else 1
        click.echo(f"\n{row.task}: {row.ratio:.{digits}f} times the {row.clock} time")
        click.echo(tabulate(table, [row.task, "s", row.error], disable_numparse=True))
