"""How far training has come in its budget, and how many threads it has."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import torch

from xden1k.predictor import Budget

__all__ = ["Clock", "half_cosine", "torch_threads"]


class Clock:
    """How far training has come in its budget.

    Parameters
    ----------
    budget
        When to stop; None = after so many epochs.
    epochs
        Where no budget is given.
    now
        What seconds are counted by.
    spent_s
        Seconds that are gone before it starts.
    """

    def __init__(
        self,
        budget: Budget | None,
        epochs: int,
        now: Callable[[], float] = time.monotonic,
        spent_s: float = 0.0,
    ) -> None:
        allowed = budget or Budget(epochs=epochs)
        self._epochs, self._seconds = allowed.epochs or math.inf, allowed.seconds or math.inf
        self._now, self._start = now, now() - spent_s

    @property
    def seconds(self) -> float:
        """How many are gone."""
        return self._now() - self._start

    def left(self, epochs: int) -> bool:
        """Whether another epoch is run after so many; at least one always is."""
        return epochs == 0 or (epochs < self._epochs and self.seconds < self._seconds)

    def progress(self, epochs: float) -> float:
        """Share of the budget that is gone, of epochs or seconds, whichever is more; at most 1."""
        # without a limit in seconds the clock must not touch the result
        timed = self.seconds / self._seconds if self._seconds < math.inf else 0.0
        return min(1.0, max(timed, epochs / self._epochs))


def half_cosine(progress: float) -> float:
    """Fall from 1 to 0 along half a cosine.

    Examples
    --------
    >>> [round(half_cosine(share), 3) for share in (0, 0.5, 1)]
    [1.0, 0.5, 0.0]
    """
    return (1 + math.cos(math.pi * progress)) / 2


@contextmanager
def torch_threads(number: int) -> Iterator[None]:
    """Set how many threads torch uses, for a while."""
    before = torch.get_num_threads()
    torch.set_num_threads(number)
    try:
        yield
    finally:
        torch.set_num_threads(before)
