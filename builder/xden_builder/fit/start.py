"""Where the fit starts: non-negative least squares on -ln T."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import Final

import numpy as np
from jaxtyping import Float64
from scipy.optimize import nnls

from xden_builder.fit.observed import ViewData
from xden_builder.fit.problem import Problem

__all__ = ["starting_point"]

DARKEST: Final = 0.02
"""Transmissions below it are cut: their logarithm is mostly noise."""
DARK_WEIGHT: Final = 1e-4
VALUES_AT_ONCE: Final = 1 << 21

Linearised = tuple[Float64[np.ndarray, "n k"], Float64[np.ndarray, "n"], Float64[np.ndarray, "n"]]


def starting_point(problem: Problem) -> Float64[np.ndarray, "u"]:
    """Coefficients and gains to start from.

    Gains are those of the air. Coefficients minimise the squared error of -ln T, weighted by T²
    (which makes it nearly that of T), on path lengths averaged over each pixel's rays.
    """
    parts = problem.parts
    gram, projection = np.zeros((parts, parts)), np.zeros(parts)
    for lengths, attenuation, weights in chain(*map(_linearised, problem.views)):
        weighted = lengths * weights[:, None]
        gram += weighted.T @ lengths
        projection += weighted.T @ attenuation
    # a ridge far below any information keeps the factor of unseen parts and of twins
    gram += 1e-9 * max(float(gram.diagonal().max()), 1e-9) * np.eye(parts)
    factor = np.linalg.cholesky(gram)
    lac, _ = nnls(factor.T, np.linalg.solve(factor, projection))
    return np.append(lac, [view.air.mean for view in problem.views])


def _linearised(view: ViewData) -> Iterator[Linearised]:
    """Give mean lengths, -ln T and weights of some pixels at a time, to bound the memory."""
    transmission = view.measured / view.air.mean
    bright = np.maximum(transmission, DARKEST)
    weights = np.where(transmission > DARKEST, bright**2, DARK_WEIGHT)
    weights[~view.usable] = 0.0
    step = max(VALUES_AT_ONCE // view.parts, 1)
    for begin in range(0, len(bright), step):
        some = slice(begin, begin + step)
        lengths = view.lengths.lengths_cm[some].mean(axis=1, dtype=np.float64)
        yield lengths, -np.log(bright[some]), weights[some]
