"""``xden-build align``: meshes into the scanner's frame, and nothing more."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from xden1k.commands import DONE_IN_PART, json_option, print_json
from xden_builder.commands.shared import (
    FOLDER,
    Progress,
    loading,
    names_in,
    parts_option,
    progress_bar,
    resumable,
    workers_option,
)

if TYPE_CHECKING:
    from xden_builder.pipeline.align.run import Alignment

__all__ = ["align"]


@click.command(epilog="Example: xden-build align captures --out aligned")
@click.argument("captures", type=FOLDER)
@click.option("--out", type=FOLDER, required=True, help="New folder to write.")
@click.option("--objects", default="", help="Only these, separated by commas.")
@click.option("--all", "near_too", is_flag=True, help="Meshes whose pose is near as well.")
@parts_option
@workers_option
@json_option
def align(
    captures: Path,
    out: Path,
    objects: str,
    near_too: bool,
    parts: Path | None,
    workers: int,
    as_json: bool,
) -> None:
    """Find where meshes in any frame stand before the scanner.

    Writes the meshes in the scanner's frame (OBJECT_ID/parts, for `xden-build run --parts`), a
    table of their poses (poses.csv), and index.html, a page with their outlines over the
    radiographs, before and after, and the runners-up. Meshes whose pose is near are written as
    they are. Can be stopped (Ctrl-C) and started again: what is done is kept in OUT.align until OUT
    is there. Exits with 3 if an object could not be put in place.
    """
    with loading():
        from xden_builder.pipeline.align.run import align_folder

    with progress_bar() as bar, resumable(progress := Progress(bar)):
        alignment = align_folder(
            captures,
            out,
            object_ids=names_in(objects),
            near_too=near_too,
            parts=parts,
            workers=workers,
            on_start=progress.start,
            on_done=lambda _: progress.step(),
        )
    if as_json:
        print_json(alignment.to_dict())
    else:
        _echo(alignment, out)
    if alignment.failures:
        raise SystemExit(DONE_IN_PART)


def _echo(alignment: Alignment, out: Path) -> None:
    from xden_builder.pipeline.align.run import PAGE_NAME

    for object_id, why in alignment.failures:
        click.echo(f"failed: {object_id}: {why}", err=True)
    for card in alignment.need_you:
        said = "; ".join(f"{kind.flag} ({kind.remedy})" for kind in card.remarks)
        click.echo(f"needs you: {card.object_id}: {said}")
    counts = {
        "put in place": len(alignment.aligned),
        "near as told": len(alignment.near),
        "failed": len(alignment.failures),
    }
    told = ", ".join(f"{count} {words}" for words, count in counts.items())
    click.echo(f"{out / PAGE_NAME}: {told}")
