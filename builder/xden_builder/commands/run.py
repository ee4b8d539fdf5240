"""``xden-build run``: captures into a dataset folder."""

from __future__ import annotations

import sys
from contextlib import redirect_stdout
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from xden1k.commands import DONE_IN_PART, json_option, print_json
from xden_builder.commands.shared import progress_bar, workers_option

if TYPE_CHECKING:
    from xden_builder.pipeline.run import BuildReport, Outcome
    from xden_builder.pipeline.storage import Place

__all__ = ["run"]

MOST_FLAGGED = 30
"""Objects whose flags are printed; the report has them all."""


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
@click.option("--parts", help="Other part meshes in place of the annotated ones.")
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
    parts: str | None,
    cluster: str,
    workers: int,
    as_json: bool,
) -> None:
    """Rebuild every object of a capture folder into a dataset folder.

    CAPTURES, --out and --parts are folders, or fsspec URLs such as s3://bucket/captures. Can be
    stopped and started again: finished objects are kept in OUT.work. Exits with 3 if some objects
    failed; they are listed, and in OUT.work/build_report.json.
    """
    from xden_builder.pipeline.run import build
    from xden_builder.pipeline.storage import place
    from xden_builder.reconstruct.settings import BuildSettings

    told = click.get_current_context().get_parameter_source("workers")
    if cluster and told is ParameterSource.COMMANDLINE:
        raise click.UsageError("--workers has no meaning with --cluster: Ray knows its cores")
    with progress_bar() as bar, redirect_stdout(sys.stderr):  # where Ray tells of lost machines

        def on_done(outcome: Outcome) -> None:
            bar.update()
            if outcome.status == "failed":
                bar.write(f"failed: {outcome.object_id}: {outcome.message}", file=sys.stderr)

        report = build(
            place(captures),
            place(out),
            BuildSettings(model=model),
            workers=workers,
            cluster=cluster,
            parts=place(parts) if parts else None,
            on_start=bar.reset,
            on_done=on_done,
        )
    if as_json:
        print_json(report.to_dict())
    else:
        _echo_report(report, place(out))
    if report.failures:
        raise SystemExit(DONE_IN_PART)


def _echo_report(report: BuildReport, out: Place) -> None:
    from xden_builder.pipeline.run import REPORT_NAME, work_folder
    from xden_builder.pipeline.storage import inside

    flagged = [outcome for outcome in report.outcomes if outcome.flags]
    for outcome in flagged[:MOST_FLAGGED]:
        click.echo(f"flagged: {outcome.object_id}: {', '.join(outcome.flags)}")
    if len(flagged) > MOST_FLAGGED:
        click.echo(f"flagged: {len(flagged) - MOST_FLAGGED} more objects, in the report")
    counts = ", ".join(f"{report.count(s)} {s}" for s in ("built", "kept", "failed"))
    click.echo(f"{out}: {counts}; report in {inside(work_folder(out), REPORT_NAME)}")
