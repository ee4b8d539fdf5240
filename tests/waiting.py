"""Waiting for what happens, however busy the machine is."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

Found = TypeVar("Found")
NEVER_S = 1200.0
"""After which a test that hangs is given up; no test that passes comes near it."""


def until(condition: Callable[[], Found], every_s: float = 0.02) -> Found:
    """Wait until a condition holds, and return what it gave."""
    end = time.monotonic() + NEVER_S
    while not (found := condition()):
        assert time.monotonic() < end, "it does not happen"
        time.sleep(every_s)
    return found
