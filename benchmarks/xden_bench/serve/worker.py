"""The process that scores: it alone opens what strangers send, with little memory and time.

Run as ``python -m xden_bench.serve.worker``. The first line of its input is a :class:`Setting`,
each further line a :class:`Task`; for each it writes lines of JSON, ``{"checked": 3,
"total": 200}`` as it goes and then an :class:`~xden_bench.serve.outcome.Outcome`. Lines of JSON
and not pickles, so that whatever a file may do to this process ends here. It ends when its input
does, so that it never outlives the desk, were that killed.
"""

from __future__ import annotations

import datetime
import json
import os
import queue
import shlex
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from xden1k.errors import DataError, SubmissionError
from xden_bench.serve.limits import be_modest
from xden_bench.serve.outcome import Outcome, find_entered

if TYPE_CHECKING:
    from xden_bench.scoring.protocol import Protocol
    from xden_bench.scoring.reference import Reference
    from xden_bench.scoring.score import Score

__all__ = ["Setting", "Task", "check_upload", "score_upload"]

_PROGRESS_S: Final = 0.2


@dataclass(frozen=True, slots=True)
class Setting:
    """What a scoring process works with, of JSON's types.

    Parameters
    ----------
    root, split
        The truth.
    protocol
        Name of the rules.
    results
        Folder of the entries.
    memory_bytes
        The most it may take.
    """

    root: str
    split: str
    protocol: str
    results: str
    memory_bytes: int


@dataclass(frozen=True, slots=True)
class Task:
    """What is to be done, of JSON's types.

    Parameters
    ----------
    path
        The submission.
    check_only
        Whether it is only to be checked.
    """

    path: str
    check_only: bool


def check_upload(
    path: Path,
    reference: Reference,
    rules: Protocol,
    progress: Callable[[Sequence[str]], Iterable[str]] = iter,
) -> Outcome:
    """Say whether :func:`score_upload` would enter a submission, and score nothing.

    Raises
    ------
    DataError
        If the truth cannot be read.
    """
    from xden_bench.methods.trivial import check_trivial
    from xden_bench.scoring.submission import validate

    problems = tuple(validate(path, reference, rules, progress=progress))
    if any(one.is_error for one in problems):
        return Outcome("refused", problems)
    try:
        check_trivial(path, reference, rules)
    except DataError as err:
        return _refused(path, err)
    return Outcome("sound", problems)


def score_upload(
    path: Path,
    reference: Reference,
    rules: Protocol,
    results: Path,
    progress: Callable[[Sequence[str]], Iterable[str]] = iter,
) -> Outcome:
    """Score a submission and enter it among the results, unless it is entered already.

    Parameters
    ----------
    path
        The submission.
    reference
        The truth.
    rules
        The protocol.
    results
        Folder of the entries.
    progress
        Goes through the object ids.

    Raises
    ------
    DataError
        If the truth cannot be read.
    OSError
        If the entry cannot be written.
    """
    from xden1k.predictions import raise_suspicions
    from xden_bench.methods.trivial import check_trivial, score_told
    from xden_bench.scoring.submission import validate

    try:
        scored = score_told(path, reference, rules, progress=progress)
        raise_suspicions(scored.warnings)
    except SubmissionError:
        return Outcome("refused", problems=validate(path, reference, rules))
    try:
        check_trivial(path, reference, rules)
    except DataError as err:
        return _refused(path, err)
    return _enter(scored, reference, results, path)


def _refused(path: Path, err: DataError) -> Outcome:
    """Refuse a file without telling where it lies."""
    return Outcome("refused", message=str(err).removeprefix(f"{path}: "))


def _enter(scored: Score, reference: Reference, results: Path, submission: Path) -> Outcome:
    """Write the entry; one that is there is left as it is."""
    from xden_bench.entries.result import entry_of, write_entry

    today = datetime.datetime.now(tz=datetime.UTC).date()
    command = _command(reference.split, scored.protocol.name)
    entry = entry_of(scored, reference, command=command, date=today)
    try:
        write_entry(entry, scored, results, submission=submission, by_anyone=True)
    except DataError as err:
        if found := _entered(scored, reference, results):
            return found
        return Outcome("refused", message=str(err))
    found = _entered(scored, reference, results)
    assert found is not None
    return found


def _entered(scored: Score, reference: Reference, results: Path) -> Outcome | None:
    return find_entered(
        results,
        scored.submission_sha256,
        protocol=scored.protocol.name,
        manifest_sha256=reference.manifest_sha256,
        split=reference.split,
    )


def _command(split: str, protocol: str) -> str:
    """Return the command that gives the same entry; the file's own name may tell of its author."""
    from xden_bench.scoring.protocol import load_protocol

    words = ["xden-bench", "submit", "preds.npz"]
    words += [] if split == "test" else ["--split", split]
    words += [] if protocol == load_protocol().name else ["--protocol", protocol]
    return shlex.join(words)


def _input_lines() -> Iterator[str]:
    """Lines of the input; at its end the process ends, whatever it is at."""
    lines: queue.SimpleQueue[str] = queue.SimpleQueue()

    def read() -> None:
        with os.fdopen(os.dup(0), encoding="utf-8") as stream:
            for line in stream:
                lines.put(line)
        os._exit(0)

    threading.Thread(target=read, daemon=True).start()
    while True:
        yield lines.get()


def _reporter(say: Callable[[str], object]) -> Callable[[Sequence[str]], Iterator[str]]:
    """Return what goes through ids and says how far it is, a few times a second."""

    def go_through(ids: Sequence[str]) -> Iterator[str]:
        said = 0.0
        for count, object_id in enumerate(ids):
            if (now := time.monotonic()) - said >= _PROGRESS_S:
                said = now
                say(json.dumps({"checked": count, "total": len(ids)}))
            yield object_id

    return go_through


def _main() -> None:
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what a library prints is no answer

    def say(line: str) -> None:
        answers.write(line + "\n")
        answers.flush()

    lines = _input_lines()
    setting = Setting(**json.loads(next(lines)))
    be_modest(setting.memory_bytes)
    reference, rules = _truth(setting)
    for line in lines:
        task = Task(**json.loads(line))
        path, progress = Path(task.path), _reporter(say)
        try:
            if task.check_only:
                found = check_upload(path, reference, rules, progress)
            else:
                found = score_upload(path, reference, rules, Path(setting.results), progress)
        except MemoryError:
            limit = f"{setting.memory_bytes / 1e6:.0f} MB"
            found = Outcome("failed", message=f"scoring it takes more than {limit} of memory")
        say(found.to_json())


def _truth(setting: Setting) -> tuple[Reference, Any]:
    from xden1k.folder import open_folder
    from xden_bench.scoring.protocol import load_protocol
    from xden_bench.scoring.reference import Reference

    reference = Reference(open_folder(setting.root), setting.split)
    return reference, load_protocol(setting.protocol)


if __name__ == "__main__":
    _main()
