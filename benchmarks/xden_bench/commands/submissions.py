"""Commands on one submission: template, validate, score, submit."""

from __future__ import annotations

import datetime
import functools
import json
import shlex
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from xden1k.commands import json_option, print_json
from xden1k.values.modality import TRACKS, Track
from xden_bench.commands.entering import (
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
    command_line,
    echo_lines,
    key_option,
    open_reference,
    progress_bar,
    protocol_option,
    root_option,
    sealed_option,
    signing_key_option,
    split_option,
    track_option,
)

if TYPE_CHECKING:
    from xden_bench.scoring.reference import Reference
    from xden_bench.scoring.score import Score

__all__ = ["Asked", "score", "submission_command", "submit", "template", "validate"]


@dataclass(frozen=True, slots=True)
class Asked:
    """What a command on a submission was asked to look at.

    Parameters
    ----------
    submission
        The file.
    root, split
        The dataset it predicts.
    sealed, key
        Of a split whose answers are sealed.
    track
        The track it is meant for; None = the one its inputs lead to.
    protocol
        Name of the rules.
    accept_warnings
        Whether a file that looks like a slip is meant.
    """

    submission: Path
    root: Path | str | None
    split: str
    sealed: Path | None
    key: Path | None
    track: Track | None
    protocol: str
    accept_warnings: bool

    def reference(self, *, scoring: bool = True) -> Reference:
        """Open the truth."""
        return open_reference(self.root, self.split, self.sealed, self.key, scoring=scoring)


