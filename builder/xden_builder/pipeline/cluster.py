"""One task for each key on a Ray cluster, which schedules, retries, and may lose machines."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from itertools import islice
from typing import Any, TypeVar

from xden1k.errors import DataError, require
from xden_builder.workers import Answer, WorkerDiedError

__all__ = ["run_on_cluster"]

Key = TypeVar("Key")
Result = TypeVar("Result")

RETRIES = 3
"""Of a task whose process or machine was lost; one that raises is not tried again."""
MEMORY_BYTES = 1_500_000_000
"""Reserved for a task, so that a machine takes no more of them than it has memory for."""


def run_on_cluster(
    task: Callable[[Key], Result], keys: Iterable[Key], address: str
) -> Generator[Answer[Key, Result], None, None]:
    """Run a task for each key and yield its result or its exception, as they come.

    Parameters
    ----------
    task
        A function that can be pickled, of a package that all machines have.
    keys
        What to work on, values that can be pickled; at most twice as many as the cluster has cores
        are handed to it at a time.
    address
        Of a Ray cluster: ``HOST:PORT``, ``ray://HOST:PORT``, or ``auto`` on one of its machines.

    Raises
    ------
    DataError
        If no cluster answers there.
    MissingExtraError
        If Ray is not installed.
    """
    with _connection(address) as ray:
        call = ray.remote(num_cpus=1, memory=MEMORY_BYTES, max_retries=RETRIES)(_call)
        waiting = iter(keys)
        running: dict[Any, Key] = {}
        while True:
            window = 2 * max(int(ray.cluster_resources().get("CPU", 0)), 1)
            for key in islice(waiting, max(window - len(running), 0)):
                running[call.remote(task, key)] = key
            if not running:
                return
            for done in ray.wait(list(running))[0]:
                yield running.pop(done), _answer(ray, done)


def _call(task: Callable[[Key], Result], key: Key) -> Result:
    """Be a function, which Ray wants, for tasks that are partial ones."""
    return task(key)


def _answer(ray: Any, done: Any) -> Any:
    try:
        return ray.get(done)
    except ray.exceptions.RayTaskError as err:
        return err.cause
    except ray.exceptions.RayError as err:
        reason = str(err).partition("\n")[0]
        return WorkerDiedError(f"its process or machine was lost {RETRIES + 1} times: {reason}")


@contextmanager
def _connection(address: str) -> Iterator[Any]:
    _refuse_silence(address)
    # Without it, a task that takes too much memory is tried for ever. Ray reads it once.
    os.environ.setdefault("RAY_task_oom_retries", str(RETRIES))
    ray = require("ray", "cluster")
    try:
        ray.init(address, log_to_driver=False, logging_level="ERROR")
    except (ConnectionError, ValueError) as err:
        raise DataError(f"{address}: no Ray cluster answers: {err}") from err
    try:
        yield ray
    finally:
        ray.shutdown()


def _refuse_silence(address: str) -> None:
    """Refuse an address at which nobody listens; Ray would wait for minutes."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if host and port.isdigit():
        try:
            socket.create_connection((host, int(port)), timeout=10).close()
        except OSError as err:
            raise DataError(f"{address}: no Ray cluster answers: {err}") from err
