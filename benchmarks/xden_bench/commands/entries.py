"""Commands on stored entries: compare two, verify one, withdraw one."""

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
from xden_bench.commands.entering import comparison_values, echo_comparison
from xden_bench.commands.methods import run_again
from xden_bench.commands.segments import submit as submit_segments
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
    signing_key_option,
    split_option,
)
from xden_bench.commands.submissions import submit

if TYPE_CHECKING:
    from xden_bench.entries.recomputed import How
    from xden_bench.entries.verification import Verification
    from xden_bench.scoring.comparison import Scored
    from xden_bench.scoring.reference import Reference
    from xden_bench.scoring.score import Score

__all__ = ["compare", "verify", "withdraw"]

UNCOUNTED = "; it counts nothing here: no key of maintainers.toml has signed it"
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

    A and B are submissions (.npz), which are scored, or stored entries (.json). Where the interval
    of the mean difference excludes zero, one of them is better; it is given only where it can be
    trusted. p is the sign test's over categories. Objects of the split private are not listed.
    """
    from xden1k.values.types import PRIVATE
    from xden_bench.scoring.comparison import compare as compare_scores
    from xden_bench.scoring.protocol import load_rules

    first, second = (_scored(path, **asked) for path in (a, b))
    rules = load_rules(first.compared["protocol"])
    listed = 0 if first.compared["split"] == PRIVATE else largest
    found = compare_scores(first, second, rules, listed)
    if as_json:
        metrics = {name: comparison_values(one) for name, one in found.items()}
        print_json({"a": first.name, "b": second.name, **first.compared, "metrics": metrics})
    else:
        echo_comparison(first.name, second.name, found)


@click.command(epilog="Example: xden-bench verify benchmarks/results/v1/.../water-1234.json")
@click.argument("entry", type=FILE)
@click.option("--submission", type=FILE, help="The entry's. [default: the archived one]")
@click.option("--remake", is_flag=True, help="Run the method again, and score what it gives.")
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
@click.option("--recomputed", is_flag=True, help="Note beside the entry that it came out again.")
@signing_key_option
@json_option
@click.pass_context
def verify(
    context: click.Context,
    entry: Path,
    submission: Path | None,
    remake: bool,
    root: Path | str | None,
    sealed: Path | None,
    key: Path | None,
    tolerance: float,
    recomputed: bool,
    signing_key: Path | None,
    as_json: bool,
) -> None:
    """Compare all that an entry says with what is found now.

    Its submission is scored again: the one given, or the archived one. With --remake, or where none
    is archived, the method runs again, by the command that the entry prints, if that is one of
    `xden-bench baseline`. Exit code 1 if anything differs. Entries are never changed; a note counts
    if a maintainer signs it.
    """
    from xden_bench.entries.archive import archived
    from xden_bench.entries.reading import read_entry, results_of
    from xden_bench.entries.recomputed import write_recomputed
    from xden_bench.entries.signing import read_maintainers, read_signing_key

    if remake and submission is not None:
        raise click.UsageError("Of --submission and --remake give one.")
    signer = read_signing_key(signing_key) if signing_key else None
    values = read_entry(entry)
    results = results_of(entry, values)
    reference = open_reference(root, values["dataset"]["split"], sealed, key)
    if not remake and submission is None and "archive" in values:
        submission = archived(values, results)
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
        said = command_line(context)
        note = write_recomputed(entry, how, found, said, today, signer, results)
        counts = signer is not None and signer.public_key in read_maintainers(results)
        click.echo(f"noted: {note}{'' if counts else UNCOUNTED}", err=as_json)


@click.command(epilog="Example: xden-bench withdraw ENTRY.json --reason 'a bug' --signing-key KEY")
@click.argument("entry", type=FILE)
@click.option("--reason", required=True, help="Why: one line, which the table prints.")
@click.option(
    "--erratum", is_flag=True, help="Leave the row where it is, and only say what is wrong with it."
)
@click.option("--signing-key", type=FILE, required=True, help="The team's, or a maintainer's.")
@json_option
def withdraw(entry: Path, reason: str, erratum: bool, signing_key: Path, as_json: bool) -> None:
    """Withdraw an entry, or add an erratum.

    A signed note is written beside it. The row stays in the table, struck out and without a rank.
    """
    from xden_bench.entries.amendments import amend
    from xden_bench.entries.reading import read_entry, results_of
    from xden_bench.entries.signing import read_maintainers, read_signing_key

    key, values = read_signing_key(signing_key), read_entry(entry)
    team = values.get("team", {"public_key": None})
    if key.public_key not in (team["public_key"], *read_maintainers(results_of(entry, values))):
        raise DataError(
            f"{entry}: the key of {key.name!r} is neither its team's nor a maintainer's"
        )
    today = datetime.datetime.now(tz=datetime.UTC).date()
    path = amend(entry, "erratum" if erratum else "withdrawn", reason, today, key)
    if as_json:
        print_json({"file": str(path)})
    else:
        click.echo(f"{path}: `xden-bench leaderboard` makes the table")


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
    from xden_bench.entries.reading import read_entry
    from xden_bench.entries.result import entry_of, object_columns
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
    from xden_bench.entries.verification import verify as compare_all

    check_reference(entry, reference)
    path = submission or scratch / "remade.npz"
    if submission is None:
        _check_command(entry, reference)
        run_again(entry["method"]["command"], reference.folder, path)
    found = compare_all(entry, _rescored(entry["protocol"], path, reference), reference, tolerance)
    if submission is not None and not found.same_file:
        raise DataError(f"{submission} is not the entry's submission: its sha256 is another")
    return found


def _check_command(entry: Mapping[str, Any], reference: Reference) -> None:
    """Refuse to make an entry anew whose command says that it was scored otherwise."""
    from xden_bench.entries.entry_form import FIRST_SCHEMA
    from xden_bench.scoring.protocol import SEGMENT_PROTOCOLS

    if entry["protocol"] in SEGMENT_PROTOCOLS:
        asked = parse_command(entry["command"], submit_segments, group=["segment"])
        stated = {"split": reference.split}
    else:
        then = {"protocol": "v1"} if entry["schema"] == FIRST_SCHEMA else None
        asked = parse_command(entry["command"], submit, then)
        stated = {"protocol": entry["protocol"], "split": reference.split}
    for name, value in stated.items():
        if asked[name] != value:
            raise DataError(f"the entry's command has {name} {asked[name]}, not {value}")


def _rescored(protocol: str, path: Path, reference: Reference) -> Score:
    """Score a submission by a protocol, of densities or of segments."""
    from xden_bench.methods.trivial import score_told
    from xden_bench.scoring.protocol import (
        SEGMENT_PROTOCOLS,
        load_protocol,
        load_segment_protocol,
    )

    if protocol not in SEGMENT_PROTOCOLS:
        return score_told(path, reference, load_protocol(protocol), progress=progress_bar)
    from xden_bench.scoring.regions import SegmentReference
    from xden_bench.scoring.segments import score_segment_file

    truth = SegmentReference(reference.folder, reference.split, load_segment_protocol(protocol))
    return score_segment_file(path, truth, progress=progress_bar)


def _echo_verification(entry: Path, how: str, found: Verification) -> None:
    count = len(found.deviations)
    said = f"{count} differ" if count else "all agree"
    click.echo(
        f"{entry}: {how}, {found.numbers} numbers and every text compared, {said}; largest "
        f"relative difference {found.largest_relative_difference:.2g}; not verifiable: "
        f"{', '.join(found.not_verifiable)}"
    )
    echo_lines(None, found.deviations[:SHOWN])
    if count > SHOWN:
        click.echo(f"and {count - SHOWN} more")
