"""The command that shows how often the benchmark's intervals and ranks are right."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from xden1k.commands import json_option, print_json
from xden_bench.commands.shared import FOLDER, RESULTS

if TYPE_CHECKING:
    from xden_bench.entries.simulation import Coverage

__all__ = ["coverage"]

METHODS = (2, 5)
"""Equal methods in a simulated table."""


@click.command(epilog="Example: xden-bench coverage --trials 200")
@click.option("--results", type=FOLDER, default=RESULTS, show_default=True, help="The entries.")
@click.option(
    "--trials",
    type=click.IntRange(min=1),
    default=1000,
    show_default=True,
    help="Simulated data sets of each kind.",
)
@click.option(
    "--protocol",
    type=click.Choice(["v2", "segment-v1"]),  # those with intervals
    default="v2",
    show_default=True,
    help="Whose intervals and ranks.",
)
@json_option
def coverage(results: Path, trials: int, protocol: str, as_json: bool) -> None:
    """Simulate how often the 95 % intervals hold, and how often equal methods are told apart.

    Objects are drawn from a normal and a log-normal distribution, and from the scores of the
    entries, with and without categories. Lowest and highest share are over the populations.
    """
    from xden_bench.entries.leaderboard import tables
    from xden_bench.entries.reading import read_entries
    from xden_bench.entries.simulation import (
        DESIGNS,
        drawn_populations,
        stored_populations,
        told_apart,
    )
    from xden_bench.entries.simulation import coverage as simulate
    from xden_bench.scoring.protocol import load_rules

    rules, entries = load_rules(protocol), read_entries(results)
    populations = [*drawn_populations(), *stored_populations(entries, rules)]
    found = [
        simulate(one, design, rules, trials)
        for design in DESIGNS
        for one in populations
        if one.fits(design)
    ]
    equal = [
        (rows[0]["track"], count, told_apart(rows, rules, count, trials))
        for rows in tables([one for one in entries if one["protocol"] == protocol])
        for count in METHODS
        if len(rows) >= count
    ]
    if as_json:
        told = [{"track": one, "methods": count, "share": share} for one, count, share in equal]
        print_json({"coverage": [asdict(one) for one in found], "told_apart": told})
        return
    _echo_coverage(found)
    for track, count, share in equal:
        click.echo(f"{count} equal methods of track {track}: told apart in {share:.1%} of tables")


def _echo_coverage(found: Iterable[Coverage]) -> None:
    from tabulate import tabulate

    from xden_bench.scoring.metrics import METRICS

    groups: dict[tuple[int, str, bool, str], list[float]] = defaultdict(list)
    for one in found:
        kind = METRICS[one.metric].title if one.metric else one.population
        design = one.design
        categories = f"{design.categories}{' given' if design.is_fixed else ''}"
        groups[design.objects, categories, one.is_printed, kind].append(one.share)
    rows = [
        (*key[:2], "yes" if key[2] else "no", key[3], f"{min(shares):.1%}", f"{max(shares):.1%}")
        for key, shares in groups.items()
    ]
    headings = ["objects", "categories", "printed", "scores", "lowest", "highest"]
    click.echo(tabulate(rows, headings, disable_numparse=True))
