"""``xden-build run``: captures into a dataset folder."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from xden1k.commands import DONE_IN_PART, json_option, print_json
from xden_builder.commands.shared import (
    Progress,
    echo_scanner,
    loading,
    progress_bar,
    resumable,
    workers_option,
)

if TYPE_CHECKING:
    from xden_builder.pipeline.run import BuildReport, Outcome
    from xden_builder.pipeline.storage import Place
    from xden_builder.triage.findings import Findings

__all__ = ["run"]

MOST_LISTED = 30
"""Objects that need someone and are printed; the report has them all."""
MOST_ALIKE = 3
"""Objects that failed for one and the same reason and are printed."""


@click.command(epilog="Example: xden-build run captures --out dataset")
@click.argument("captures")
@click.option("--out", required=True, help="Dataset folder to write.")
@click.option(
    "--model",
    type=click.Choice(["poly", "paper"]),
    default="poly",
    show_default=True,
    help="poly: by the tube's spectrum, with pose and stray light; paper: one constant for all.",
)
@click.option(
    "--filtration",
    type=click.Choice(["fitted", "told"]),
    default="fitted",
    show_default=True,
    help="Whether the beam's filter is fitted to the folder, or as scanner.toml tells.",
)
@click.option(
    "--blind",
    is_flag=True,
    help="Withhold materials, hollow parts and weighed masses: radiographs and meshes alone.",
)
@click.option("--parts", help="Other part meshes in place of the annotated ones.")
@click.option(
    "--outer-only",
    is_flag=True,
    help="Take the parts' outer surface for the object's only part: no annotation is used.",
)
@click.option(
    "--cluster",
    metavar="ADDRESS",
    default="",
    help="Work on the Ray cluster there, in place of processes here.",
)
@workers_option
@json_option
def run(
    captures: str,
    out: str,
    model: Any,
    filtration: Any,
    blind: bool,
    parts: str | None,
    outer_only: bool,
    cluster: str,
    workers: int,
    as_json: bool,
) -> None:
    """Rebuild every object of a capture folder into a dataset folder.

    CAPTURES, --out and --parts are folders, or fsspec URLs such as s3://bucket/captures. Can be
    stopped (Ctrl-C) and started again: finished objects are kept in OUT.work. Exits with 3 if some
    objects failed; they are listed, and in OUT.work/build_report.json. Objects that a person must
    look at are listed with what to do, the worst first; see them with `xden-build report`.
    """
    with loading():
        from xden_builder.pipeline.run import build
        from xden_builder.pipeline.storage import place
        from xden_builder.reconstruct.settings import BuildSettings

    if parts and outer_only:
        raise click.UsageError("--outer-only has no use for --parts: it takes parts for one")
    told = click.get_current_context().get_parameter_source("workers")
    if cluster and told is ParameterSource.COMMANDLINE:
        raise click.UsageError("--workers has no meaning with --cluster: Ray knows its cores")
    with _progress() as progress, redirect_stdout(sys.stderr):  # where Ray tells of lost machines
        report = build(
            place(captures),
            place(out),
            BuildSettings(
                model,
                filtration,
                labels="withheld" if blind else "read",
                geometry="outer" if outer_only else "parts",
            ),
            workers=workers,
            cluster=cluster,
            parts=place(parts) if parts else None,
            on_start=progress.start,
            on_done=progress.add,
            on_asked=progress.ask,
        )
    echo_scanner(captures)
    if as_json:
        print_json(report.to_dict())
    else:
        _echo_report(report, place(out))
    if report.failures:
        raise SystemExit(DONE_IN_PART)


@dataclass(slots=True)
class _Progress(Progress):
    """How many objects there are, are done, and need a person, on a bar."""

    need_you: int = 0
    reasons: Counter[str] = field(default_factory=Counter)

    def ask(self, answered: int, asked: int) -> None:
        """Show how many have told of the beam they share, of how many."""
        self.before = f"asked of their beam: {answered} of {asked}" if answered < asked else ""
        self.bar.set_description(self.before)

    def add(self, outcome: Outcome) -> None:
        if self.before:
            self.ask(0, 0)
        if outcome.needs_you:
            self.need_you += 1
            self.bar.set_postfix_str(f"{self.need_you} need you", refresh=False)
        self.step()
        if outcome.status == "failed":
            self.reasons[outcome.message] += 1
            if self.reasons[outcome.message] <= MOST_ALIKE:
                said = f"failed: {outcome.object_id}: {outcome.message}"
                self.bar.write(said, file=sys.stderr)

    def finish(self) -> None:
        """Say of how many more objects the same was said."""
        for message, count in self.reasons.items():
            if count > MOST_ALIKE:
                said = f"failed: {count - MOST_ALIKE} more: {message}"
                self.bar.write(said, file=sys.stderr)


@contextmanager
def _progress() -> Iterator[_Progress]:
    """Show progress, and in the end of how many more the same was said."""
    with progress_bar() as bar:
        progress = _Progress(bar)
        with resumable(progress):
            try:
                yield progress
            finally:
                progress.finish()


def _echo_report(report: BuildReport, out: Place) -> None:
    from xden_builder.pipeline.run import REPORT_NAME, work_folder
    from xden_builder.pipeline.storage import inside

    grave = [findings for findings in report.judged if findings.severity == "needs_you"]
    for findings in grave[:MOST_LISTED]:
        click.echo(f"needs you: {findings.object_id}: {_what_to_do(findings)}")
    if len(grave) > MOST_LISTED:
        click.echo(f"needs you: {len(grave) - MOST_LISTED} more objects, in the report")
    informed = sum(findings.severity == "information" for findings in report.judged)
    if informed:
        click.echo(f"for information: {informed} of {len(report.judged)} objects have other flags")
    for remark in report.remarks:
        click.echo(str(remark))
    counts = ", ".join(f"{report.count(s)} {s}" for s in ("built", "kept", "failed"))
    click.echo(f"{out}: {counts}; report in {inside(work_folder(out), REPORT_NAME)}")


def _what_to_do(findings: Findings) -> str:
    """Name each grave flag and its remedy; one remedy for the same flag of several parts."""
    return "; ".join(
        f"{', '.join(map(str, remarks))} ({kind.remedy})"
        for kind, remarks in findings.by_kind.items()
        if kind.severity == "needs_you"
    )
