"""How the tests of the builder spare starting processes."""

from collections.abc import Callable, Iterable, Iterator
from typing import Any

import pytest

POOLS = ("phantoms.writer", "pipeline.align.run", "pipeline.run", "workers")
"""The modules that work in a pool of processes; most do by ``gather`` of the last."""


@pytest.fixture(scope="module")
def in_this_process() -> Iterator[None]:
    """Work on one object after the other in this process.

    Starting one that has imported the builder takes three seconds of processor time. What a pool
    adds is tested in ``test_workers.py``, and that it changes no byte in ``test_run.py``.
    """
    with pytest.MonkeyPatch.context() as patch:
        for module in POOLS:
            patch.setattr(f"xden_builder.{module}.run_each", one_by_one)
        yield


def one_by_one(task: Callable[[Any], Any], keys: Iterable[Any], workers: int) -> Iterator[Any]:
    """Yield what ``run_each`` does, if no process dies."""
    assert workers > 0
    for key in keys:
        try:
            answer = task(key)
        except Exception as err:
            answer = err
        yield key, answer
