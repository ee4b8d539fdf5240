"""The process of a method, as :mod:`.runner` starts it.

What the method prints goes to stderr: stdout is a pipe.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from xden1k.errors import XDenError
from xden_bench.methods.apart.asked import AskingScope
from xden_bench.methods.apart.channel import read_pickle, told, untold, write_request
from xden_bench.methods.baseline import find_method
from xden_bench.methods.running import Options, Report, run_within
from xden_bench.methods.scope import Task
from xden_bench.scoring.submission import Progress

__all__ = ["Described", "Job", "start"]

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells know it."""


@dataclass(frozen=True, slots=True)
class Described:
    """Stands for a source of pictures that is on the other side.

    Parameters
    ----------
    description, fingerprint
        Of the source.
    """

    description: str
    fingerprint: str

    def __call__(self, folder: Any, object_id: str) -> Any:
        """Refuse: pictures are asked for by the sample.

        Raises
        ------
        TypeError
            Always.
        """
        raise TypeError(f"{object_id}: take its pictures from the sample")


@dataclass(frozen=True, slots=True)
class Job:
    """What the process is to do.

    Parameters
    ----------
    name, settings
        Of the installed method.
    task
        What it predicts.
    options
        How it is run.
    out
        The submission to write.
    progress
        Goes through the ids of the objects that are left to do.
    """

    name: str
    settings: Mapping[str, Any]
    task: Task
    options: Options
    out: Path
    progress: Progress


@dataclass(frozen=True, slots=True)
class _Asking:
    """Asks over the pipes."""

    replies: IO[bytes]
    requests: IO[bytes]

    def __call__(self, *words: str) -> Any:
        write_request(self.requests, {"ask": words})
        error, value = read_pickle(self.replies)
        if error:
            raise untold(*error)
        return value


def start() -> None:
    """Take a job from stdin, run it, and say on stdout what came of it."""
    try:
        with os.fdopen(os.dup(1), "wb") as requests:
            os.dup2(2, 1)
            _work(sys.stdin.buffer, requests)
    except (KeyboardInterrupt, EOFError, BrokenPipeError):  # stopped, or alone
        sys.exit(INTERRUPTED)


def _work(replies: IO[bytes], requests: IO[bytes]) -> None:
    sys.path[:] = read_pickle(replies)
    try:
        outcome = _done(_run(read_pickle(replies), _Asking(replies, requests)))
    except XDenError as err:
        outcome = {"failed": told(err)}
    write_request(requests, outcome)


def _run(job: Job, ask: _Asking) -> Report:
    predictor = find_method(job.name, job.settings)
    scope = AskingScope(job.task, predictor.reads, job.options.target, ask)
    return run_within(scope, predictor, job.out, job.options, job.progress)


def _done(report: Report) -> dict[str, Any]:
    return {"continued": report.continued, "mass_native_g": dict(report.mass_native_g)}
