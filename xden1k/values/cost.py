"""What a piece of work costs the process that does it: time, processor time and memory."""

from __future__ import annotations

import os
import re
import sys
import time
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Cost", "Meter", "peak_memory_gb", "processor_s"]


@dataclass(frozen=True, slots=True)
class Cost:
    """What a piece of work cost the process that did it.

    Parameters
    ----------
    seconds
        Wall time.
    processor_s
        Processor time of all threads, and of children that ended meanwhile.
    peak_memory_gb
        The most memory the process had held by its end; None where the system does not tell it.
    """

    seconds: float
    processor_s: float
    peak_memory_gb: float | None


class Meter:
    """Counts from when it is made."""

    def __init__(self) -> None:
        self._seconds, self._processor_s = time.perf_counter(), processor_s()

    def read(self) -> Cost:
        """Return what has been spent since."""
        return Cost(
            seconds=time.perf_counter() - self._seconds,
            processor_s=processor_s() - self._processor_s,
            peak_memory_gb=peak_memory_gb(),
        )


def processor_s() -> float:
    """Return the processor time of this process so far: all threads, and children that ended."""
    children = os.times()
    return time.process_time() + children.children_user + children.children_system


def peak_memory_gb() -> float | None:
    """Return the most memory this process has held; None where the system does not tell it.

    Memory of a GPU is not in it. On Linux ``getrusage`` would count that of the process which
    started this one, so the kernel's high-water mark is read.
    """
    if sys.platform == "linux":
        status = Path("/proc/self/status").read_text(encoding="ascii")
        found = re.search(r"^VmHWM:\s+(\d+) kB$", status, re.MULTILINE)
        return int(found[1]) * 1024 / 1e9 if found else None
    if sys.platform == "darwin":
        import resource

        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e9
    return None
