"""Import a release into a dataset folder: resumable, on one machine or many, in two passes.

First every object says what it knows of the whole (:class:`Survey`), then the release is fitted,
then every object is made with that fit. What is finished is kept in ``OUT.work/``; a rerun makes
only what is missing or changed. The dataset folder appears complete or not at all.
"""

from __future__ import annotations

import gc
import hashlib
import json
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

from xden1k.documents.maintainer import ANSWERS_NAME
from xden1k.errors import DataError
from xden1k.format.records import object_row
from xden1k.values.cost import Meter
from xden1k.values.types import Split
from xden_builder.pipeline.cluster import run_on_cluster
from xden_builder.pipeline.outcomes import BuildReport, Outcome, Status
from xden_builder.pipeline.resumable import (
    assemble,
    gather,
    maintainers_answers,
    only_run,
    refuse_nothing,
    refuse_to_go_on,
    work_folder,
    write_report,
)
from xden_builder.pipeline.storage import inside, read_bytes, refuse_other_folders, write_bytes
from xden_builder.pipeline.version import made_by_checksum, refuse_other_code
from xden_builder.pipeline.work import load_row, save_row
from xden_builder.published.given import PublishedObject
from xden_builder.published.object import import_object
from xden_builder.published.radiographs import with_radiographs
from xden_builder.published.reading import Item, read_item
from xden_builder.published.release_fit import ReleaseFit, fit_release
from xden_builder.published.survey import Survey, survey_object
from xden_builder.triage.findings import find
from xden_builder.workers import Answer, run_each

__all__ = ["FIT_NAME", "ImportSettings", "import_items"]

FIT_NAME: Final = "release_fit.json"
SURVEY: Final = ".survey.json"
"""Ending of what an object says of the whole."""

Run = Callable[[Callable[[Item], Any], Iterable[Item]], Generator[Answer[Item, Any], None, None]]


@dataclass(frozen=True, slots=True)
class ImportSettings:
    """What changes the result beside the files themselves.

    Parameters
    ----------
    scanner
        A ``scanner.toml`` by which images of the release are radiographs; None: none is.
    """

    scanner: Path | None = None

    @property
    def digest(self) -> str:
        """Checksum of the settings."""
        content = b"" if self.scanner is None else self.scanner.read_bytes()
        return hashlib.sha256(content).hexdigest()


@dataclass(frozen=True, slots=True)
class _Task:
    """What every worker is told.

    Parameters
    ----------
    settings
        Of the import.
    made_by
        Checksum of these and of the code.
    work
        Folder of the work files.
    """

    settings: ImportSettings
    made_by: str
    work: Path

    def digest(self, item: Item, *more: str) -> str:
        """Checksum of all that one result is made of."""
        refuse_other_code(self.settings, self.made_by)
        told = "\n".join((self.made_by, item.digest, *more))
        return hashlib.sha256(told.encode()).hexdigest()


def import_items(
    items: Sequence[Item],
    splits: Mapping[str, Split],
    out: Path,
    settings: ImportSettings,
    *,
    source: str,
    workers: int,
    cluster: str = "",
    keep_work: bool = False,
    on_surveyed: Callable[[str], None] = lambda _: None,
    on_done: Callable[[Outcome], None] = lambda _: None,
) -> BuildReport:
    """Make a dataset folder of published objects.

    Parameters
    ----------
    items
        What to read, sorted by object id.
    splits
        By object id.
    out
        The dataset folder to write; an older one is replaced as a whole, but keeps its maintainer's
        answers. ``build_report.json``, :data:`FIT_NAME` and the work files go to ``OUT.work``.
    settings
        How to import.
    source
        What a person calls the release, for messages.
    workers
        Number of processes.
    cluster
        Address of a Ray cluster, which must see the same paths, in place of processes here.
    keep_work
        Whether work files stay when every object is done.
    on_surveyed, on_done
        Called with the id of each object that was asked, and with each outcome, as they come.

    Raises
    ------
    DataError
        If ``out`` is something else than a dataset folder, another run is making it, or not one
        object could be made; then nothing is written to ``out``.
    OtherVersionError
        If a machine of the cluster has other code than this one.
    OSError
        If a disk is full: at once, with what is finished kept for a rerun.
    """
    refuse_other_folders(out)
    work = Path(work_folder(out.absolute()))
    task = _Task(settings, made_by_checksum(settings), work)
    here, there = partial(run_each, workers=workers), partial(run_on_cluster, address=cluster)
    run: Run = there if cluster else here
    with only_run(work, out):
        surveys, failed = _ask(run, partial(_survey, task), items, on_surveyed, on_done)
        report = BuildReport(failed)
        if surveys:
            fit = _fitted(surveys, work)
            asked = [item for item in items if item.object_id in surveys]
            make = partial(_make, task, fit, splits)
            done = gather(run(make, asked), on_done)
            report = BuildReport(tuple(sorted((*failed, *done), key=lambda one: one.object_id)))
        write_report(work, report)
        refuse_nothing(report, source, out)
        answers = maintainers_answers(inside(out, ANSWERS_NAME))
        assemble(report, work, out, settings.digest, answers)
        if not keep_work and not report.failures:
            _clear(work, items)
    return report


