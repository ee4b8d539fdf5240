"""What the tests of the desk share."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from xden_bench.serve.tickets import TurnedAwayError


@contextmanager
def full_disk(size_bytes: int) -> Iterator[None]:
    """Let no file of this process grow beyond a size, as if the disk were full."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@contextmanager
def turned_away(reason: str, match: str | None = None) -> Iterator[None]:
    """Expect that a file is not taken, and why."""
    with pytest.raises(TurnedAwayError, match=match) as caught:
        yield
    assert caught.value.reason == reason
