"""Means over objects whose categories were drawn, for the mean over a population of categories.

The estimand is the mean over objects of a population of categories and of objects within them,
sampled as the split ``test`` is: categories at random, then objects of each. Objects of one
category hang together, so that the independent draws are the categories, not the objects.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float, Float64

from xden_bench.scoring.bootstrap import CHUNK

__all__ = ["CategorySums", "category_sums"]


@dataclass(frozen=True, slots=True, eq=False)
class CategorySums:
    """What a mean over objects and its error need of each category.

    Parameters
    ----------
    sums
        Shape (categories, columns): sums over the objects of each category.
    sizes
        Shape (categories,): how many objects each has.
    """

    sums: Float64[np.ndarray, "categories columns"]
    sizes: Float64[np.ndarray, "categories"]

    @property
    def means(self) -> Float64[np.ndarray, "columns"]:
        """Means over objects."""
        means: Float64[np.ndarray, "columns"] = self.sums.sum(axis=0) / self.sizes.sum()
        return means

    @property
    def macro_means(self) -> Float64[np.ndarray, "columns"]:
        """Means over categories of the means of their objects."""
        means: Float64[np.ndarray, "columns"] = (self.sums / self.sizes[:, None]).mean(axis=0)
        return means

    @property
    def influences(self) -> Float64[np.ndarray, "categories columns"]:
        """How much each category moves the mean: the norm of a column is its standard error.

        The linearisation of a ratio of two sums, with the usual factor for few clusters (Liang &
        Zeger, 1986, doi:10.1093/biomet/73.1.13; CR1). Zero for a single category.
        """
        residuals = self.sums - self.sizes[:, None] * self.means
        scale = np.sqrt(len(self.sizes) / max(len(self.sizes) - 1, 1)) / self.sizes.sum()
        influences: Float64[np.ndarray, "categories columns"] = scale * residuals
        return influences

    @property
    def errors(self) -> Float64[np.ndarray, "columns"]:
        """Standard errors of the means."""
        errors: Float64[np.ndarray, "columns"] = np.linalg.norm(self.influences, axis=0)
        return errors

    @property
    def degrees_of_freedom(self) -> int:
        """One less than there are categories."""
        return len(self.sizes) - 1

    @property
    def is_positive(self) -> Bool[np.ndarray, "columns"]:
        """Which columns are positive in every category."""
        return np.asarray(np.all(self.sums > 0, axis=0))

    def resampled(
        self, resamples: int, seed: int
    ) -> tuple[Float64[np.ndarray, "resamples columns"], Float64[np.ndarray, "resamples columns"]]:
        """Mean and standard error of resamples: categories with replacement, each whole.

        The same seed and number of categories give the same draws, whatever the column.
        """
        parts = [_drawn(self, counts) for counts in _counts(len(self.sizes), resamples, seed)]
        means, errors = (np.concatenate(column) for column in zip(*parts, strict=True))
        return means, errors


def category_sums(
    values: Float[np.ndarray, "objects columns"], categories: Sequence[str]
) -> CategorySums:
    """Sum the objects of each category.

    Parameters
    ----------
    values
        Shape (objects, columns), at least one object.
    categories
        Of each object.

    Examples
    --------
    >>> made = category_sums(np.array([[1.0], [3.0], [8.0]]), ["mug", "mug", "axe"])
    >>> made.means.tolist(), made.macro_means.tolist()
    ([4.0], [5.0])
    """
    _, places, sizes = np.unique(list(categories), return_inverse=True, return_counts=True)
    order = np.argsort(places, kind="stable")
    first = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    sums = np.add.reduceat(np.asarray(values, dtype=np.float64)[order], first, axis=0)
    return CategorySums(sums, sizes.astype(np.float64))


def _drawn(
    sums: CategorySums, counts: Float64[np.ndarray, "draws categories"]
) -> tuple[Float64[np.ndarray, "draws columns"], Float64[np.ndarray, "draws columns"]]:
    """Mean and standard error of resamples that take each category so many times.

    The residuals are about the mean of the whole, so that the squares differ by little.
    """
    total = counts @ sums.sizes[:, None]
    residuals = sums.sums - sums.sizes[:, None] * sums.means
    shift = counts @ residuals / total
    squares = counts @ residuals**2 - 2 * shift * (counts @ (residuals * sums.sizes[:, None]))
    squares += shift**2 * (counts @ sums.sizes[:, None] ** 2)
    factor = len(sums.sizes) / max(len(sums.sizes) - 1, 1)
    return sums.means + shift, np.sqrt(factor * np.maximum(squares, 0.0)) / total


@lru_cache(maxsize=2)
def _counts(
    categories: int, resamples: int, seed: int
) -> tuple[Float64[np.ndarray, "draws categories"], ...]:
    """How often each resample takes each category: the same for every row of a table."""
    rng = np.random.default_rng(seed)
    even = np.full(categories, 1 / categories)
    return tuple(
        rng.multinomial(categories, even, size=min(CHUNK, resamples - first)).astype(np.float64)
        for first in range(0, resamples, CHUNK)
    )
