"""Register every object of a capture folder: meshes, a table of poses and a page; resumable."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

from xden1k.errors import DataError, MissingObjectError, require
from xden1k.folder.place import expect_free, new_folder
from xden_builder.capture import CaptureFolder
from xden_builder.capture.writing import write_table
from xden_builder.pipeline.align.card import AlignCard
from xden_builder.pipeline.align.kept import write_files
from xden_builder.pipeline.align.object import align_object
from xden_builder.pipeline.align.page import render
from xden_builder.pipeline.resumable import LOCK_NAME, only_run, refuse_to_go_on
from xden_builder.pipeline.storage import beside
from xden_builder.pipeline.version import made_by_checksum
from xden_builder.pipeline.work import load_row
from xden_builder.workers import explain, run_each

__all__ = ["PAGE_NAME", "Alignment", "align_folder"]

PAGE_NAME: Final = "index.html"
TABLE_NAME: Final = "poses.csv"
COLUMNS: Final = (
    *("object_id", "candidate", "loss", "runner_up_loss", "candidates", "equal_poses"),
    *("scale", "flags", "pose"),
)
NOT_IN_PLACES: Final[frozenset[str]] = frozenset({"calibrate", "phantoms"})
"""Rooms that neither meshes nor their pictures depend on."""


@dataclass(frozen=True, slots=True)
class Alignment:
    """What became of every object.

    Parameters
    ----------
    aligned
        Those that were registered, flagged ones first.
    near
        Ids of those that were said to be near their place, and written as they are.
    failures
        Object id and reason of the others.
    digests
        Of the work files, by object id.
    """

    aligned: tuple[AlignCard, ...]
    near: tuple[str, ...]
    failures: tuple[tuple[str, str], ...]
    digests: Mapping[str, str]

    @property
    def need_you(self) -> tuple[AlignCard, ...]:
        """Those that a person must look at."""
        return tuple(card for card in self.aligned if card.flags)

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON."""
        return {
            "schema": "xden-align/1",
            "needs_you": len(self.need_you),
            "objects": [card.to_dict() for card in self.aligned],
            "near": list(self.near),
            "failures": [{"object_id": key, "message": why} for key, why in self.failures],
        }


def align_folder(
    captures: Path,
    out: Path,
    *,
    object_ids: Sequence[str] = (),
    near_too: bool = False,
    parts: Path | None = None,
    workers: int,
    on_start: Callable[[int], None] = lambda _: None,
    on_done: Callable[[str], None] = lambda _: None,
) -> Alignment:
    """Put the meshes of every object into the scanner's frame, into a folder of their own.

    Parameters
    ----------
    captures
        The capture folder, which is left as it is.
    out
        A folder that is empty or does not exist; it appears complete or not at all. Until then
        what is done is kept in ``OUT.align``, for a run that goes on where one was interrupted.
    object_ids
        Only these, if any.
    near_too
        Whether meshes that are said to be near their place are looked for as well; else they are
        written as they are.
    parts
        Other part meshes in place of the annotated ones.
    workers
        Number of processes.
    on_start
        Called with the number of objects.
    on_done
        Called with each object's id as it is done.

    Raises
    ------
    DataError
        If the capture folder as a whole cannot be read, ``out`` is not empty, another run is making
        it, or not one object could be put in place; then nothing is written.
    MissingObjectError
        If one of ``object_ids`` is not in ``objects.csv``.
    OSError
        If the disk is full.
    """
    require("matplotlib", "view")
    require("jinja2", "build")
    folder = _chosen(CaptureFolder(captures.absolute(), parts and parts.absolute()), object_ids)
    expect_free(out)
    work = beside(out.absolute(), ".align")
    assert isinstance(work, Path)
    with only_run(work, out):
        expect_free(out)  # another run may have ended meanwhile
        on_start(len(folder.rows))
        alignment = _gather(folder, work, near_too, workers, on_done)
        if alignment.digests:
            with new_folder(out) as made:
                _write(alignment, work, captures.absolute().name, made)
        for kept in (*work.glob("*.h5"), *work.glob("*.seal")):
            kept.unlink()
    (work / LOCK_NAME).unlink(missing_ok=True)
    with suppress(OSError):  # something of others is in it
        work.rmdir()
    _refuse_nothing(alignment, captures, out)
    return alignment


@dataclass(frozen=True, slots=True)
class _Settings:
    """Whatever changes where meshes are put."""

    near_too: bool

    @property
    def digest(self) -> str:
        """Checksum of the settings."""
        return hashlib.sha256(repr(self).encode()).hexdigest()


def _chosen(folder: CaptureFolder, object_ids: Sequence[str]) -> CaptureFolder:
    """Leave out the rows that nobody asked for."""
    for object_id in object_ids:
        if object_id not in folder.rows:
            raise MissingObjectError(f"{folder.root / 'objects.csv'}: no object {object_id!r}")
    wanted = object_ids or folder.object_ids
    return CaptureFolder(folder.root, folder.parts_root, {key: folder.rows[key] for key in wanted})


def _gather(
    folder: CaptureFolder,
    work: Path,
    near_too: bool,
    workers: int,
    on_done: Callable[[str], None],
) -> Alignment:
    """Take the answers as they come; of an object that failed nothing is kept."""
    cards, near, failures, digests = [], [], [], {}
    made_by = made_by_checksum(_Settings(near_too), NOT_IN_PLACES)
    task = partial(align_object, folder, work, made_by, near_too)
    with closing(run_each(task, folder.object_ids, workers)) as answers:
        for object_id, answer in answers:
            refuse_to_go_on(answer)
            if isinstance(answer, BaseException):
                failures.append((object_id, explain(object_id, answer)))
            else:
                digests[object_id] = answer.digest
                if answer.card is None:
                    near.append(object_id)
                else:
                    cards.append(answer.card)
            on_done(object_id)
    cards.sort(key=lambda card: (not card.flags, card.object_id))
    return Alignment(tuple(cards), tuple(sorted(near)), tuple(sorted(failures)), digests)


def _write(alignment: Alignment, work: Path, name: str, out: Path) -> None:
    """Write what is kept, a table of poses and the page."""
    for object_id, digest in alignment.digests.items():
        row = load_row(work, object_id, digest)
        if row is None:
            raise DataError(f"{object_id}: its file in {work} is gone or has changed")
        write_files(row, out / object_id)
    _write_poses(alignment, out / TABLE_NAME)
    render(alignment.aligned, alignment.failures, name, out / PAGE_NAME)


def _refuse_nothing(alignment: Alignment, captures: Path, out: Path) -> None:
    if not alignment.digests:
        object_id, why = alignment.failures[0]
        raise DataError(
            f"{captures}: no object could be put in place, {out} is not written; the first, "
            f"{object_id}: {why}"
        )


def _write_poses(alignment: Alignment, path: Path) -> None:
    cards = sorted(alignment.aligned, key=lambda card: card.object_id)
    write_table(path, COLUMNS, [_row(card) for card in cards])


def _row(card: AlignCard) -> list[str]:
    runner_up = "" if card.runner_up is None else f"{card.runner_up.loss:.6g}"
    used = card.used
    numbers = f"{used.loss:.6g}", runner_up, str(len(card.candidates)), str(card.equal_poses)
    scale, flags = f"{used.scale:.6g}", " ".join(card.flags)
    return [card.object_id, str(card.chosen), *numbers, scale, flags, used.pose]
