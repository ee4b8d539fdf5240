"""``xden-build mend``: part meshes made solids where there is one way to do it."""

from __future__ import annotations

from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

import click

from xden1k.commands import DONE_IN_PART, json_option, print_json
from xden_builder.commands.shared import FOLDER, progress_bar, workers_option

if TYPE_CHECKING:
    from xden_builder.pipeline.mend import Mending

__all__ = ["mend"]


@click.command(epilog="Example: xden-build mend captures --out mended")
@click.argument("captures", type=FOLDER)
@click.option("--out", type=FOLDER, required=True, help="New folder to write.")
@workers_option
@json_option
def mend(captures: Path, out: Path, workers: int, as_json: bool) -> None:
    """Close part meshes that bound no solid.

    Vertices of nearly one place are joined, triangles that are there twice or loose left out, those
    wound against their neighbours turned over, and holes closed if they are flat, or less than
    0.04 % of the surface. Writes the meshes of all objects (OBJECT_ID/parts, for `xden-build run
    --parts`) and a table of what was done (mended.csv); the captures stay as they are. Exits with 3
    if an object could not be mended.
    """
    from xden_builder.capture import CaptureFolder
    from xden_builder.pipeline.mend import mend_folder

    with progress_bar(len(CaptureFolder(captures).object_ids)) as bar:
        mending = mend_folder(captures, out, workers=workers, on_done=lambda _: bar.update())
    if as_json:
        print_json(mending.to_dict())
    else:
        _echo(mending, captures, out)
    if mending.failures:
        raise SystemExit(DONE_IN_PART)


def _echo(mending: Mending, captures: Path, out: Path) -> None:
    for object_id, why in mending.failures:
        click.echo(f"failed: {object_id}: {why}", err=True)
    for object_id, part in mending.parts:
        look = " (look whether it ended there)" if part.wide else ""
        click.echo(f"{object_id}, {part.name}: {'; '.join(part.deeds)}{look}")
    count = len(mending.objects) - len(mending.sound)
    objects = "1 object" if count == 1 else f"{count} objects"
    click.echo(
        f"{out}: {objects} mended, {len(mending.sound)} sound, {len(mending.failures)} failed; "
        f"go on with `xden-build run {quote(str(captures))} --parts {quote(str(out))}`"
    )
