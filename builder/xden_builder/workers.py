"""One task for each key in a pool of processes, of which any may die."""

from __future__ import annotations

import logging
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import active_children, get_context, parent_process
from multiprocessing.connection import wait as wait_for
from typing import Final, TypeVar

from xden1k.errors import XDenError

__all__ = ["ONE_THREAD", "Answer", "WorkerDiedError", "explain", "gather", "run_each"]

logger = logging.getLogger(__name__)

Key = TypeVar("Key")
Result = TypeVar("Result")
Answer = tuple[Key, Result | BaseException]

ONE_THREAD: Final[Mapping[str, str]] = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"
)
"""Lets the worker processes, not the libraries in them, fill the cores."""


class WorkerDiedError(XDenError):
    """The process that worked on a key was killed, also when it had nothing else to do."""


def run_each(
    task: Callable[[Key], Result],
    keys: Iterable[Key],
    workers: int,
    environment: Mapping[str, str] = ONE_THREAD,
) -> Generator[Answer[Key, Result], None, None]:
    """Run a task for each key and yield its result or its exception, as they come.

    When a process dies (out of memory, killed), the keys that were under way are tried once more,
    each alone; one that kills its process again is answered with :class:`WorkerDiedError`, and
    all others go on.

    Parameters
    ----------
    task
        A function that can be pickled.
    keys
        What to work on, values that can be pickled; at most twice as many as there are workers are
        taken ahead.
    workers
        Number of processes.
    environment
        Variables of theirs.
    """
    waiting = iter(keys)
    with _environment(environment):
        yield from _all(task, waiting, workers)


def gather(
    task: Callable[[str], Result],
    object_ids: Iterable[str],
    workers: int,
    on_done: Callable[[str], None],
) -> tuple[dict[str, Result], list[tuple[str, str]]]:
    """Run a task for each object, and wait for all.

    Parameters
    ----------
    task, workers
        As :func:`run_each` takes them.
    object_ids
        What to work on.
    on_done
        Called with each object's id as it is done.

    Returns
    -------
    results
        By id, sorted.
    failures
        Ids and messages, sorted.
    """
    results: dict[str, Result] = {}
    failures: list[tuple[str, str]] = []
    for object_id, answer in run_each(task, object_ids, workers):
        if isinstance(answer, BaseException):
            failures.append((object_id, explain(object_id, answer)))
        else:
            results[object_id] = answer
        on_done(object_id)
    return dict(sorted(results.items())), sorted(failures)


def _all(
    task: Callable[[Key], Result], waiting: Iterator[Key], workers: int
) -> Generator[Answer[Key, Result], None, None]:
    suspects: list[Key] = yield from _with_pool(task, waiting, workers, 2 * workers)
    while suspects:
        for key in suspects:  # alone, so that its death accuses nobody else
            if (yield from _with_pool(task, iter([key]), 1, 1)):
                error = WorkerDiedError("its process died twice; is there enough memory?")
                yield key, error
        suspects = yield from _with_pool(task, waiting, workers, 2 * workers)


def explain(key: str, error: BaseException) -> str:
    """Put an exception into one line; our own faults are logged with their traceback."""
    if isinstance(error, XDenError | OSError):
        return str(error)
    logger.error("%s: internal error", key, exc_info=error)
    return f"internal error: {type(error).__name__}: {error}"


def _with_pool(
    task: Callable[[Key], Result], keys: Iterator[Key], workers: int, window: int
) -> Generator[Answer[Key, Result], None, list[Key]]:
    with _pool(workers) as pool:
        return (yield from _finish(pool, task, keys, window))


@contextmanager
def _pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Give processes that are killed when the caller is interrupted or wants no more answers."""
    others = set(active_children())
    context = get_context("spawn")
    with ProcessPoolExecutor(workers, context, initializer=_end_with_the_parent) as pool:
        try:
            yield pool
        except BaseException:
            for process in set(active_children()) - others:
                process.kill()
            raise


@contextmanager
def _ctrl_c_is_the_parents() -> Iterator[None]:
    """Let processes that are started meanwhile never see Ctrl-C; here it waits for the end."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_with_the_parent() -> None:
    """Let a worker end at once when its parent has been killed, instead of waiting for ever."""
    parent = parent_process()
    assert parent is not None

    def watch() -> None:
        wait_for([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _finish(
    pool: ProcessPoolExecutor, task: Callable[[Key], Result], keys: Iterator[Key], window: int
) -> Generator[Answer[Key, Result], None, list[Key]]:
    """Run keys until they are used up or the pool breaks; return the keys that were cut off."""
    running: dict[Future[Result], Key] = {}
    died: list[Key] = []
    while True:
        while not died and len(running) < window and (key := next(keys, None)) is not None:
            try:
                with _ctrl_c_is_the_parents():
                    running[pool.submit(task, key)] = key
            except BrokenProcessPool:
                died.append(key)
        if not running:
            return died
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            key = running.pop(future)
            error = future.exception()
            if isinstance(error, BrokenProcessPool):
                died.append(key)
            else:
                yield key, error if error is not None else future.result()


@contextmanager
def _environment(values: Mapping[str, str]) -> Iterator[None]:
    """Set variables for the processes that are started meanwhile."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
