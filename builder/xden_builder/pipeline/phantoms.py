"""A dataset of phantoms by a published recipe: resumable, and the same bytes on every machine.

``xden-bench dataset`` finds :func:`make_phantoms` by an entry point of the group
``xden1k.makers``.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from xden1k.documents.maintainer import Answers
from xden1k.errors import DataError
from xden1k.format.shards import Row
from xden_builder.phantoms.phantom import plan_objects
from xden_builder.phantoms.posing import AS_SCANNED
from xden_builder.phantoms.realism import LIFELIKE
from xden_builder.phantoms.scanner import Scanner
from xden_builder.phantoms.truth import TruthMaker, write_truth_rows
from xden_builder.phantoms.writer import make_scanner
from xden_builder.pipeline.resumable import only_run, refuse_to_go_on, work_folder
from xden_builder.pipeline.storage import refuse_other_folders, room_for, size_of
from xden_builder.pipeline.version import made_by_checksum
from xden_builder.pipeline.work import load_row, save_row
from xden_builder.workers import ONE_THREAD, run_each

__all__ = ["make_phantoms", "same_instructions"]

SETTINGS: Final = frozenset({"count", "seed", "size_px", "unseen"})


def make_phantoms(
    settings: Mapping[str, Any],
    out: Path,
    *,
    workers: int,
    objects: slice = slice(None),
    on_done: Callable[[str], None] = lambda _: None,
) -> None:
    """Make a dataset folder of phantoms on the realistic scanner, lifelike.

    Finished objects are kept in ``OUT.work`` until all are there; a run that was killed goes on
    with them. The folder appears complete or not at all.

    Parameters
    ----------
    settings
        ``count``, ``seed``, ``size_px`` and ``unseen``, the categories of that split.
    out
        The dataset folder; an older one is replaced as a whole.
    workers
        Number of processes.
    objects
        Only these, in the order in which they are drawn.
    on_done
        Called with the id of each object that is there.

    Raises
    ------
    DataError
        If a setting is missing, unknown or out of range, ``out`` is something else than a dataset
        folder, or another run is making it.
    OSError
        If the disk is full, with what is finished kept.
    """
    refuse_other_folders(out)
    maker, ids = _planned(settings, objects)
    work = Path(work_folder(out.absolute()))
    with only_run(work, out):
        task = _Task(maker, made_by_checksum(maker, left_out=frozenset()), work)
        _make_each(task, ids, workers, on_done)
        with room_for(f"the dataset {out.name}", out.absolute().parent, lambda: size_of(work)):
            write_truth_rows(_rows(task, ids), out, maker, Answers.of_folder(out))
        for object_id in ids:
            for ending in (".h5", ".seal"):
                (work / f"{object_id}{ending}").unlink()


def _planned(settings: Mapping[str, Any], objects: slice) -> tuple[TruthMaker, list[str]]:
    """Give what makes the objects, and their ids in ascending order."""
    if settings.keys() != SETTINGS:
        raise DataError(f"expected the settings {sorted(SETTINGS)}, got {sorted(settings)}")
    unseen, seed = tuple(settings["unseen"]), settings["seed"]
    plans = plan_objects(settings["count"], seed, unseen=unseen)[objects]
    if not plans:
        raise DataError(f"none of the {settings['count']} objects was chosen")
    scanner = make_scanner(settings["size_px"], False, Scanner.realistic())
    maker = TruthMaker(seed, scanner, LIFELIKE, AS_SCANNED, unseen)
    return maker, sorted(plan.object_id for plan in plans)


@dataclass(frozen=True, slots=True, eq=False)
class _Task:
    """What every worker is told.

    Parameters
    ----------
    maker
        Of the rows.
    made_by
        Checksum of its settings and of the code.
    work
        Folder of the work files.
    """

    maker: TruthMaker
    made_by: str
    work: Path

    def __call__(self, object_id: str) -> None:
        """Make one object, unless it is kept from before."""
        if self.kept(object_id) is None:
            row = self.maker.row(object_id)
            save_row(self.work, object_id, self._digest(object_id), row)

    def kept(self, object_id: str) -> Row | None:
        """Read the row of an object; None if it is not there."""
        return load_row(self.work, object_id, self._digest(object_id))

    def _digest(self, object_id: str) -> str:
        return hashlib.sha256(f"{self.made_by}\n{object_id}".encode()).hexdigest()


def _make_each(
    task: _Task, ids: Sequence[str], workers: int, on_done: Callable[[str], None]
) -> None:
    with closing(run_each(task, ids, workers, {**ONE_THREAD, **same_instructions()})) as answers:
        for object_id, answer in answers:
            refuse_to_go_on(answer)
            if isinstance(answer, BaseException):
                raise DataError(f"{object_id}: {answer}") from answer
            on_done(object_id)


def _rows(task: _Task, ids: Sequence[str]) -> Iterator[Row]:
    for object_id in ids:
        row = task.kept(object_id)
        if row is None:
            raise DataError(f"{task.work / object_id}.h5 is gone or has changed: start again")
        yield row


def same_instructions() -> dict[str, str]:
    """Give the environment in which NumPy, OpenBLAS and numba compute alike on x86-64.

    They choose among versions of ``exp``, of sums and of products by what a processor has, which
    differ in the last bit. Here they take those for AVX2 and FMA, which every such processor has
    had since 2015, and no longer ones. A process must have it before it imports NumPy.
    """
    known = np.show_config(mode="dicts")["SIMD Extensions"]
    names = [*known.get("found", ()), *known.get("not found", ())]
    longer = [name for name in names if "512" in name or name == "X86_V4"]
    return {
        "NPY_DISABLE_CPU_FEATURES": " ".join(longer),
        "OPENBLAS_CORETYPE": "Haswell",
        "NUMBA_DISABLE_INTEL_SVML": "1",
    }
