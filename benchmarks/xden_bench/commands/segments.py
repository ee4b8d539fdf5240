"""Commands on segments: which points inside an object belong together."""

from __future__ import annotations

import datetime
import functools
import json
import shlex
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xden1k import commands
from xden1k.commands import Group, json_option, open_root, print_json
from xden1k.values.modality import TRACKS, Track
from xden_bench.commands.entering import (
    comparison_values,
    echo_comparison,
    echo_groups,
    echo_score,
    entered,
    refuse_disturbed,
    refuse_the_sample,
    standing_of,
)
from xden_bench.commands.shared import (
    FILE,
    RESULTS,
    echo_lines,
    progress_bar,
    root_option,
    signing_key_option,
    split_option,
    track_option,
)

if TYPE_CHECKING:
    from xden_bench.scoring.comparison import Scored
    from xden_bench.scoring.regions import SegmentReference
    from xden_bench.scoring.score import Score

__all__ = ["segment"]


@click.group(cls=Group, epilog="Example: xden-bench segment score segments.npz --root ROOT")
def segment() -> None:
    """Check, score and enter segments.npz: which points inside an object belong together.

    `xden-bench baseline NAME --task segments` runs an installed method.
    """


def _submission_command(out_help: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Decorate a command with what validate, score and submit share; its own options go on."""

    def decorate(function: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(function)
        def command(root: Path | str | None, split: str, **given: Any) -> None:
            function(reference=_reference(root, split), **given)

        for add in (
            json_option,
            click.option("--out", type=click.Path(path_type=Path), help=out_help),
            track_option,
            split_option,
            root_option,
            click.argument("submission", type=FILE),
        ):
            command = add(command)
        return command

    return decorate


@segment.command(epilog="Example: xden-bench segment template --track xray --out segments.npz")
@root_option
@split_option
@click.option(
    "--track",
    type=click.Choice(TRACKS),
    default="geometry",
    show_default=True,
    help="Where to run.",
)
@click.option(
    "--out", type=FILE, default="segments.npz", show_default=True, help="The file to write."
)
@json_option
def template(root: Path | str | None, split: str, track: Track, out: Path, as_json: bool) -> None:
    """Write an empty submission, to be filled in."""
    from xden_bench.methods.segment_template import SEGMENTS_TO_FILL_IN, write_segment_template

    reference = _reference(root, split)
    meta = write_segment_template(out, reference, track, progress_bar)
    if as_json:
        print_json({"file": str(out), "meta": json.loads(meta.to_json()), "ids": reference.ids})
        return
    click.echo(f"{out}: {len(reference.ids)} objects of one region. Fill in:")
    echo_lines(None, (f"  {name}: {what}" for name, what in SEGMENTS_TO_FILL_IN.items()))
    click.echo(f"then `xden-bench segment validate {shlex.quote(str(out))}`.")


@segment.command(epilog="Example: xden-bench segment validate segments.npz")
@_submission_command("Also write the findings to this JSON file.")
def validate(
    submission: Path,
    reference: SegmentReference,
    track: Track | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """List everything that is wrong with a submission."""
    from xden1k.predictions import raise_errors
    from xden_bench.entries.durable import write_text
    from xden_bench.scoring.segments import validate_segments

    found = validate_segments(submission, reference, track, progress_bar)
    problems = [
        {"code": one.code, "object_id": one.object_id, "message": one.message} for one in found
    ]
    report = {"valid": not found, "problems": problems}
    if out:
        write_text(out, json.dumps(report, indent=2) + "\n")
    if as_json:
        print_json(report)
        raise SystemExit(1 if found else 0)
    raise_errors(found, submission)
    click.echo(f"{submission}: valid")


@segment.command(epilog="Example: xden-bench segment score segments.npz --split val")
@_submission_command("Also write the result to this JSON file.")
def score(
    submission: Path,
    reference: SegmentReference,
    track: Track | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Score a submission without entering it."""
    from xden_bench.entries.durable import write_text

    scored, entry = _scored(submission, reference, track)
    if out:
        write_text(out, json.dumps(entry, indent=2, ensure_ascii=False) + "\n")
    if as_json:
        print_json(entry)
    else:
        _echo(scored)
        echo_groups("size", scored.by_size())
        echo_groups("category", scored.by_category())


@segment.command(epilog="Example: xden-bench segment submit segments.npz --signing-key team.key")
@_submission_command(f"Folder of the results. [default: {RESULTS}]")
@signing_key_option
@click.option(
    "--archive-url",
    default="",
    metavar="URL",
    help="Where SUBMISSION can be fetched for good. [default: it is copied into the results]",
)
def submit(
    submission: Path,
    reference: SegmentReference,
    track: Track | None,
    out: Path | None,
    as_json: bool,
    signing_key: Path | None,
    archive_url: str,
) -> None:
    """Score a submission and add it to the results.

    Nothing is written if anything is wrong with it. `xden-bench leaderboard` makes the table.
    """
    from xden_bench.entries.archive import check_url
    from xden_bench.entries.result import write_entry
    from xden_bench.entries.signing import read_signing_key
    from xden_bench.methods.segment_template import check_reading_row

    if archive_url:
        check_url(archive_url)
    key = read_signing_key(signing_key) if signing_key else None
    refuse_disturbed(reference.folder)
    if out is None:
        refuse_the_sample(reference)
    scored, entry = _scored(submission, reference, track)
    check_reading_row(submission, reference)
    path = write_entry(
        entry,
        scored,
        out or RESULTS,
        submission=submission,
        archive_url=archive_url,
        key=key,
    )
    standing = standing_of(entry, path)
    if as_json:
        print_json({"file": str(path), "standing": standing, **entry})
    else:
        _echo(scored)
        click.echo(f"scored on the split {reference.split} of {reference.folder.root}")
        click.echo(standing)
        click.echo(entered(path, out))


@segment.command(epilog="Example: xden-bench segment compare mine.npz other.npz")
@click.argument("a", type=FILE)
@click.argument("b", type=FILE)
@root_option
@split_option
@click.option(
    "--largest",
    type=click.IntRange(min=0),
    default=5,
    show_default=True,
    help="Objects to list for each metric.",
)
@json_option
def compare(
    a: Path, b: Path, root: Path | str | None, split: str, largest: int, as_json: bool
) -> None:
    """Compare two methods on the same objects.

    A and B are submissions (.npz), which are scored, or stored entries (.json). Where the interval
    of the mean difference excludes zero, one of them is better; it is given only where it can be
    trusted. p is the sign test's over categories.
    """
    from xden_bench.scoring.comparison import compare as compare_scores
    from xden_bench.scoring.protocol import load_rules

    first, second = (_compared(path, root, split) for path in (a, b))
    rules = load_rules(first.compared["protocol"])
    found = compare_scores(first, second, rules, largest)
    if as_json:
        metrics = {name: comparison_values(one) for name, one in found.items()}
        print_json({"a": first.name, "b": second.name, **first.compared, "metrics": metrics})
    else:
        echo_comparison(first.name, second.name, found)


@segment.command(epilog="Example: xden-bench segment kinds mine.npz other.npz --split unseen")
@click.argument("submissions", type=FILE, nargs=-1, required=True)
@root_option
@split_option
@json_option
def kinds(
    submissions: tuple[Path, ...], root: Path | str | None, split: str, as_json: bool
) -> None:
    """Tell where submissions lose: by number of regions, dark metal, hidden or thin parts, voids.

    Objects are scored by protocol A, parts by the cluster that fits each best.
    """
    from tabulate import tabulate

    from xden_bench.scoring.kinds import segment_kinds

    reference = _reference(root, split)
    found = [segment_kinds(path, reference, progress_bar) for path in submissions]
    if as_json:
        print_json(
            {
                str(path): {kind: asdict(one) for kind, one in means.items()}
                for path, means in zip(submissions, found, strict=True)
            }
        )
        return
    rows = [
        (kind, one.count, *(f"{means[kind].iou:.1f}" for means in found))
        for kind, one in found[0].items()
    ]
    headings = ["mean IoU, %", "number", *(path.stem for path in submissions)]
    click.echo(tabulate(rows, headings, disable_numparse=True))


@segment.command(
    epilog="Example: xden-bench segment show pliers-0000 a.npz b.npz --picture pliers.png"
)
@click.argument("objects", metavar="OBJECT[,OBJECT...]")
@click.argument("submissions", type=FILE, nargs=-1, required=True)
@root_option
@split_option
@click.option("--picture", type=FILE, help="Draw them: an object a row, a submission a column.")
@json_option
def show(
    objects: str,
    submissions: tuple[Path, ...],
    root: Path | str | None,
    split: str,
    picture: Path | None,
    as_json: bool,
) -> None:
    """Show clusters of SUBMISSIONS beside the true regions of single objects.

    Prints IoU by protocol A of each, and draws surface, radiographs, true regions in a cut and the
    clusters that are scored. Needs the extra view to draw.
    """
    from tabulate import tabulate

    from xden1k.errors import require

    if picture:
        require("matplotlib", "view")
    from xden_bench.pictures.rows import rows_of

    reference = _reference(root, split)
    rows = rows_of(reference, objects.split(","), submissions)
    if picture:
        from xden_bench.pictures.segments import draw_segments

        draw_segments(reference, rows, picture)
    if as_json:
        print_json([row.to_json() for row in rows])
        return
    headings = ["object", "regions", *(one.method for one in rows[0].answers)]
    cells = [
        [row.object_id, row.regions, *(f"{one.iou_a:.1f}" for one in row.answers)] for row in rows
    ]
    click.echo(tabulate(cells, headings, disable_numparse=True))
    if picture:
        click.echo(f"{picture}: drawn")


def _reference(root: Path | str | None, split: str) -> SegmentReference:
    from xden_bench.scoring.protocol import load_segment_protocol
    from xden_bench.scoring.regions import SegmentReference

    return SegmentReference(open_root(root), split, load_segment_protocol())


def _scored(
    submission: Path, reference: SegmentReference, track: Track | None
) -> tuple[Score, dict[str, Any]]:
    from xden_bench.entries.result import entry_of
    from xden_bench.scoring.segments import score_segment_file

    scored = score_segment_file(submission, reference, track, progress_bar)
    today = datetime.datetime.now(tz=datetime.UTC).date()
    command = commands.command_line(click.get_current_context(), "xden-bench segment")
    return scored, entry_of(scored, reference, command=command, date=today)


def _compared(path: Path, root: Path | str | None, split: str) -> Scored:
    """Scores of a submission or of an entry, by what the file is called."""
    from xden_bench.entries.reading import read_entry
    from xden_bench.entries.result import object_columns
    from xden_bench.scoring.comparison import Scored

    if path.suffix == ".json":
        entry = read_entry(path)
        return Scored.of(entry, entry["object_scores"])
    scored, entry = _scored(path, _reference(root, split), None)
    return Scored.of(entry, object_columns(scored))


def _echo(scored: Score) -> None:
    """Print the metrics, and how many objects A and B leave out."""
    from xden_bench.scoring.score import left_out

    echo_score(scored)
    if count := left_out(scored.objects).get(scored.protocol.rank_by):
        click.echo(f"{count} of {len(scored.objects)} objects of one region: in neither A nor B")
