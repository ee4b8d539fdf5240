"""Models of PartNeXt as a capture folder, or their truth as a dataset; what fails is left out."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final, TypeVar

from xden1k import __version__
from xden1k.documents.maintainer import Answers
from xden1k.errors import DataError, XDenError
from xden1k.folder import write_rows
from xden1k.format.records import object_row
from xden1k.format.shapes import ON_PARTNEXT
from xden1k.format.shards import Row
from xden_builder.phantoms.partnext.annotations import Entry, find_annotations
from xden_builder.phantoms.partnext.model import read_model
from xden_builder.phantoms.partnext.phantom import Shaping, model_phantom
from xden_builder.phantoms.phantom import Phantom
from xden_builder.phantoms.posing import AS_SCANNED, Posing, posed
from xden_builder.phantoms.realism import TIDY, Realism
from xden_builder.phantoms.scanner import Scanner
from xden_builder.phantoms.truth import DATA_VERSION, truth_object
from xden_builder.phantoms.writer import (
    object_columns,
    refuse_filled,
    simulation,
    write_object,
    write_set,
)
from xden_builder.workers import run_each

__all__ = ["Chosen", "Failure", "Made", "PartNeXtSet", "write_partnext", "write_partnext_truth"]

BUILDER: Final = f"xden-build partnext {__version__}"

Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class Failure:
    """An object that could not be made.

    Parameters
    ----------
    object_id
        Which; where its row stands, if that could not be told.
    message
        One line: the file, the object, and what was expected.
    """

    object_id: str
    message: str

    @property
    def line(self) -> str:
        """The message after the object, or as it is if it begins with where its row stands."""
        told = self.message.startswith(f"{self.object_id}: ")
        return self.message if told else f"{self.object_id}: {self.message}"


Report = Callable[[Failure | str], None]
"""Called with the id of each object that is done, and with each failure."""


@dataclass(frozen=True, slots=True)
class Made:
    """What came of a set.

    Parameters
    ----------
    objects
        Ids of those that were made, sorted.
    failures
        The others.
    repeated
        Rows of annotations left out, since their model has another one.
    """

    objects: tuple[str, ...]
    failures: tuple[Failure, ...]
    repeated: int

    def to_dict(self) -> dict[str, Any]:
        """Give the counts and what failed, in JSON's types."""
        return {
            "made": len(self.objects),
            "failed": len(self.failures),
            "repeated": self.repeated,
            "failures": [asdict(failure) for failure in self.failures],
        }


@dataclass(frozen=True, slots=True)
class Chosen:
    """Annotations of a set, before any is understood.

    Parameters
    ----------
    entries
        Where they are, sorted by model.
    failures
        Rows that could not be told to belong to a model.
    repeated
        As :class:`Made` has it.
    """

    entries: tuple[Entry, ...]
    failures: tuple[Failure, ...]
    repeated: int


@dataclass(frozen=True, slots=True)
class PartNeXtSet:
    """Which objects are made of a snapshot, and how.

    Parameters
    ----------
    folder
        The snapshot: annotations anywhere in it, meshes in ``glbs``.
    seed
        Of the set.
    scanner, realism, posing, shaping
        How they are shaped and taken.
    objects
        Ids of models; all if empty.
    count
        Of these, or of all in the order of their ids, the first so many; None: all.

    Raises
    ------
    DataError
        If the seed is negative.
    """

    folder: Path
    seed: int
    scanner: Scanner
    realism: Realism = TIDY
    posing: Posing = AS_SCANNED
    shaping: Shaping = field(default_factory=Shaping)
    objects: tuple[str, ...] = ()
    count: int | None = None

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise DataError(f"the seed must not be negative, got {self.seed}")

    def chosen(self) -> Chosen:
        """Look for the annotations of the set.

        Raises
        ------
        DataError
            If there is no annotation, or an object has none.
        """
        found = find_annotations(self.folder)
        faults = () if self.objects else found.faults
        strange = tuple(Failure(at, f"{at}: {why}") for at, why in faults)
        return Chosen(found.chosen(self.objects, self.count), strange, found.repeated)

    def phantom(self, entry: Entry) -> tuple[Phantom, dict[str, Any]]:
        """Make one object, not posed yet, and say what was drawn of its shape."""
        model = read_model(self.folder, entry)
        return model_phantom(model, self.seed, entry.model_id, self.shaping, self.realism)

    @property
    def settings(self) -> dict[str, Any]:
        """Every setting, of JSON's types; not where the snapshot is."""
        told = simulation(self.seed, self.scanner, self.realism, self.posing)
        return {"notes": ON_PARTNEXT, **told, "shaping": asdict(self.shaping)}


