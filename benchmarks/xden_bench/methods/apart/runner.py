"""Starting a method's process, and answering it until its submission is there."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, Any, Final, cast

from xden1k.access.hub import ROOT_VARIABLE
from xden1k.errors import DataError, XDenError, of_dataset
from xden1k.folder import DatasetFolder
from xden1k.predictions import open_predictions
from xden1k.predictor import Fingerprinted, PictureSource, Predictor, Segmenter
from xden1k.segmentation import open_segments
from xden_bench.methods.apart.answers import Answers
from xden_bench.methods.apart.channel import read_requests, told, untold, write_pickle
from xden_bench.methods.apart.process import Described, Job
from xden_bench.methods.baseline import find_method
from xden_bench.methods.running import Options, Report, refuse_without_radiographs
from xden_bench.methods.scope import Task
from xden_bench.scoring.submission import Progress

__all__ = ["Method", "run_apart"]

CALL: Final = "from xden_bench.methods.apart.process import start; start()"
GRACE_S: Final = 10.0
"""What a process that is to stop has for putting away what it did."""


@dataclass(frozen=True, slots=True)
class Method:
    """An installed method, and what it is made with.

    Parameters
    ----------
    name
        Of its entry point.
    settings
        Keyword arguments.
    """

    name: str
    settings: Mapping[str, Any] = field(default_factory=dict)

    def load(self) -> Predictor | Segmenter:
        """Return it; see :func:`xden_bench.methods.baseline.find_method`."""
        return find_method(self.name, self.settings)


def run_apart(
    method: Method,
    predictor: Predictor | Segmenter,
    folder: DatasetFolder,
    split: str,
    out: Path,
    options: Options,
    progress: Progress = iter,
) -> Report:
    """Run a method in a process of its own, which is shown what the method declared.

    Parameters
    ----------
    method
        What that process loads.
    predictor
        The same, loaded here: what it declares is what it is shown.
    folder, split, out, options, progress
        As in :func:`xden_bench.methods.running.run_predictor`; the progress must be importable.

    Raises
    ------
    DataError, ModalityError
        As there, or if the process ends before the submission is there, or writes one that
        declares other inputs.
    """
    options.check(predictor)
    refuse_without_radiographs(predictor, folder, split, options)
    task = Task.of(folder, split, options.train_objects, options.seed)
    if not predictor.trainable or options.model:
        task = replace(task, train_ids=())
    answers = Answers(folder, task, predictor.reads, options)
    shown = replace(options, pictures=_described(options.pictures), command="")
    job = Job(method.name, method.settings, task, shown, out.absolute(), progress)
    with _process() as process:
        outcome = _answered(process, job, answers)
    if outcome is None:
        raise DataError(f"the process of the method {method.name} ended {_how(process)}")
    with of_dataset(folder.root):
        return _report(out, predictor, options, outcome)


def _described(pictures: PictureSource | None) -> Described | None:
    if pictures is None:
        return None
    fingerprint = pictures.fingerprint if isinstance(pictures, Fingerprinted) else ""
    return Described(pictures.description, fingerprint)


@contextmanager
def _process() -> Iterator[subprocess.Popen[bytes]]:
    """Start the process; when it is left, stop it."""
    environment = {name: value for name, value in os.environ.items() if name != ROOT_VARIABLE}
    words = (sys.executable, "-c", CALL)
    process = subprocess.Popen(  # noqa: S603
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment
    )
    with process:
        try:
            yield process
        finally:
            _stop(process)


def _stop(process: subprocess.Popen[bytes]) -> None:
    with suppress(BrokenPipeError):
        cast(IO[bytes], process.stdin).close()  # it has nobody to ask any more
    try:
        process.wait(GRACE_S)
    except subprocess.TimeoutExpired:
        process.terminate()


def _answered(
    process: subprocess.Popen[bytes], job: Job, answers: Answers
) -> dict[str, Any] | None:
    """Answer the process until it says what came of it; None if it ends without."""
    replies, requests = cast(IO[bytes], process.stdin), cast(IO[bytes], process.stdout)
    with suppress(BrokenPipeError):  # it is gone, and its exit code says how
        write_pickle(replies, sys.path)
        write_pickle(replies, job)
        for request in read_requests(requests):
            if "ask" not in request:
                return request
            write_pickle(replies, _reply(answers, request["ask"]))
    return None


def _reply(answers: Answers, words: Any) -> tuple[tuple[str, str] | None, Any]:
    """Return an error or what was asked for."""
    try:
        return None, answers(*map(str, words))
    except XDenError as err:
        return told(err), None


def _report(
    out: Path, predictor: Predictor | Segmenter, options: Options, outcome: Mapping[str, Any]
) -> Report:
    if "failed" in outcome:
        raise untold(*outcome["failed"])
    opened = open_predictions if options.points_seed is None else open_segments
    with opened(out) as found:
        meta = found.meta
    if meta is None or meta.inputs != predictor.reads.inputs:
        out.unlink()
        raise DataError(
            f"{out}: the method was shown {list(predictor.reads.inputs)}, and its file says "
            f"{meta and list(meta.inputs)}"
        )
    return Report(meta, outcome["continued"], outcome["mass_native_g"])


def _how(process: subprocess.Popen[bytes]) -> str:
    code = process.returncode
    end = f"by signal {-code}" if code < 0 else f"with exit code {code}"
    return f"{end} and left no submission; run again to go on where it stopped"
