"""Two ways of one task, measured in turns: what else the machine does befalls both."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median

__all__ = ["Comparison", "compared", "seconds"]


@dataclass(frozen=True, slots=True)
class Comparison:
    """What one task took, in rounds of one run of each way.

    Parameters
    ----------
    ours_s, other_s
        Seconds of each round.
    """

    ours_s: tuple[float, ...]
    other_s: tuple[float, ...]

    @property
    def ratios(self) -> list[float]:
        """The other's time over ours, round by round: above 1, ours is faster."""
        return [other / ours for ours, other in zip(self.ours_s, self.other_s, strict=True)]

    def to_dict(self, tasks: int = 1) -> dict[str, float]:
        """Medians of the times, in milliseconds of one of so many tasks; spread of the ratios.

        Examples
        --------
        >>> Comparison((0.2, 0.1, 0.1), (0.1, 0.1, 0.3)).to_dict(tasks=10)["ratio"]
        1.0
        """
        return {
            "ours_ms": 1e3 * median(self.ours_s) / tasks,
            "other_ms": 1e3 * median(self.other_s) / tasks,
            "ratio": median(self.ratios),
            "lowest": min(self.ratios),
            "highest": max(self.ratios),
        }


def compared(ours: Callable[[], object], other: Callable[[], object], rounds: int) -> Comparison:
    """Run two ways of one task in turns, after one run of each to warm up."""
    ours()
    other()
    times = [(seconds(ours), seconds(other)) for _ in range(rounds)]
    return Comparison(*zip(*times, strict=True))


def seconds(work: Callable[[], object]) -> float:
    """Seconds on the wall that a piece of work takes."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start
