"""The report of a dataset folder: ``index.html`` and ``objects.csv``, the worst object first."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

from xden1k.errors import DataError, require
from xden1k.folder import open_folder
from xden1k.folder.place import publish, staging
from xden_builder.triage.card import make_card
from xden_builder.triage.page import is_report, render
from xden_builder.triage.remarks import FolderRemark
from xden_builder.triage.table import table
from xden_builder.workers import gather

__all__ = ["Report", "write_report"]

PAGE_NAME: Final = "index.html"
TABLE_NAME: Final = "objects.csv"

Failures = Sequence[tuple[str, str]]


@dataclass(frozen=True, slots=True)
class Report:
    """What a report shows.

    Parameters
    ----------
    page
        The file to open.
    objects, need_you
        How many there are, and how many of them a person must look at.
    not_shown
        Object id and reason of those that could not be drawn.
    """

    page: Path
    objects: int
    need_you: int
    not_shown: tuple[tuple[str, str], ...]

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON."""
        return {
            "page": str(self.page),
            "objects": self.objects,
            "needs_you": self.need_you,
            "not_shown": [{"object_id": key, "message": why} for key, why in self.not_shown],
        }


def write_report(
    root: Path,
    out: Path,
    *,
    workers: int,
    not_built: Failures = (),
    remarks: Sequence[FolderRemark] = (),
    on_done: Callable[[str], None] = lambda _: None,
) -> Report:
    """Write the report of a dataset folder; an older report there is replaced as a whole.

    Parameters
    ----------
    root
        The dataset folder.
    out
        Folder to write.
    workers
        Number of processes.
    not_built
        Object id and reason of captures that the last run could not build. Where all of them are
        such, it has left the dataset as it was, and the page says so.
    remarks
        What all objects show together.
    on_done
        Called with each object's id as it is done.

    Raises
    ------
    DataError
        If ``root`` is not a dataset folder, or something else than a report is at ``out``.
    MissingExtraError
        If matplotlib, numba or Jinja are not installed.
    """
    require("matplotlib", "view")
    require("jinja2", "build")
    require("numba", "build")
    _refuse_other_folders(out)
    task = partial(make_card, root)
    object_ids = open_folder(root).ids()
    older = [each for each in not_built if each[0] in {*object_ids}]
    if older:
        not_built = [each for each in not_built if each not in older]
        remarks = [*remarks, _of_an_older_run(older)]
    made, not_shown = gather(task, object_ids, workers, on_done)
    cards = sorted(made.values(), key=lambda card: (card.findings.order, card.findings.object_id))
    failures = sorted([*not_built, *not_shown])
    out.parent.mkdir(parents=True, exist_ok=True)
    with staging(out) as beside:
        folder = beside / "report"
        folder.mkdir()
        render(cards, failures, remarks, root.name, folder / PAGE_NAME)
        table(cards).to_csv(folder / TABLE_NAME, index=False)
        publish(folder, out)
    need_you = sum(card.findings.severity == "needs_you" for card in cards)
    return Report(out / PAGE_NAME, len(cards), need_you, tuple(not_shown))


def _of_an_older_run(not_built: Failures) -> FolderRemark:
    """Say that objects are shown as an earlier run left them."""
    object_id, why = not_built[0]
    return FolderRemark(
        "needs_you",
        f"the last run could not build {len(not_built)} of the objects below, which are shown as "
        f"an earlier one left them: the first, {object_id}: {why}",
    )


def _refuse_other_folders(out: Path) -> None:
    """Check that nothing would be lost that is not a report."""
    if not out.exists():
        return
    names = {path.name for path in out.iterdir()} if out.is_dir() else {out.name}
    if names and (names != {PAGE_NAME, TABLE_NAME} or not is_report(out / PAGE_NAME)):
        raise DataError(f"{out} is not a report: remove it yourself, or choose another")
