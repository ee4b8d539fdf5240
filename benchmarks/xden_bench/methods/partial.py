"""What an interrupted run of a method left, so that the next one goes on where it stopped.

A hidden folder beside the submission, ``.NAME.partial``: what was run (``run.json``), the fit where
the method can store it, and one file for each finished object. It is gone when the submission is
there. A run that differs in anything that its predictions depend on begins anew.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import numpy as np

from xden1k.errors import DataError
from xden1k.folder import exclusive

__all__ = ["Facts", "Kept", "PartialRun", "code_sha256", "folder_sha256", "partial_run"]

LOCK_NAME: Final = "lock"
RUN_NAME: Final = "run.json"
FIT_NAME: Final = "fit"


@dataclass(frozen=True, slots=True)
class Facts:
    """What is to be said of one answer.

    Parameters
    ----------
    seconds
        Wall time.
    processor_s, peak_memory_gb
        Processor time of the method's process for it, and the most memory that process had held
        by then; None if not told.
    mass_native_g, model, answers, fallbacks, device, remark, unanswered
        As in :class:`xden1k.predictor.Prediction`.
    """

    seconds: float
    mass_native_g: float | None = None
    model: str = ""
    answers: int = 0
    fallbacks: int = 0
    device: str = "cpu"
    remark: str = ""
    unanswered: int = 0
    processor_s: float | None = None
    peak_memory_gb: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Kept:
    """An answer as it is kept.

    Parameters
    ----------
    arrays
        What the method gave, by the names under which it is written.
    facts
        What is to be said of it.
    """

    arrays: Mapping[str, Any]
    facts: Facts


@dataclass(frozen=True, slots=True)
class PartialRun:
    """The predictions of a run that is not finished.

    Parameters
    ----------
    folder
        Where they lie.
    """

    folder: Path

    @property
    def fit_folder(self) -> Path:
        """Where the fit is kept."""
        return self.folder / FIT_NAME

    @property
    def submission(self) -> Path:
        """Where the submission is made."""
        return self.folder / "submission"

    @property
    def is_empty(self) -> bool:
        """Whether nothing is kept that took time."""
        return not self.fit_folder.exists() and not self.count

    @property
    def count(self) -> int:
        """How many objects are done, the first ones of the split."""
        return len(list(self.folder.glob("*.npz")))

    def keep(self, place: int, kept: Kept) -> None:
        """Add the object at a place of the split: whole or not at all."""
        new = self.folder / "object.new"
        with new.open("wb") as file:
            np.savez(file, facts=np.array(json.dumps(asdict(kept.facts))), **kept.arrays)
            file.flush()
            os.fsync(file.fileno())
        new.replace(self._file(place))

    def read(self, place: int) -> Kept:
        """Return an object that is done."""
        with np.load(self._file(place)) as arrays:
            kept = dict(arrays)
            return Kept(kept, Facts(**json.loads(str(kept.pop("facts")))))

    def _file(self, place: int) -> Path:
        return self.folder / f"{place:06d}.npz"


@contextmanager
def partial_run(out: Path, run: Mapping[str, Any]) -> Iterator[PartialRun]:
    """Take up the run that writes a submission, or begin it.

    It is gone at the end; after an error or a kill it stays if there is anything to go on with.

    Parameters
    ----------
    out
        The submission.
    run
        All that its predictions depend on, of JSON's types.

    Raises
    ------
    DataError
        If another process is writing the same submission.
    """
    folder = out.with_name(f".{out.name}.partial")
    folder.mkdir(parents=True, exist_ok=True)
    partial = PartialRun(folder)
    try:
        with exclusive(folder / LOCK_NAME):
            _begin(folder, json.dumps(run, sort_keys=True))
            try:
                yield partial
            except BaseException:
                if partial.is_empty:
                    _remove(folder)
                raise
            _remove(folder)
    except BlockingIOError as err:
        raise DataError(f"{out}: another process is writing it") from err


def _begin(folder: Path, run: str) -> None:
    """Keep what the same run left, remove what another did or what is half written."""
    stated = folder / RUN_NAME
    same = stated.exists() and stated.read_text() == run
    if not same:
        stated.unlink(missing_ok=True)  # first: what is removed in part belongs to no run
    for left in folder.iterdir():
        is_whole = left.suffix == ".npz" or left.name in (RUN_NAME, FIT_NAME)
        if left.name == LOCK_NAME or (same and is_whole):
            continue
        if left.is_dir():
            shutil.rmtree(left)
        else:
            left.unlink()
    if not same:
        new = folder / "run.new"
        new.write_text(run)
        new.replace(stated)


def _remove(folder: Path) -> None:
    (folder / RUN_NAME).unlink()
    shutil.rmtree(folder)


def code_sha256(kind: type) -> str:
    """Checksum of the source of a class's package and of the dataset's, as they lie on disk."""
    digest = hashlib.sha256()
    for module in (kind.__module__, "xden1k"):
        _add_files(digest, _sources(sys.modules.get(module)))
    return digest.hexdigest()


def _sources(module: ModuleType | None) -> list[Path]:
    """Every source file of the outermost package of a module, or the module's alone."""
    file = getattr(module, "__file__", None)
    if file is None:
        return []
    outermost = None
    for folder in Path(file).parents:
        if not (folder / "__init__.py").exists():
            break
        outermost = folder
    return [Path(file)] if outermost is None else list(outermost.rglob("*.py"))


def folder_sha256(folder: Path) -> str:
    """Checksum of the names and contents of all files below a folder."""
    digest = hashlib.sha256()
    _add_files(digest, [one for one in folder.rglob("*") if one.is_file()])
    return digest.hexdigest()


def _add_files(digest: hashlib._Hash, files: list[Path]) -> None:
    for file in sorted(files):
        content = hashlib.sha256(file.read_bytes()).hexdigest()
        digest.update(f"{file.name} {content}\n".encode())
