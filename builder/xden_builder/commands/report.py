"""``xden-build report``: what needs a person, as one page."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, get_args

import click

from xden1k.commands import DONE_IN_PART, LOCAL_ROOT, json_option, print_json
from xden_builder.commands.shared import FOLDER, progress_bar, workers_option

if TYPE_CHECKING:
    from xden_builder.triage.remarks import FolderRemark

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
    from xden_builder.triage.report import write_report

    root = root.absolute()
    not_built, remarks = _last_run(root)
    with progress_bar(len(open_folder(root).ids())) as bar:
        written = write_report(
            root,
            out or root.with_name(f"{root.name}.report"),
            workers=workers,
            not_built=not_built,
            remarks=remarks,
            on_done=lambda _: bar.update(),
        )
    if as_json:
        print_json(written.to_dict())
    else:
        unseen = {"could not be drawn": written.not_shown, "failed in the last run": not_built}
        more = "".join(f"; {len(each)} {what}" for what, each in unseen.items() if each)
        need = f"{written.need_you} of {written.objects} objects need you"
        click.echo(f"{written.page}: {need}{more}")
        for object_id, why in written.not_shown:
            click.echo(f"failed: {object_id}: {why}", err=True)
    if written.not_shown:
        raise SystemExit(DONE_IN_PART)


def _last_run(root: Path) -> tuple[list[tuple[str, str]], list[FolderRemark]]:
    """Return what the last run could not build and why, and what it said of all objects.

    Nothing where its report is gone; where that cannot be read, a line says so.
    """
    from xden_builder.pipeline.outcomes import REPORT_SCHEMA
    from xden_builder.pipeline.run import REPORT_NAME, work_folder
    from xden_builder.pipeline.storage import inside, read_bytes
    from xden_builder.triage.flags import Severity
    from xden_builder.triage.remarks import FolderRemark

    path = inside(work_folder(root), REPORT_NAME)
    if (content := read_bytes(path)) is None:
        return [], []
    try:
        values = json.loads(content)
        if values["schema"] != REPORT_SCHEMA:
            raise ValueError(values["schema"])
        failed = [each for each in values["objects"] if each["status"] == "failed"]
        not_built = [(str(each["object_id"]), str(each["message"])) for each in failed]
        remarks = [FolderRemark(each["severity"], str(each["text"])) for each in values["remarks"]]
        if not {each.severity for each in remarks} <= {*get_args(Severity)}:
            raise ValueError(remarks)
    except (ValueError, KeyError, TypeError, RecursionError):
        click.echo(
            f"{path}: expected {REPORT_SCHEMA}, got something else or a damaged file: the page "
            "says nothing of what the last run could not build",
            err=True,
        )
        return [], []
    return not_built, remarks