def write_partnext(
    out: Path,
    models: PartNeXtSet,
    chosen: Chosen,
    *,
    workers: int = 1,
    report: Report = lambda _: None,
) -> Made:
    """Simulate a capture folder, as :func:`xden_builder.phantoms.write_captures` writes them.

    An object depends on the seed and its model alone. One that fails is left out.

    Parameters
    ----------
    out
        A folder that is empty or does not exist.
    models
        How objects are made.
    chosen
        Of :meth:`PartNeXtSet.chosen`: which.
    workers
        Number of processes.
    report
        Called as objects are done.

    Raises
    ------
    DataError
        If the folder is not empty, or not one object could be made; then it stays empty, or is
        not there if it was not.
    """
    refuse_filled(out)
    made_here = not out.exists()
    out.mkdir(parents=True, exist_ok=True)
    for failure in chosen.failures:
        report(failure)
    settings, rows = {"standard"}, []
    failed = list(chosen.failures)
    for entry, answer in _in_order(partial(_write, out, models), chosen.entries, workers):
        if isinstance(answer, XDenError):
            failed.append(_failure(entry, answer))
            shutil.rmtree(out / entry.model_id, ignore_errors=True)
            report(failed[-1])
        else:
            setting, row = answer
            settings.add(setting)
            rows.append(row)
            report(entry.model_id)
    if not rows and made_here:
        out.rmdir()
    _refuse_nothing(len(rows), failed)
    write_set(out, rows, models.scanner, models.seed, settings, models.settings)
    return Made(tuple(row["object_id"] for row in rows), tuple(failed), chosen.repeated)


def _write(out: Path, models: PartNeXtSet, entry: Entry) -> tuple[str, dict[str, str]]:
    """Write the folder of one object; return its setting and its row of ``objects.csv``."""
    phantom, told = models.phantom(entry)
    setting = write_object(out, phantom, models.scanner, models.posing, told)
    return setting, object_columns(phantom.plan, models.posing) | {"notes": ON_PARTNEXT}


def write_partnext_truth(
    out: Path,
    models: PartNeXtSet,
    chosen: Chosen,
    *,
    workers: int = 1,
    report: Report = lambda _: None,
) -> Made:
    """Write the truth as a dataset folder, which appears complete or not at all.

    Parameters
    ----------
    out
        The dataset folder; an older one is replaced, but keeps its maintainer's answers.
    models, chosen, workers, report
        As in :func:`write_partnext`, of which these are the objects and radiographs.

    Raises
    ------
    DataError
        If ``out`` is something else than a dataset folder, or not one object could be made.
    """
    answers = Answers.of_folder(out)
    for failure in chosen.failures:
        report(failure)
    failed, made = list(chosen.failures), []

    def rows() -> Iterator[Row]:
        for entry, answer in _in_order(partial(_row, models), chosen.entries, workers):
            if isinstance(answer, XDenError):
                failed.append(_failure(entry, answer))
                report(failed[-1])
            else:
                made.append(entry.model_id)
                report(entry.model_id)
                yield answer
        _refuse_nothing(len(made), failed)

    text = json.dumps(models.settings, sort_keys=True)
    digest = hashlib.sha256(text.encode()).hexdigest()
    write_rows(
        rows(), out, version=DATA_VERSION, builder=BUILDER, config_sha256=digest, answers=answers
    )
    return Made(tuple(made), tuple(failed), chosen.repeated)


def _row(models: PartNeXtSet, entry: Entry) -> Row:
    """Make the encoded row of one object."""
    phantom, told = models.phantom(entry)
    taken = posed(phantom, models.scanner, models.posing)
    return object_row(truth_object(taken, models.scanner, builder=BUILDER, told=told))


def _in_order(
    task: Callable[[Entry], Result], entries: Sequence[Entry], workers: int
) -> Iterator[tuple[Entry, Result | XDenError]]:
    """Yield what a task gives or deliberately raises for each entry, in their order."""
    if workers == 1:
        for entry in entries:
            yield entry, _tried(task, entry)
        return
    early: dict[Entry, Result | XDenError] = {}
    waiting = iter(entries)
    expected = next(waiting, None)
    for entry, answer in run_each(partial(_tried, task), entries, workers):
        if isinstance(answer, BaseException) and not isinstance(answer, XDenError):
            raise answer
        early[entry] = answer
        while expected in early:
            yield expected, early.pop(expected)
            expected = next(waiting, None)


def _tried(task: Callable[[Entry], Result], entry: Entry) -> Result | XDenError:
    try:
        return task(entry)
    except XDenError as error:
        return error


def _failure(entry: Entry, error: XDenError) -> Failure:
    """Put an error into one line that names the object."""
    line = " ".join(str(error).split())
    named = entry.model_id in line
    return Failure(entry.model_id, line if named else f"{entry.where}: {line}")


def _refuse_nothing(made: int, failed: Sequence[Failure]) -> None:
    if not made:
        first = f", first: {failed[0].message}" if failed else ""
        raise DataError(f"not one of {len(failed)} objects could be made{first}")
