"""What the tests of the desk share."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from xden_bench.serve.tickets import TurnedAwayError


@contextmanager
def turned_away(reason: str, match: str | None = None) -> Iterator[None]:
    """Expect that a file is not taken, and why."""
    with pytest.raises(TurnedAwayError, match=match) as caught:
        yield
    assert caught.value.reason == reason