def _ask(
    run: Run,
    survey: Callable[[Item], Survey],
    items: Sequence[Item],
    on_surveyed: Callable[[str], None],
    on_done: Callable[[Outcome], None],
) -> tuple[dict[str, Survey], tuple[Outcome, ...]]:
    """Ask every object; return what they say, by id, and those that cannot be read."""
    surveys: dict[str, Survey] = {}

    def failures() -> Generator[Answer[Item, Any], None, None]:
        with closing(run(survey, items)) as answers:
            for item, answer in answers:
                refuse_to_go_on(answer)
                if isinstance(answer, Survey):
                    surveys[item.object_id] = answer
                    on_surveyed(item.object_id)
                else:
                    yield item, answer

    failed = gather(failures(), on_done)
    return dict(sorted(surveys.items())), failed


def _survey(task: _Task, item: Item) -> Survey:
    """Ask one object, by a worker, unless its answer is kept from before."""
    file = inside(task.work, f"{item.object_id}{SURVEY}")
    digest = task.digest(item)
    if (kept := _kept(read_bytes(file), digest)) is not None:
        return kept
    given = _read(item)
    with _naming(item):
        survey = survey_object(given)
    text = json.dumps({"digest": digest, "survey": survey.to_json()})
    write_bytes(file, text.encode())
    return survey


def _kept(content: bytes | None, digest: str) -> Survey | None:
    """Read a survey of the same origin; None where there is none, or it is damaged."""
    try:
        values = json.loads(content or b"")
        return Survey.from_json(values["survey"]) if values["digest"] == digest else None
    except (ValueError, KeyError, TypeError):
        return None


def _fitted(surveys: Mapping[str, Survey], work: Path) -> ReleaseFit:
    """Fit the release, and write down what was found."""
    fit = fit_release(list(surveys.values()))
    text = json.dumps({"schema": "xden-release-fit/1", **fit.to_json()}, indent=1) + "\n"
    write_bytes(inside(work, FIT_NAME), text.encode())
    return fit


def _make(task: _Task, fit: ReleaseFit, splits: Mapping[str, Split], item: Item) -> Outcome:
    """Make one object, by a worker, unless it is kept from before."""
    meter = Meter()
    split = splits[item.object_id]
    digest = task.digest(item, json.dumps(fit.to_json()), split)
    row = load_row(task.work, item.object_id, digest)
    status: Status = "kept" if row is not None else "built"
    if row is None:
        given = _read(item)
        with _naming(item):
            made = import_object(given, fit, split)
        made = replace(made, flags=(*made.flags, *given.meta["flags"]))
        if task.settings.scanner is not None:
            made = with_radiographs(made, item, task.settings.scanner)
        row = object_row(made)
        save_row(task.work, item.object_id, digest, row)
    return Outcome(item.object_id, status, "", find(row), meter.read(), digest)


def _read(item: Item) -> PublishedObject:
    """Read an object after the memory of those before is free.

    Meshes refer to themselves, so that only the collector frees them, and it counts how many
    things there are, not how large they are.
    """
    gc.collect()
    return read_item(item)


@contextmanager
def _naming(item: Item) -> Generator[None, None, None]:
    """Name the folder of an object where its files are sound, but not what they show."""
    try:
        yield
    except DataError as err:
        raise DataError(f"{item.root / item.folder.path}: {err}") from err


def _clear(work: Path, items: Sequence[Item]) -> None:
    """Remove the work files of objects that are in the dataset."""
    for item in items:
        for ending in (".h5", ".seal", SURVEY):
            (work / f"{item.object_id}{ending}").unlink(missing_ok=True)
