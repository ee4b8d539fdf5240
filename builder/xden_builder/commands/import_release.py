"""``xden import``, also ``xden-build import``: the authors' release into a dataset folder."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from xden1k.commands import DONE_IN_PART, json_option, print_json
from xden_builder.commands.shared import FOLDER, progress_bar, workers_option

if TYPE_CHECKING:
    from xden_builder.pipeline.outcomes import BuildReport, Outcome
    from xden_builder.published.importing import Plan

__all__ = ["import_release"]

FILE = click.Path(path_type=Path, dir_okay=False, exists=True)


@click.command("import", epilog="Example: xden import zhangjxx/XDen-1K --dry-run")
@click.argument("source")
@click.option("--out", metavar="ROOT", type=FOLDER, help="Dataset folder to write.")
@click.option("--dry-run", is_flag=True, help="Say what is there, and write nothing.")
@click.option("--objects", default="", metavar="0-39", help="Only these, by their folders.")
@click.option("--revision", metavar="TAG", help="Tag or commit of a repository; else the newest.")
@click.option(
    "--size-unit",
    type=click.Choice(["cm", "mm", "m"]),
    help="Of the sizes in metadata.json. Default: cm, checked.",
)
@click.option("--splits", type=FILE, help="Table of object_id and split, in place of drawn ones.")
@click.option("--map", "roles", type=FILE, help="TOML that says which file is what.")
@click.option("--keep-work", is_flag=True, help="Keep the work files when all is done.")
@click.option(
    "--cluster", metavar="ADDRESS", default="", help="Work on the Ray cluster there, not here."
)
@workers_option
@json_option
def import_release(
    source: str,
    out: Path | None,
    dry_run: bool,
    workers: int,
    cluster: str,
    as_json: bool,
    keep_work: bool,
    **asked: Any,
) -> None:
    """Turn the authors' release into a dataset folder, with densities of our own.

    SOURCE is a folder above the objects' folders, or a repository of the Hub, such as
    zhangjxx/XDen-1K, of which only the needed files are fetched. Begin with --dry-run: it says what
    is there and what is not as expected. Can be stopped and started again: what is finished is kept
    in OUT.work. Exits with 3 if some objects failed; they are listed.
    """
    from xden_builder.published.importing import look, plan

    told = click.get_current_context().get_parameter_source("workers")
    if cluster and told is ParameterSource.COMMANDLINE:
        raise click.UsageError("--workers has no meaning with --cluster: Ray knows its cores")
    if out is None and not dry_run:
        raise click.UsageError("give --out ROOT, or --dry-run")
    if dry_run or out is None:
        seen = look(source, **asked)
        print_json(seen.to_dict()) if as_json else click.echo(seen.text)
        raise SystemExit(DONE_IN_PART if seen.mismatches else 0)
    planned = plan(source, **asked)
    click.echo(planned.told, err=True)
    report = _run(planned, out, workers=workers, cluster=cluster, keep_work=keep_work)
    if as_json:
        print_json(report.to_dict())
    else:
        _echo(report, out)
    if report.failures:
        raise SystemExit(DONE_IN_PART)


def _run(planned: Plan, out: Path, **how: Any) -> BuildReport:
    """Import, with a bar that counts each object twice: asked, and made."""
    with progress_bar(2 * planned.count) as bar:

        def add(outcome: Outcome) -> None:
            bar.update()
            if outcome.status == "failed":
                bar.write(f"failed: {outcome.object_id}: {outcome.message}", file=sys.stderr)

        return planned.run(out, on_surveyed=lambda _: bar.update(), on_done=add, **how)


def _echo(report: BuildReport, out: Path) -> None:
    from xden1k.folder import open_folder
    from xden_builder.published.compare import change_table, mass_changes

    click.echo(change_table(mass_changes(open_folder(out))))
    counts = ", ".join(f"{report.count(status)} {status}" for status in ("built", "kept", "failed"))
    click.echo(f"{out}: {counts}; fit of the release and report in {out}.work")
