"""How sure a share of successes is, and whether one method has more of them than another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy.stats import binomtest

__all__ = ["Decided", "decided", "wilson_interval"]


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
class Decided:
    """Objects with which one of two methods does better than the other.

    Parameters
    ----------
    better, worse
        How many.
    p_equal
        Of the exact sign test (Dixon and Mood, 1946, doi:10.1080/01621459.1946.10501898): how
        probable so uneven a division is, or one more uneven, if either is as likely. Trials of one
        object are not independent, objects are taken to be.
    """

    better: int
    worse: int
    p_equal: float


def decided(differences: Float64[np.ndarray, "objects"]) -> Decided:
    """Compare two methods on the same objects, by the differences of their shares of success.

    Examples
    --------
    >>> decided(np.array([0.5, 0.1, 0.2, 0.0, 0.3]))
    Decided(better=4, worse=0, p_equal=0.125)
    """
    better, worse = int((differences > 0).sum()), int((differences < 0).sum())
    either = better + worse
    p_equal = float(binomtest(better, either).pvalue) if either else 1.0
    return Decided(better, worse, p_equal)
