"""Rebuild a folder of captures: resumable, on one machine or many, stopped by no bad object.

Finished objects are kept as work files beside the result (``OUT.work/``). A rerun makes only what
is missing or changed; the dataset folder itself appears complete or not at all.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

from xden1k.documents.maintainer import ANSWERS_NAME, Answers
from xden1k.errors import DataError
from xden1k.folder import exclusive, write_rows
from xden1k.format.records import object_row
from xden1k.values.plain import plain
from xden_builder.capture import ObjectRow
from xden_builder.pipeline.beam import shared_beam, with_beam
from xden_builder.pipeline.cluster import run_on_cluster
from xden_builder.pipeline.splits import with_splits
from xden_builder.pipeline.storage import (
    FULL,
    UNFINISHED,
    Place,
    absolute,
    beside,
    dataset_path,
    inside,
    make_folder,
    object_capture,
    object_rows,
    read_bytes,
    refuse_other_folders,
    room_for,
    size_of,
    write_bytes,
)
from xden_builder.pipeline.version import (
    BUILDER,
    OtherVersionError,
    made_by_checksum,
    refuse_other_code,
)
from xden_builder.pipeline.work import load_row, save_row
from xden_builder.poly.hardness import Hardness
from xden_builder.reconstruct.object import reconstruct
from xden_builder.reconstruct.settings import BuildSettings
from xden_builder.triage.findings import Findings, find
from xden_builder.workers import Answer, explain, run_each

__all__ = [
    "REPORT_NAME",
    "BuildReport",
    "Outcome",
    "build",
    "work_folder",
]

REPORT_NAME = "build_report.json"
LOCK_NAME = "run.lock"
DATA_VERSION = "0.1.0"
"""Of the data a rebuild makes; a release sets its own tag."""

Status = Literal["built", "kept", "failed"]


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one object.

    Parameters
    ----------
    object_id
        Which.
    status
        ``built`` now, ``kept`` from an earlier run, or ``failed``.
    message
        Why it failed; empty otherwise.
    findings
        Flags and numbers by which the object is judged; None if it failed.
    seconds
        Wall time in the worker.
    digest
        Checksum of all it was made from; empty if it failed.
    """

    object_id: str
    status: Status
    message: str = ""
    findings: Findings | None = None
    seconds: float = 0.0
    digest: str = ""

    @property
    def needs_you(self) -> bool:
        """Whether a person must look: it failed, or its gravest flag says so."""
        return self.findings is None or self.findings.severity == "needs_you"

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON."""
        found = {"severity": "needs_you"} if self.findings is None else self.findings.to_dict()
        return {
            "object_id": self.object_id,
            "status": self.status,
            "message": self.message,
            **found,
            "seconds": self.seconds,
            "digest": self.digest,
        }


@dataclass(frozen=True, slots=True)
class BuildReport:
    """What became of every object of a rebuild, sorted by id, and the beam that was found."""

    outcomes: tuple[Outcome, ...]
    beam: Hardness | None = None

    def count(self, status: Status) -> int:
        """How many objects ended so."""
        return sum(outcome.status == status for outcome in self.outcomes)

    @property
    def failures(self) -> tuple[Outcome, ...]:
        """The objects that failed."""
        return tuple(outcome for outcome in self.outcomes if outcome.status == "failed")

    @property
    def judged(self) -> tuple[Findings, ...]:
        """Findings of the objects that are there, the worst first."""
        found = [outcome.findings for outcome in self.outcomes if outcome.findings is not None]
        return tuple(sorted(found, key=lambda findings: findings.order))

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON."""
        counts = {status: self.count(status) for status in ("built", "kept", "failed")}
        values: dict[str, Any] = plain(
            {
                "schema": "xden-build-report/2",
                "builder": BUILDER,
                **counts,
                "beam": None if self.beam is None else asdict(self.beam),
                "needs_you": sum(outcome.needs_you for outcome in self.outcomes),
                "objects": [outcome.to_dict() for outcome in self.outcomes],
            }
        )
        return values


def build(
    captures: Place,
    out: Place,
    settings: BuildSettings,
    *,
    workers: int,
    cluster: str = "",
    parts: Place | None = None,
    on_start: Callable[[int], None] = lambda _: None,
    on_done: Callable[[Outcome], None] = lambda _: None,
) -> BuildReport:
    """Rebuild every object of a capture folder into a dataset folder.

    Parameters
    ----------
    captures
        The capture folder.
    out
        The dataset folder to write; an older one is replaced as a whole, but keeps its maintainer's
        answers where there are none beside the captures. ``build_report.json``
        and the work files go to ``OUT.work`` beside it.
    settings
        How to rebuild.
    workers
        Number of processes.
    cluster
        Address of a Ray cluster, which then does the work in place of processes here. It must see
        the paths given; what it does not see can be URLs.
    parts
        Other part meshes, ``PARTS/OBJECT_ID/parts``, in place of the annotated ones.
    on_start
        Called with the number of objects.
    on_done
        Called with each outcome as it comes.

    Raises
    ------
    DataError
        If the capture folder as a whole is not readable, ``out`` is something else than a dataset
        folder, another run is making it, or not one object could be built; then nothing is written
        to ``out``.
    OtherVersionError
        If a machine of the cluster has other code than this one.
    OSError
        If a disk is full: at once, with what is finished kept for a rerun.
    """
    stated = object_rows(captures)
    if isinstance(parts, Path) and not parts.is_dir():
        raise DataError(f"{parts}: no such folder of part meshes")
    refuse_other_folders(out)
    work = work_folder(out)
    made_by = made_by_checksum(settings)
    seen = absolute(captures), None if parts is None else absolute(parts), absolute(work)
    here, there = partial(run_each, workers=workers), partial(run_on_cluster, address=cluster)
    run = there if cluster else here
    asked, beam = settings, None
    with _only_run(work, out):
        said = _answers(captures, out)
        rows = with_splits(captures, stated)
        on_start(len(rows))
        if settings.model == "poly" and settings.filtration == "fitted":
            beam = shared_beam(rows, settings, made_by, seen, run)
            settings = with_beam(settings, beam)
        task = partial(_build_object, settings, made_by_checksum(settings), *seen)
        report = replace(_gather(run(task, rows.values()), on_done), beam=beam)
        _write_report(work, report)
        _refuse_nothing(report, captures, out)
        _assemble(report, work, out, asked, said)
    return report