def submission_command(
    out_help: str,
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Decorate a command with what validate, score and submit share; its own options go on."""
    known = {one.name for one in fields(Asked)}

    def decorate(function: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(function)
        def command(*, out: Path | None, as_json: bool, **given: Any) -> None:
            own = {name: given.pop(name) for name in given.keys() - known}
            function(Asked(**given), out, as_json, **own)

        for add in (
            json_option,
            click.option("--out", type=click.Path(path_type=Path), help=out_help),
            click.option(
                "--accept-warnings",
                is_flag=True,
                help="Take a file whose units or axes look wrong (W501, W506): it is meant.",
            ),
            protocol_option,
            track_option,
            key_option,
            sealed_option,
            split_option,
            root_option,
            click.argument("submission", type=FILE),
        ):
            command = add(command)
        return command

    return decorate


@click.command(epilog="Example: xden-bench template --track rgb --out preds.npz")
@root_option
@split_option
@click.option(
    "--track",
    type=click.Choice(TRACKS),
    default="geometry",
    show_default=True,
    help="Where to run.",
)
@protocol_option
@click.option("--out", type=FILE, default="preds.npz", show_default=True, help="The file to write.")
@click.option("--force", is_flag=True, help="Overwrite the file if it is there.")
@json_option
def template(
    root: Path | str | None,
    split: str,
    track: Track,
    protocol: str,
    out: Path,
    force: bool,
    as_json: bool,
) -> None:
    """Write an empty submission, to be filled in."""
    from xden_bench.methods.template import TO_FILL_IN, write_template
    from xden_bench.scoring.protocol import load_protocol

    if out.exists() and not force:
        raise click.ClickException(
            f"{out} is there, and may be filled in: name another by --out, or give --force"
        )
    reference = open_reference(root, split, scoring=False)
    meta = write_template(out, reference, load_protocol(protocol), track)
    if as_json:
        print_json({"file": str(out), "meta": json.loads(meta.to_json()), "ids": reference.ids})
        return
    click.echo(f"{out}: {len(reference.ids)} objects of zeros, target {meta.target}. Fill in:")
    echo_lines(None, (f"  {name}: {what}" for name, what in TO_FILL_IN.items()))
    click.echo(f"then `xden-bench validate {shlex.quote(str(out))}`.")


@click.command(epilog="Example: xden-bench validate preds.npz --split test")
@submission_command("Also write the findings to this JSON file.")
def validate(asked: Asked, out: Path | None, as_json: bool) -> None:
    """List everything that is wrong with a submission."""
    from xden1k.predictions import SUSPICIONS, raise_errors, raise_suspicions
    from xden_bench.entries.durable import write_text
    from xden_bench.scoring.protocol import load_protocol
    from xden_bench.scoring.submission import validate as find_problems

    rules, reference = load_protocol(asked.protocol), asked.reference(scoring=False)
    found = find_problems(asked.submission, reference, rules, asked.track, progress_bar)
    refused = () if asked.accept_warnings else SUSPICIONS
    valid = not any(one.is_error or one.code in refused for one in found)
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
    if not asked.accept_warnings:
        raise_suspicions(found)
    echo_lines(f"{asked.submission}: valid", found)


@click.command(epilog="Example: xden-bench score preds.npz --split val")
@submission_command("Also write the result to this JSON file.")
def score(asked: Asked, out: Path | None, as_json: bool) -> None:
    """Score a submission without entering it."""
    from xden_bench.entries.durable import write_text

    scored, entry = _scored(asked, asked.reference())
    if out:
        write_text(out, json.dumps(entry, indent=2, ensure_ascii=False) + "\n")
    if as_json:
        print_json(entry)
    else:
        echo_score(scored)
        echo_groups("size", scored.by_size())
        echo_groups("category", scored.by_category())


@click.command(epilog="Example: xden-bench submit preds.npz --signing-key team.key")
@submission_command(f"Folder of the results. [default: {RESULTS}]")
@signing_key_option
@click.option(
    "--archive-url",
    default="",
    metavar="URL",
    help="Where SUBMISSION can be fetched for good. [default: it is copied into the results]",
)
def submit(
    asked: Asked, out: Path | None, as_json: bool, signing_key: Path | None, archive_url: str
) -> None:
    """Score a submission and add it to the results.

    Nothing is written if anything is wrong with it. `xden-bench leaderboard` makes the table.
    """
    from xden_bench.entries.archive import check_url
    from xden_bench.entries.result import write_entry
    from xden_bench.entries.signing import read_signing_key
    from xden_bench.methods.trivial import check_trivial
    from xden_bench.scoring.protocol import load_protocol

    if asked.sealed and out is None:
        raise click.UsageError(
            "The scores of single objects tell their answers: with --sealed give --out, a folder "
            "that stays with the organiser."
        )
    if archive_url:
        check_url(archive_url)
    key = read_signing_key(signing_key) if signing_key else None
    reference = asked.reference()
    refuse_disturbed(reference.folder)
    if out is None:
        refuse_the_sample(reference)
    scored, entry = _scored(asked, reference)
    check_trivial(asked.submission, reference, load_protocol(asked.protocol))
    path = write_entry(
        entry,
        scored,
        out or RESULTS,
        submission=asked.submission,
        archive_url=archive_url,
        key=key,
    )
    standing = standing_of(entry, path)
    if as_json:
        print_json({"file": str(path), "standing": standing, **entry})
    else:
        echo_score(scored)
        click.echo(f"scored on the split {reference.split} of {reference.folder.root}")
        click.echo(standing)
        click.echo(entered(path, out))


def _scored(asked: Asked, reference: Reference) -> tuple[Score, dict[str, Any]]:
    from xden1k.predictions import raise_suspicions
    from xden_bench.entries.result import entry_of
    from xden_bench.methods.trivial import score_told
    from xden_bench.scoring.protocol import load_protocol

    rules = load_protocol(asked.protocol)
    scored = score_told(asked.submission, reference, rules, asked.track, progress_bar)
    if not asked.accept_warnings:
        raise_suspicions(scored.warnings)
    today = datetime.datetime.now(tz=datetime.UTC).date()
    command = command_line(click.get_current_context())
    return scored, entry_of(scored, reference, command=command, date=today)
