"""Processor time of a piece of work, and the most memory that this process ever took.

Imports no numerical library, so that a new process can call :func:`keep_to_one_thread` before any.
"""

from __future__ import annotations

import os
import resource
import sys
import time
from collections.abc import Callable
from statistics import median
from typing import TypeVar

__all__ = ["keep_to_one_thread", "peak_mb", "timed"]

Result = TypeVar("Result")


def keep_to_one_thread() -> None:
    """Give one thread to each numerical library that this process will import.

    On a busy machine several threads wait for each other at full load, which doubles the time.
    """
    os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def timed(
    work: Callable[[], Result], repeats: int, clock: Callable[[], float] = time.process_time
) -> tuple[float, Result]:
    """Median seconds of a piece of work, and its result.

    Parameters
    ----------
    work
        What to run.
    repeats
        How often.
    clock
        By default the processor time of all threads.
    """
    seconds = []
    for _ in range(repeats):
        start = clock()
        result = work()
        seconds.append(clock() - start)
    return median(seconds), result


def peak_mb() -> float:
    """Largest resident set of this process so far, in 10^6 bytes."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return (peak if sys.platform == "darwin" else 1024 * peak) / 1e6