def work_folder(out: Place) -> Place:
    """Where the work files and the report of a dataset folder are kept."""
    return beside(out, ".work")


@contextmanager
def _only_run(work: Place, out: Place) -> Iterator[None]:
    """Make the work folder and keep other runs out of it, where it is a path."""
    make_folder(work)
    with ExitStack() as stack:
        if isinstance(work, Path):
            try:
                stack.enter_context(exclusive(work / LOCK_NAME))
            except BlockingIOError as err:
                raise DataError(f"{out}: another run is making it") from err
            for left in work.glob(f"*{UNFINISHED}"):  # by runs that were killed
                left.unlink(missing_ok=True)
        yield


def _build_object(
    settings: BuildSettings,
    made_by: str,
    captures: Place,
    parts: Place | None,
    work: Place,
    asked: ObjectRow,
) -> Outcome:
    """Build one object in a worker process, unless it is kept from before."""
    refuse_other_code(settings, made_by)
    start = time.perf_counter()
    object_id = asked.object_id
    with object_capture(captures, parts, asked) as folder:
        digest = hashlib.sha256(f"{made_by}\n{folder.digest(object_id)}".encode()).hexdigest()
        row = load_row(work, object_id, digest)
        status: Status = "kept"
        if row is None:
            status = "built"
            row = object_row(reconstruct(folder.read(object_id), settings))
            save_row(work, object_id, digest, row)
    seconds = time.perf_counter() - start
    return Outcome(object_id, status, "", find(row), seconds, digest)


def _gather(
    answers: Generator[Answer[ObjectRow, Outcome], None, None],
    on_done: Callable[[Outcome], None],
) -> BuildReport:
    """Take the answers as they come; what would fail the other objects too ends the run."""
    outcomes = []
    with closing(answers):
        for row, answer in answers:
            if isinstance(answer, OtherVersionError):
                raise answer
            if isinstance(answer, OSError) and answer.errno in FULL:
                raise answer
            outcomes.append(_outcome(row.object_id, answer))
            on_done(outcomes[-1])
    return BuildReport(tuple(sorted(outcomes, key=lambda outcome: outcome.object_id)))


def _outcome(object_id: str, answer: Outcome | BaseException) -> Outcome:
    if isinstance(answer, Outcome):
        return answer
    return Outcome(object_id, "failed", explain(object_id, answer))


def _refuse_nothing(report: BuildReport, captures: Place, out: Place) -> None:
    if report.count("failed") == len(report.outcomes):
        first = report.failures[0]
        raise DataError(
            f"{captures}: no object could be built, {out} is not written; the first, "
            f"{first.object_id}: {first.message}; all in {inside(work_folder(out), REPORT_NAME)}"
        )


def _answers(captures: Place, out: Place) -> Answers:
    """Read a maintainer's answers: those beside the captures, else those of the older dataset."""
    for file in (inside(captures, ANSWERS_NAME), inside(out, ANSWERS_NAME)):
        if (content := read_bytes(file)) is not None:
            return Answers.parse(content, file)
    return Answers()


def _assemble(
    report: BuildReport, work: Place, out: Place, settings: BuildSettings, answers: Answers
) -> None:
    """Make the dataset folder of the work files."""
    with (
        dataset_path(out) as folder,
        room_for(f"the dataset {folder.name}", folder.absolute().parent, lambda: size_of(work)),
    ):
        write_rows(
            _rows(report, work),
            folder,
            version=DATA_VERSION,
            builder=BUILDER,
            config_sha256=settings.digest,
            answers=answers,
        )


def _rows(report: BuildReport, work: Place) -> Iterator[Mapping[str, Any]]:
    """Rows of the objects that are there, sorted by id."""
    for outcome in report.outcomes:
        if outcome.status != "failed":
            row = load_row(work, outcome.object_id, outcome.digest)
            if row is None:
                raise DataError(
                    f"{outcome.object_id}: its file in {work} is gone or has changed; does every "
                    "worker see this folder?"
                )
            yield row


def _write_report(work: Place, report: BuildReport) -> None:
    text = json.dumps(report.to_dict(), indent=2, ensure_ascii=False) + "\n"
    write_bytes(inside(work, REPORT_NAME), text.encode())
