"""``xden-build report``: what needs a person, as one page."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from xden1k.commands import DONE_IN_PART, LOCAL_ROOT, json_option, print_json
from xden_builder.commands.shared import FOLDER, progress_bar, workers_option

__all__ = ["report"]


@click.command(epilog="Example: xden-build report dataset")
@click.argument("root", type=LOCAL_ROOT)
@click.option("-o", "--out", type=FOLDER, help="Folder to write; ROOT.report by default.")
@workers_option
@json_option
def report(root: Path, out: Path | None, workers: int, as_json: bool) -> None:
    """Show a rebuilt dataset on one page, the worst object first.

    Writes index.html, which needs nothing else and opens in any browser, and objects.csv with the
    same figures. What the last `xden-build run` could not build, and what it said of all objects
    together, stands first, if ROOT.work is still there. Exits with 3 if an object could not be
    drawn.
    """
    from xden1k.folder import open_folder
    from xden_builder.triage.remarks import FolderRemark
    from xden_builder.triage.report import write_report

    root = root.absolute()
    last_run = _last_run(root)
    with progress_bar(len(open_folder(root).ids())) as bar:
        written = write_report(
            root,
            out or root.with_name(f"{root.name}.report"),
            workers=workers,
            not_built=_not_built(last_run),
            remarks=[
                FolderRemark(each["severity"], each["text"]) for each in last_run.get("remarks", [])
            ],
            on_done=lambda _: bar.update(),
        )
    if as_json:
        print_json(written.to_dict())
    else:
        click.echo(f"{written.page}: {written.need_you} of {written.objects} objects need you")
        for object_id, why in written.not_shown:
            click.echo(f"failed: {object_id}: {why}", err=True)
    if written.not_shown:
        raise SystemExit(DONE_IN_PART)


def _last_run(root: Path) -> dict[str, Any]:
    """Return what the last run said of all objects; nothing where its report is gone."""
    from xden_builder.pipeline.run import REPORT_NAME, work_folder
    from xden_builder.pipeline.storage import inside, read_bytes

    content = read_bytes(inside(work_folder(root), REPORT_NAME))
    values: dict[str, Any] = {} if content is None else json.loads(content)
    return values


def _not_built(last_run: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return what could not be built, and why."""
    objects = last_run.get("objects", [])
    return [(each["object_id"], each["message"]) for each in objects if each["status"] == "failed"]
