"""``xden-build check``: what is wrong with captures, before an hour of fitting."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from xden1k.commands import json_option, print_json
from xden_builder.commands.shared import (
    FOLDER,
    echo_scanner,
    loading,
    parts_option,
    progress_bar,
    workers_option,
)

if TYPE_CHECKING:
    from xden_builder.pipeline.check.run import FolderCheck

__all__ = ["check"]

MOST_NAMED: Final = 3
"""Objects of which the same is said."""


@click.command(epilog="Example: xden-build check captures")
@click.argument("captures", type=FOLDER)
@parts_option
@workers_option
@json_option
def check(captures: Path, parts: Path | None, workers: int, as_json: bool) -> None:
    """Say what a rebuild would refuse, and what cannot all be true.

    Reads every capture as a rebuild does, and compares outlines with shadows, pictures with each
    other, meshes with each other, and weighed masses with volumes and materials. Nothing is fitted,
    but for the pose of meshes that lie in a frame of their own, and nothing written. Exits with 1
    if anything is wrong.
    """
    with loading():
        from xden_builder.capture import CaptureFolder
        from xden_builder.pipeline.check.run import check_folder

    with progress_bar(len(CaptureFolder(captures).object_ids)) as bar:
        report = check_folder(
            captures, parts=parts, workers=workers, on_done=lambda _: bar.update()
        )
    echo_scanner(str(captures))
    if as_json:
        print_json(report.to_dict())
    else:
        _echo(report, captures)
    if not report.clean:
        raise SystemExit(1)


def _echo(report: FolderCheck, captures: Path) -> None:
    for finding, object_ids in report.by_finding.items():
        click.echo(f"{finding.kind}: {_named(object_ids)}: {finding.message}")
    for said in report.remarks:
        click.echo(f"contradicts: {captures}: {said}")
    sound = sum(not each.findings for each in report.objects)
    together = "; together they contradict what was told" if report.remarks else ""
    click.echo(
        f"{captures}: {len(report.objects)} objects, {sound} sound, {report.count('refused')} "
        f"refused, {report.count('contradicts')} contradicting themselves{together}"
    )


def _named(object_ids: Sequence[str]) -> str:
    """Name objects, a few of many."""
    named = ", ".join(object_ids[:MOST_NAMED])
    more = len(object_ids) - MOST_NAMED
    return f"{named} and {more} more" if more > 0 else named
