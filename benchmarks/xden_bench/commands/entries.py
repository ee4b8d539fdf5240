"""Commands on stored entries: compare two, verify one."""

from __future__ import annotations

import datetime
import tempfile
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xden1k.commands import json_option, print_json
from xden1k.errors import DataError
from xden_bench.commands.methods import run_again
from xden_bench.commands.shared import (
    FILE,
    command_line,
    echo_lines,
    key_option,
    open_reference,
    parse_command,
    progress_bar,
    protocol_option,
    root_option,
    sealed_option,
    split_option,
)
from xden_bench.commands.submissions import submit

if TYPE_CHECKING:
    from xden_bench.entries.recomputed import How
    from xden_bench.entries.verification import Verification
    from xden_bench.scoring.comparison import Comparison, Scored
    from xden_bench.scoring.reference import Reference

__all__ = ["compare", "verify"]

SHOWN = 10
"""Deviations that are printed one by one; --json has all."""


@click.command(
    epilog="Example: xden-bench compare mine.npz benchmarks/results/v1/.../water-1234.json"
)
@click.argument("a", type=FILE)
@click.argument("b", type=FILE)
@root_option
@split_option
@sealed_option
@key_option
@protocol_option
@click.option(
    "--largest",
    type=click.IntRange(min=0),
    default=5,
    show_default=True,
    help="Objects to list for each metric.",
)
@json_option
def compare(a: Path, b: Path, largest: int, as_json: bool, **asked: Any) -> None:
    """Compare two methods on the same objects.

    A and B are submissions (.npz), which are scored, or stored entries (.json). The interval of the
    difference is a paired bootstrap's: where it excludes zero, one of them is better. Objects of
    the split private are not listed.
    """
    from xden1k.values.types import PRIVATE
    from xden_bench.scoring.comparison import compare as compare_scores
    from xden_bench.scoring.protocol import load_protocol

    first, second = (_scored(path, **asked) for path in (a, b))
    rules = load_protocol(first.compared["protocol"])
    listed = 0 if first.compared["split"] == PRIVATE else largest
    found = compare_scores(first, second, rules, listed)
    if as_json:
        metrics = {name: _comparison_values(one) for name, one in found.items()}
        print_json({"a": first.name, "b": second.name, **first.compared, "metrics": metrics})
    else:
        _echo_comparison(first.name, second.name, found)


@click.command(epilog="Example: xden-bench verify benchmarks/results/v1/.../water-1234.json")
@click.argument("entry", type=FILE)
@click.option(
    "--submission", type=FILE, help="Score this file, the entry's, instead of running the method."
)
@root_option
@sealed_option
@key_option
@click.option(
    "--tolerance",
    type=click.FloatRange(min=0),
    default=1e-5,
    show_default=True,
    help="Relative difference that another machine may make.",
)
@click.option("--recomputed", is_flag=True, help="Note beside the entry that its numbers came out.")
@json_option
@click.pass_context
def verify(
    context: click.Context,
    entry: Path,
    submission: Path | None,
    root: Path | str | None,
    sealed: Path | None,
    key: Path | None,
    tolerance: float,
    recomputed: bool,
    as_json: bool,
) -> None:
    """Compare every number of an entry with one found now.

    Without --submission the method runs again, by the command that the entry prints, if that is one
    of `xden-bench baseline`. Exit code 1 if a number differs. Entries are never changed.
    """
    from xden_bench.entries.recomputed import write_recomputed
    from xden_bench.entries.result import read_entry

    values = read_entry(entry)
    reference = open_reference(root, values["dataset"]["split"], sealed, key)
    how: How = "remade" if submission is None else "rescored"
    with tempfile.TemporaryDirectory() as scratch:
        found = _verified(values, submission, reference, tolerance, Path(scratch))
    if as_json:
        print_json({"same": not found.deviations, "how": how, **asdict(found)})
    else:
        _echo_verification(entry, how, found)
    if found.deviations:
        raise SystemExit(1)
    if recomputed:
        today = datetime.datetime.now(tz=datetime.UTC).date()
        share = found.largest_relative_difference
        note = write_recomputed(entry, how, share, command_line(context), today)
        click.echo(f"noted: {note}", err=as_json)


def _scored(
    path: Path,
    *,
    root: Path | str | None,
    split: str,
    sealed: Path | None,
    key: Path | None,
    protocol: str,
) -> Scored:
    """Scores of a submission or of an entry, by what the file is called."""
    from xden_bench.entries.result import entry_of, object_columns, read_entry
    from xden_bench.scoring.comparison import Scored
    from xden_bench.scoring.protocol import load_protocol
    from xden_bench.scoring.score import score

    if path.suffix == ".json":
        entry = read_entry(path)
        return Scored.of(entry, entry["object_scores"])
    reference = open_reference(root, split, sealed, key)
    scored = score(path, reference, load_protocol(protocol), progress=progress_bar)
    entry = entry_of(scored, reference, command="", date=datetime.date.min)
    return Scored.of(entry, object_columns(scored))


def _verified(
    entry: Mapping[str, Any],
    submission: Path | None,
    reference: Reference,
    tolerance: float,
    scratch: Path,
) -> Verification:
    """Score a submission, or one made anew, and compare it with the entry."""
    from xden_bench.entries.verification import check_reference
    from xden_bench.entries.verification import verify as compare_numbers
    from xden_bench.scoring.protocol import load_protocol
    from xden_bench.scoring.score import score

    check_reference(entry, reference)
    rules = load_protocol(entry["protocol"])
    path = submission or scratch / "remade.npz"
    if submission is None:
        asked = parse_command(entry["command"], submit)
        for name, stated in (("protocol", rules.name), ("split", reference.split)):
            if asked[name] != stated:
                raise DataError(f"the entry's command has {name} {asked[name]}, not {stated}")
        run_again(entry["method"]["command"], reference.folder, path)
    found = compare_numbers(entry, score(path, reference, rules, progress=progress_bar), tolerance)
    if submission is not None and not found.same_file:
        raise DataError(f"{submission} is not the entry's submission: its sha256 is another")
    return found


def _comparison_values(one: Comparison) -> dict[str, Any]:
    return {**asdict(one), "difference": one.difference.to_json()}


def _echo_comparison(a: str, b: str, found: Mapping[str, Comparison]) -> None:
    from tabulate import tabulate

    from xden_bench.scoring.metrics import METRICS

    rows = [
        (
            METRICS[name].heading,
            f"{one.difference.mean:+.4f}",
            f"{one.difference.low:+.4f} to {one.difference.high:+.4f}",
            f"{one.a_better_share:.1%}",
            f"{one.a_better} : {one.b_better}",
        )
        for name, one in found.items()
    ]
    headings = ["metric", "a - b", "95 % interval", "a better in", "objects a : b"]
    click.echo(f"a: {a}\nb: {b}\n" + tabulate(rows, headings, disable_numparse=True))
    for name, one in found.items():
        if not one.largest:
            continue
        pairs = (f"{pair.object_id} {pair.a:.4g} / {pair.b:.4g}" for pair in one.largest)
        click.echo(f"largest differences in {name}, a / b: {', '.join(pairs)}")


def _echo_verification(entry: Path, how: str, found: Verification) -> None:
    count = len(found.deviations)
    said = f"{count} differ" if count else "all agree"
    click.echo(
        f"{entry}: {how}, {found.numbers} numbers compared, {said}; largest relative difference "
        f"{found.largest_relative_difference:.2g}"
    )
    echo_lines(None, found.deviations[:SHOWN])
    if count > SHOWN:
        click.echo(f"and {count - SHOWN} more")
