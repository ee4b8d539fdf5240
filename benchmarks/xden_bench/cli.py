"""``xden-bench``: check, score and enter submissions; run baselines; make the leaderboard."""

from __future__ import annotations

import datetime
import json
import shlex
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from xden1k.commands import Group, json_option, open_root, print_json
from xden1k.modality import TRACKS, Track

if TYPE_CHECKING:
    from xden_bench.bootstrap import Estimate
    from xden_bench.reference import Reference
    from xden_bench.scoring import Score

__all__ = ["cli"]

FILE = click.Path(path_type=Path, dir_okay=False)
FOLDER = click.Path(path_type=Path, file_okay=False)
RESULTS = Path("benchmarks/results")

root_option = click.option(
    "--root", type=FOLDER, help="Dataset folder. [default: XDEN1K_ROOT, the cache, the sample]"
)
split_option = click.option("--split", default="test", show_default=True, help="Split to score.")
track_option = click.option(
    "--track",
    type=click.Choice(TRACKS),
    help="Refuse a submission whose inputs do not put it in this track.",
)


@click.group(cls=Group)
@click.version_option(package_name="xden1k", prog_name="xden-bench")
def cli() -> None:
    """Check, score and enter submissions; run baselines; make the leaderboard."""


def submission_command(out_help: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Decorate a command with what validate, score and submit share."""

    def decorate(function: Callable[..., None]) -> Callable[..., None]:
        for add in (
            json_option,
            click.option("--out", type=click.Path(path_type=Path), help=out_help),
            track_option,
            split_option,
            root_option,
            click.argument("submission", type=FILE),
        ):
            function = add(function)
        return function

    return decorate


@cli.command(epilog="Example: xden-bench validate preds.npz --split test")
@submission_command("Also write the findings to this JSON file.")
def validate(
    submission: Path,
    root: Path | None,
    split: str,
    track: Track | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """List everything that is wrong with a submission."""
    from xden1k.predictions import raise_errors
    from xden_bench.protocol import load_protocol
    from xden_bench.result import write_text
    from xden_bench.submission import validate as find_problems

    found = find_problems(submission, _reference(root, split), load_protocol(), track, _bar)
    valid = not any(one.is_error for one in found)
    problems = [
        {"code": one.code, "object_id": one.object_id, "message": one.message} for one in found
    ]
    report = {"valid": valid, "problems": problems}
    if out:
        write_text(out, json.dumps(report, indent=2) + "\n")
    if as_json:
        print_json(report)
        raise SystemExit(0 if valid else 1)
    raise_errors(found)
    _echo_lines(f"{submission}: valid", found)


@cli.command(epilog="Example: xden-bench score preds.npz --split val")
@submission_command("Also write the result to this JSON file.")
def score(
    submission: Path,
    root: Path | None,
    split: str,
    track: Track | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Score a submission without entering it."""
    from xden_bench.result import write_text

    scored, entry = _scored(submission, _reference(root, split), track)
    if out:
        write_text(out, json.dumps(entry, indent=2, ensure_ascii=False) + "\n")
    if as_json:
        print_json(entry)
    else:
        _echo_score(scored)
        _echo_groups("size", scored.by_size())
        _echo_groups("category", scored.by_category())


@cli.command(epilog="Example: xden-bench submit preds.npz")
@submission_command(f"Folder of the results. [default: {RESULTS}]")
def submit(
    submission: Path,
    root: Path | None,
    split: str,
    track: Track | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Score a submission and add it to the results.

    Nothing is written if anything is wrong with it. `xden-bench leaderboard` makes the table.
    """
    from xden_bench.baseline import check_trivial
    from xden_bench.result import write_entry

    reference = _reference(root, split)
    scored, entry = _scored(submission, reference, track)
    check_trivial(submission, reference, scored.protocol)
    path = write_entry(entry, scored, out or RESULTS)
    if as_json:
        print_json({"file": str(path), **entry})
    else:
        _echo_score(scored)
        click.echo(_entered(path, out))


def _entered(path: Path, out: Path | None) -> str:
    """Say where an entry went and what comes next."""
    if out is None and not (RESULTS / "README.md").is_file():
        return (
            f"entered: {path.absolute()}\n"
            "This is no checkout of the repository: to enter the leaderboard, add this file and "
            f"the .parquet beside it to {RESULTS} of one, in a pull request."
        )
    more = "" if out is None else f" --results {shlex.quote(str(out))}"
    return f"entered: {path}\n`xden-bench leaderboard{more}` makes the table."


@cli.command(epilog="Example: xden-bench leaderboard --check")
@click.option("--check", is_flag=True, help="Only fail if the file does not match the results.")
@click.option("--results", type=FOLDER, default=RESULTS, show_default=True, help="The entries.")
@click.option(
    "--out", type=FILE, default="LEADERBOARD.md", show_default=True, help="The file to rewrite."
)
@json_option
def leaderboard(check: bool, results: Path, out: Path, as_json: bool) -> None:
    """Rewrite LEADERBOARD.md from the results."""
    from xden_bench.leaderboard import check_leaderboard, render, write_leaderboard
    from xden_bench.result import read_entries

    entries = read_entries(results)
    (check_leaderboard if check else write_leaderboard)(entries, out)
    if as_json:
        print_json({"file": str(out), "entries": list(entries)})
    elif not check:
        click.echo(render(entries))
    if not as_json:
        click.echo(f"{out}: {len(entries)} entries{', up to date' if check else ''}")


@cli.command(epilog="Example: xden-bench baseline water --split test --out water.npz")
@click.argument("name", required=False)
@click.option("--list", "list_all", is_flag=True, help="List the methods that are installed.")
@root_option
@click.option("--split", default="test", show_default=True, help="Split to predict.")
@click.option(
    "--target",
    type=click.Choice(["density", "apparent_density"]),
    default="density",
    show_default=True,
    help="What to learn and predict.",
)
@click.option("--seed", default=0, show_default=True, help="Of methods that draw random numbers.")
@click.option(
    "--from", "built", type=FOLDER, help="With the NAME root: the dataset folder to submit."
)
@click.option("--out", type=FILE, help="The submission to write. [default: NAME.npz]")
@json_option
@click.pass_context
def baseline(
    context: click.Context,
    name: str | None,
    list_all: bool,
    root: Path | None,
    split: str,
    target: Any,
    seed: int,
    built: Path | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Run an installed method and write its submission.

    Methods are found by the entry-point group xden1k.predictors; any package can add one. The name
    root submits a dataset folder that the builder made: --from BUILT.
    """
    from xden1k.folder import open_folder
    from xden_bench.baseline import find_predictor, run_predictor
    from xden_bench.rebuilt import Rebuilt

    if list_all:
        _echo_methods(as_json)
        return
    if name is None:
        raise click.UsageError("Give the NAME of a method, or --list.")
    if (name == "root") != (built is not None):
        raise click.UsageError("The name root and the option --from go together.")
    out = out or Path(f"{name}.npz")
    meta = run_predictor(
        find_predictor(name) if built is None else Rebuilt(open_folder(built), target),
        open_root(root),
        split,
        out,
        target=target,
        seed=seed,
        command=_command(context),
        progress=_bar,
    )
    if as_json:
        print_json({"file": str(out), "meta": json.loads(meta.to_json())})
    else:
        notes = f" ({meta.notes})" if meta.notes else ""
        click.echo(f"{out}: {meta.method}, track {meta.track}, split {split}{notes}")


@cli.command(epilog="Example: xden-bench speed preds.npz")
@click.argument("submission", type=FILE, required=False)
@root_option
@split_option
@click.option(
    "--repeats", default=5, show_default=True, help="Runs of each kind; the median holds."
)
@json_option
def speed(
    submission: Path | None, root: Path | None, split: str, repeats: int, as_json: bool
) -> None:
    """Measure scoring against reading the same arrays, in one run.

    Without a SUBMISSION, water is scored.
    """
    from dataclasses import asdict

    from xden_bench.baseline import find_predictor, run_predictor
    from xden_bench.protocol import load_protocol
    from xden_bench.speed import measure_speed

    folder = open_root(root)
    with tempfile.TemporaryDirectory() as scratch:
        if submission is None:
            submission = Path(scratch) / "water.npz"
            run_predictor(find_predictor("water"), folder, split, submission)
        measured = measure_speed(submission, folder.root, split, load_protocol(), repeats)
    if as_json:
        print_json({**asdict(measured), "ratio": measured.ratio})
    else:
        click.echo(
            f"{measured.objects} objects: reading {measured.read_seconds:.3f} s, checking and "
            f"scoring (reading included) {measured.score_seconds:.3f} s, ratio {measured.ratio:.2f}"
        )


def _reference(root: Path | None, split: str) -> Reference:
    from xden_bench.reference import Reference

    return Reference(open_root(root), split)


def _scored(
    submission: Path, reference: Reference, track: Track | None
) -> tuple[Score, dict[str, Any]]:
    from xden_bench.protocol import load_protocol
    from xden_bench.result import entry_of
    from xden_bench.scoring import score as score_file

    scored = score_file(submission, reference, load_protocol(), track, _bar)
    today = datetime.datetime.now(tz=datetime.UTC).date()
    command = _command(click.get_current_context())
    return scored, entry_of(scored, reference, command=command, date=today)


def _command(context: click.Context) -> str:
    """Return the command line as it was given, without what only changes the output."""
    words = ["xden-bench", context.info_name or ""]
    for parameter in context.command.params:
        name = parameter.name or ""
        if context.get_parameter_source(name) is ParameterSource.COMMANDLINE and name != "as_json":
            value = str(context.params[name])
            words += (
                [value] if isinstance(parameter, click.Argument) else [parameter.opts[0], value]
            )
    return shlex.join(words)


def _bar(object_ids: Sequence[str]) -> Iterable[str]:
    from tqdm import tqdm

    bar: Iterable[str] = tqdm(object_ids, unit="object", disable=None, leave=False)
    return bar


def _echo_score(scored: Score) -> None:
    from tabulate import tabulate

    from xden_bench.metrics import METRICS

    meta = scored.meta
    click.echo(
        f"{meta.method}: track {meta.track}, target {meta.target}, {len(scored.objects)} objects "
        f"({' and '.join(scored.sources)}), protocol {scored.protocol.name}"
    )
    rows = [
        (METRICS[name].heading, f"{one.mean:.4f}", f"{one.low:.4f} to {one.high:.4f}")
        for name, one in scored.metrics.items()
    ]
    click.echo(tabulate(rows, ["metric", "mean", "95 % interval"], disable_numparse=True))
    _echo_lines(None, scored.warnings)


def _echo_groups(title: str, groups: Mapping[str, tuple[int, Mapping[str, Estimate]]]) -> None:
    from tabulate import tabulate

    from xden_bench.metrics import METRICS

    names = [name for name in METRICS if name in next(iter(groups.values()))[1]]
    rows = [
        (group, count, *(f"{metrics[name].mean:.4f}" for name in names))
        for group, (count, metrics) in groups.items()
    ]
    headings = [title, "objects", *(METRICS[name].heading for name in names)]
    click.echo("\n" + tabulate(rows, headings, disable_numparse=True))


def _echo_methods(as_json: bool) -> None:
    from dataclasses import asdict

    from tabulate import tabulate

    from xden_bench.baseline import list_predictors

    methods = [asdict(one) for one in list_predictors()]
    if as_json:
        print_json(methods)
    else:
        click.echo(tabulate(methods, headers="keys"))


def _echo_lines(first: str | None, rest: Iterable[object]) -> None:
    for line in ([first] if first else []) + [str(one) for one in rest]:
        click.echo(line)
