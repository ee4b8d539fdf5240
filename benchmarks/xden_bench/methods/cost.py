"""What predicting costs the process that does it: processor time and memory."""

from __future__ import annotations

import os
import re
import sys
import time
from pathlib import Path

__all__ = ["peak_memory_gb", "processor_s"]


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
