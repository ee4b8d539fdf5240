"""Scores the queue, one file after another, in a process of its own that may die."""

from __future__ import annotations

import json
import logging
import os
import signal
import sqlite3
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import IO, Any, Final

from xden_bench.serve.outcome import Outcome
from xden_bench.serve.store import Job, Store
from xden_bench.serve.worker import Setting, Task

__all__ = ["Runner"]

logger = logging.getLogger(__name__)

RETRY_S: Final = 2.0
"""How long to wait before trying again to write to a full disk."""
_END_S: Final = 5.0
_ENVIRONMENT: Final = {
    **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"),
    "NUMBA_NUM_THREADS": "1",
    "ARROW_DEFAULT_MEMORY_POOL": "system",  # others reserve 1 GB, which the limit would count
}
_DIED: Final = "the process that scored it ended without a result; the server's log says more"


class _Process:
    """A running :mod:`xden_bench.serve.worker`."""

    def __init__(self, setting: Setting) -> None:
        self._stderr: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - closed by end()
        self._popen = subprocess.Popen(
            [sys.executable, "-P", "-m", "xden_bench.serve.worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._stderr,
            env=os.environ | _ENVIRONMENT,
            encoding="utf-8",
        )
        self._timed_out = False
        self._send(asdict(setting))

    def score(self, task: Task, seconds: float, progress: Callable[[int, int], None]) -> Outcome:
        """Have a file scored or checked; a process that dies, or is too slow, gives ``failed``."""
        timer = threading.Timer(seconds, self._too_slow)
        timer.start()
        try:
            self._send(asdict(task))
            outcome = self._answer(progress)
        finally:
            timer.cancel()
        if outcome is not None:
            return outcome
        if self._timed_out:
            said = f"checking and scoring it takes more than {seconds:g} s"
            return Outcome("failed", message=said)
        return Outcome("failed", message=self._last_words())

    def kill(self) -> None:
        """End it at once."""
        self._popen.kill()

    def end(self) -> None:
        """End it and release what it held."""
        self._popen.kill()
        with suppress(BrokenPipeError), self._popen:  # closes the pipes and waits
            self._stderr.close()

    def _send(self, value: Any) -> None:
        assert self._popen.stdin is not None
        with suppress(BrokenPipeError):  # it is dead, as the end of its answers tells
            self._popen.stdin.write(json.dumps(value) + "\n")
            self._popen.stdin.flush()

    def _answer(self, progress: Callable[[int, int], None]) -> Outcome | None:
        assert self._popen.stdout is not None
        for line in self._popen.stdout:
            try:
                values = json.loads(line)
                if "state" in values:
                    return Outcome.from_json(line)
                progress(values["checked"], values["total"])
            except (ValueError, TypeError, KeyError):  # cut off by its death, or no answer at all
                return None
        return None

    def _too_slow(self) -> None:
        self._timed_out = True
        self._popen.kill()

    def _last_words(self) -> str:
        """Say how it died; what it wrote is for the log, and not for a stranger."""
        code = None  # that of its own end, not of being killed here
        with suppress(subprocess.TimeoutExpired):
            code = self._popen.wait(_END_S)
        self._popen.kill()  # if it lives on, after an answer that is none
        self._popen.wait()
        self._stderr.seek(0)
        said = self._stderr.read().decode(errors="replace")[-4000:]
        logger.error("scoring process, exit %s: %s", code, said)
        if code == -signal.SIGKILL:
            return "the process that scored it was killed, perhaps because memory ran out"
        return _DIED


class Runner:
    """Works off the queue in a thread, until it is stopped.

    Parameters
    ----------
    store
        The tickets.
    setting
        For the scoring process.
    job_seconds
        Longest time for one file.
    upload
        Where a job's file lies.
    rescue
        Finds the outcome of a file, by checksum, whose process died after it had entered it; else
        None.
    """

    def __init__(
        self,
        store: Store,
        setting: Setting,
        job_seconds: float,
        upload: Callable[[str], Path],
        rescue: Callable[[str], Outcome | None],
    ) -> None:
        self._store, self._setting, self._job_seconds = store, setting, job_seconds
        self._upload, self._rescue = upload, rescue
        self._process: _Process | None = None
        self._unrecorded: tuple[Job, Outcome] | None = None
        self._progress = (0, 0, 0)
        self._stopping, self._guard, self._wake = False, threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="scoring queue", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def wake(self) -> None:
        """Look at the queue now."""
        self._wake.set()

    def progress(self, number: int) -> tuple[int, int]:
        """Objects checked, of how many, if that job is the one under way; else 0 of 0."""
        current, checked, total = self._progress
        return (checked, total) if current == number else (0, 0)

    def stop(self) -> None:
        """End the scoring process and the thread; a job under way is put back."""
        with self._guard:
            self._stopping = True
            if self._process:
                self._process.kill()
        self._wake.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._stopping:
            try:
                busy = self._step()
            except (sqlite3.OperationalError, OSError) as err:
                logger.error("the queue waits %g s: %s", RETRY_S, err)
                busy = False
            if not busy:
                self._wake.wait(RETRY_S)
                self._wake.clear()
        if self._process:
            self._process.end()

    def _step(self) -> bool:
        """Score one file and record it; False if there is none, or the runner is stopping."""
        if self._unrecorded is None:
            if (job := self._store.start_next()) is None:
                return False
            try:
                outcome = self._score(job)
            except OSError as err:
                logger.error("no scoring process: %s", err)
                outcome = Outcome("failed", message=_DIED)
            if outcome is None:
                self._store.put_back(job)
                return False
            self._unrecorded = job, outcome
        job, outcome = self._unrecorded
        self._store.finish(job, outcome)
        self._unrecorded = None
        if outcome.state != "scored":
            self._upload(job.ticket_id).unlink(missing_ok=True)
        return True

    def _score(self, job: Job) -> Outcome | None:
        """Have a job's file scored; None if the runner was stopped meanwhile."""
        with self._guard:
            if self._stopping:
                return None
            if self._process is None:
                self._process = _Process(self._setting)
            process = self._process

        def note(checked: int, total: int) -> None:
            self._progress = (job.number, checked, total)

        task = Task(str(self._upload(job.ticket_id)), job.check_only)
        outcome = process.score(task, self._job_seconds, note)
        if outcome.state == "failed":  # a process that failed once is not trusted with the next
            with self._guard:
                self._process = None
            process.end()
            if self._stopping:
                return None
            outcome = (not job.check_only and self._rescue(job.sha256)) or outcome
        return outcome
