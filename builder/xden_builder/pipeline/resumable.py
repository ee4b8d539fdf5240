"""What every resumable run does: keep others out, gather what workers say, publish it whole."""

from __future__ import annotations

import json
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any, Final, Protocol, TypeVar, runtime_checkable

from xden1k.documents.maintainer import Answers
from xden1k.errors import DataError
from xden1k.folder import exclusive, write_rows
from xden_builder.pipeline.outcomes import REPORT_NAME, BuildReport, Outcome
from xden_builder.pipeline.storage import (
    FULL,
    UNFINISHED,
    Place,
    beside,
    dataset_path,
    inside,
    make_folder,
    read_bytes,
    room_for,
    size_of,
    write_bytes,
)
from xden_builder.pipeline.version import BUILDER, OtherVersionError
from xden_builder.pipeline.work import load_row
from xden_builder.workers import Answer, explain

__all__ = [
    "assemble",
    "gather",
    "maintainers_answers",
    "only_run",
    "refuse_nothing",
    "refuse_to_go_on",
    "work_folder",
    "write_report",
]

LOCK_NAME: Final = "run.lock"
DATA_VERSION: Final = "0.1.0"
"""Of the data a run makes; a release sets its own tag."""


@runtime_checkable
class Named(Protocol):
    """What a worker is asked for."""

    @property
    def object_id(self) -> str:
        """Of which object."""


Asked = TypeVar("Asked", bound=Named)


def work_folder(out: Place) -> Place:
    """Where the work files and the report of a dataset folder are kept."""
    return beside(out, ".work")


@contextmanager
def only_run(work: Place, out: Place) -> Iterator[None]:
    """Make the work folder and keep other runs out of it, where it is a path.

    Raises
    ------
    DataError
        If another run is making the same dataset folder.
    """
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


def gather(
    answers: Generator[Answer[Asked, Outcome], None, None],
    on_done: Callable[[Outcome], None],
) -> tuple[Outcome, ...]:
    """Take the answers as they come, and sort them by id.

    Raises
    ------
    OtherVersionError, OSError
        What would fail the other objects too ends the run: other code on a machine, a full disk.
    """
    outcomes = []
    with closing(answers):
        for asked, answer in answers:
            refuse_to_go_on(answer)
            outcomes.append(_outcome(asked.object_id, answer))
            on_done(outcomes[-1])
    return tuple(sorted(outcomes, key=lambda outcome: outcome.object_id))


def refuse_to_go_on(answer: object) -> None:
    """Raise what would fail all other objects too."""
    full = isinstance(answer, OSError) and answer.errno in FULL
    if isinstance(answer, OtherVersionError) or full:
        assert isinstance(answer, Exception)
        raise answer


def _outcome(object_id: str, answer: Outcome | BaseException) -> Outcome:
    if isinstance(answer, Outcome):
        return answer
    return Outcome(object_id, "failed", explain(object_id, answer))


def refuse_nothing(report: BuildReport, source: object, out: Place) -> None:
    """Refuse to write a dataset folder without an object.

    Raises
    ------
    DataError
        If all failed; it names the first.
    """
    if report.count("failed") == len(report.outcomes):
        first = report.failures[0]
        raise DataError(
            f"{source}: no object could be built, {out} is not written; the first, "
            f"{first.object_id}: {first.message}; all in {inside(work_folder(out), REPORT_NAME)}"
        )


def maintainers_answers(*files: Place) -> Answers:
    """Read a maintainer's answers from the first of some files that is there."""
    for file in files:
        if (content := read_bytes(file)) is not None:
            return Answers.parse(content, file)
    return Answers()


def assemble(
    report: BuildReport, work: Place, out: Place, config_sha256: str, answers: Answers
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
            config_sha256=config_sha256,
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


def write_report(work: Place, report: BuildReport) -> None:
    """Write what became of the objects beside their work files."""
    text = json.dumps(report.to_dict(), indent=2, ensure_ascii=False) + "\n"
    write_bytes(inside(work, REPORT_NAME), text.encode())
