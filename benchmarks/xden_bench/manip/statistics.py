"""How sure a share of successes is, and whether one method has more of them than another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool
from scipy.stats import binomtest

__all__ = ["Discordant", "discordant", "wilson_interval"]


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """95 % score interval of a share (Wilson, 1927, doi:10.1080/01621459.1927.10502953).

    Trials count as independent: of several with one object it is too narrow.

    Examples
    --------
    >>> [round(end, 3) for end in wilson_interval(81, 263)]
    [0.255, 0.366]
    """
    ends = binomtest(successes, trials).proportion_ci(method="wilson")
    return float(ends.low), float(ends.high)


@dataclass(frozen=True, slots=True)
class Discordant:
    """Trials in which one of two methods succeeds and the other does not.

    Parameters
    ----------
    only_a, only_b
        How many.
    p_equal
        Of McNemar's exact test (1947, doi:10.1007/BF02295996): how probable so uneven a division
        is, or one more uneven, if either is as likely.
    """

    only_a: int
    only_b: int
    p_equal: float


def discordant(a: Bool[np.ndarray, "trials"], b: Bool[np.ndarray, "trials"]) -> Discordant:
    """Compare two methods on the same trials.

    Examples
    --------
    >>> discordant(np.array([True] * 4 + [False]), np.array([False] * 5))
    Discordant(only_a=4, only_b=0, p_equal=0.125)
    """
    only_a, only_b = int((a & ~b).sum()), int((b & ~a).sum())
    decided = only_a + only_b
    p_equal = float(binomtest(only_a, decided).pvalue) if decided else 1.0
    return Discordant(only_a, only_b, p_equal)
