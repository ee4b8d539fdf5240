"""Means over objects of given categories, for the mean over all objects of just these.

The estimand is the mean over objects of the very categories that are scored, each with its share of
the objects, as on the split ``unseen``: its thirty categories are named by the protocol. What is
drawn are the objects of each category; what differs between categories is no chance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64

__all__ = ["Strata", "strata"]


@dataclass(frozen=True, slots=True, eq=False)
class Strata:
    """Scores by category.

    Parameters
    ----------
    scores
        Of each category, shape (objects, columns), at least two objects.
    """

    scores: tuple[Float64[np.ndarray, "_ columns"], ...]

    @property
    def objects(self) -> int:
        """How many objects there are in all."""
        return sum(len(own) for own in self.scores)

    @property
    def means(self) -> Float64[np.ndarray, "columns"]:
        """Means over objects."""
        return np.asarray(np.concatenate(self.scores).mean(axis=0))

    @property
    def influences(self) -> Float64[np.ndarray, "objects columns"]:
        """How much each object moves the mean: the norm of a column is its standard error.

        The variances of the categories' means, added up: Cochran, *Sampling Techniques*, 3rd ed.,
        1977, eq. 5.12, without finite populations.
        """
        moved = [
            np.sqrt(len(own) / (len(own) - 1)) * (own - own.mean(axis=0)) for own in self.scores
        ]
        return np.asarray(np.concatenate(moved) / self.objects)

    @property
    def errors(self) -> Float64[np.ndarray, "columns"]:
        """Standard errors of the means."""
        return np.asarray(np.linalg.norm(self.influences, axis=0))

    @property
    def degrees_of_freedom(self) -> int:
        """As many less than there are objects as there are categories."""
        return self.objects - len(self.scores)

    @property
    def is_positive(self) -> Bool[np.ndarray, "columns"]:
        """Which columns are positive for every object."""
        return np.asarray(np.all([own.min(axis=0) > 0 for own in self.scores], axis=0))

    def resampled(
        self, resamples: int, seed: int
    ) -> tuple[Float64[np.ndarray, "resamples columns"], Float64[np.ndarray, "resamples columns"]]:
        """Mean and standard error of resamples: of each category as many objects as it has.

        The same seed and numbers of objects give the same draws, whatever the column.
        """
        rng = np.random.default_rng(seed)
        columns = self.scores[0].shape[1]
        shifts, variances = np.zeros((2, resamples, columns))
        for own in self.scores:
            count = len(own)
            # about the category's mean, so that the squares differ by little
            residuals = own - own.mean(axis=0)
            counts = rng.multinomial(count, np.full(count, 1 / count), size=resamples).astype(float)
            shift = counts @ residuals
            squares = counts @ residuals**2 - shift**2 / count
            shifts += shift
            variances += count / (count - 1) * np.maximum(squares, 0.0)
        return self.means + shifts / self.objects, np.sqrt(variances) / self.objects


def strata(values: Float[np.ndarray, "objects columns"], categories: Sequence[str]) -> Strata:
    """Part objects by their category.

    Examples
    --------
    >>> made = strata(np.array([[1.0], [3.0], [8.0], [8.0]]), ["mug", "mug", "axe", "axe"])
    >>> made.means.tolist(), made.errors.tolist()
    ([5.0], [0.5])
    """
    kinds = np.array(categories)
    scores = np.asarray(values, dtype=np.float64)
    return Strata(tuple(scores[kinds == name] for name in np.unique(kinds)))
