"""What a region looks like, and which material of the training split most likely looks like that.

The classifier is a mixture of Gaussians of one width around centroids of each material, weighted
by how common they are: many materials come in the same grey, and then the commonest must win.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64
from scipy.cluster.vq import kmeans2

from xden1k.errors import DataError
from xden1k.predictor import Example, Examples
from xden_baselines.chat.candidates import Picture
from xden_baselines.gaussian_property.library import ClosedList
from xden_baselines.gaussian_property.regions import Segmentation, kept_regions, part_numbers
from xden_baselines.materials import material_of
from xden_baselines.views.pictures import Pictures

__all__ = ["LOOKS", "Centroids", "fit_centroids", "looks"]

LOOKS = 6
"""Figures for each region."""
CENTROIDS = 8
"""Of each material, at most: a plastic comes in several colours."""
NARROWEST = 0.1
"""Least spread, in deviations of the looks: a few alike objects must not make it certain."""
FINEST = 0.02
"""Least deviation of a figure: colours have 8 bits, and shading moves a region's mean."""
TRAINING_OBJECTS, TRAINING_VIEWS = 200, 4
"""Drawn by the seed: colours repeat, and drawing pictures is what learning costs."""

Looks = Float64[np.ndarray, "regions 6"]


@dataclass(frozen=True, slots=True, eq=False)
class Centroids:
    """What the materials of a training split look like.

    Parameters
    ----------
    places
        Shape (centroids, 6), in looks of deviation 1.
    materials
        Shape (centroids,): whose they are, as an index into the closed list.
    sizes
        Shape (centroids,): how many training regions are around each, at least 1.
    deviation
        Shape (6,): of each figure over the training regions.
    spread
        Typical distance of a training region from the centroid it belongs to.

    Raises
    ------
    DataError
        If there is no centroid, or a size, a deviation or the spread is not positive.
    """

    places: Float64[np.ndarray, "centroids 6"]
    materials: Int64[np.ndarray, "centroids"]
    sizes: Int64[np.ndarray, "centroids"]
    deviation: Float64[np.ndarray, "6"]
    spread: float

    def __post_init__(self) -> None:
        shapes = {len(self.places), len(self.materials), len(self.sizes)}
        if len(shapes) > 1 or not len(self.places):
            raise DataError(f"expected places, materials and sizes of centroids, got {shapes}")
        if not (self.sizes.min() > 0 and self.deviation.min() > 0 and self.spread > 0):
            raise DataError("sizes, deviations and the spread of centroids must be positive")

    def classify(
        self, seen: Looks
    ) -> tuple[Int64[np.ndarray, "regions"], Float64[np.ndarray, "regions"]]:
        """Return the likeliest material, of several the first of the list, and how likely it is."""
        apart = seen[:, None] / self.deviation - self.places
        log_likely = np.log(self.sizes) - (apart**2).sum(axis=-1) / (2 * self.spread**2)
        likely = np.exp(log_likely - log_likely.max(axis=1, keepdims=True))
        materials = np.zeros((len(seen), self.materials.max() + 1))
        for material in np.unique(self.materials):
            materials[:, material] = likely[:, self.materials == material].sum(axis=1)
        materials /= materials.sum(axis=1, keepdims=True)
        return materials.argmax(axis=1), materials.max(axis=1)


def looks(picture: Picture, segmentation: Segmentation) -> Looks:
    """Mean red, green and blue, shares of red and green, and deviation of brightness, by region.

    All from 0 to 1. The shares do not change with the light.
    """
    inside = segmentation > 0
    which = segmentation[inside] - 1
    colors = picture[inside] / 255.0
    light = colors.mean(axis=1)
    sizes = np.bincount(which)
    mean, mean_light, mean_square = (
        np.stack([np.bincount(which, column) for column in columns.T], axis=1) / sizes[:, None]
        for columns in (colors, light[:, None], light[:, None] ** 2)
    )
    shares = mean[:, :2] / (3 * mean_light).clip(1e-3, None)
    deviation = np.sqrt((mean_square - mean_light**2).clip(0, None))
    return np.concatenate([mean, shares, deviation], axis=1)


def fit_centroids(train: Examples, materials: ClosedList, *, seed: int) -> Centroids:
    """Learn what materials look like from the visible parts of training objects.

    Parameters
    ----------
    train
        Examples whose samples have pictures.
    materials
        What they are told apart into.
    seed
        Which objects are looked at, and where k-means begins.

    Raises
    ------
    DataError
        If no picture shows a part of known material.
    """
    rng = np.random.default_rng(seed)
    chosen = rng.permutation(len(train))[:TRAINING_OBJECTS].tolist()
    found = [pair for example in train.only(chosen) for pair in _labelled(example, materials)]
    if not found:
        raise DataError(f"split {train.split}: no picture shows a part of known material")
    seen = np.concatenate([one for one, _ in found])
    labels = np.concatenate([one for _, one in found])
    deviation = seen.std(axis=0).clip(FINEST, None)
    return _cluster(seen / deviation, labels, deviation, rng)


def _labelled(
    example: Example, materials: ClosedList
) -> Iterator[tuple[Looks, Int64[np.ndarray, "regions"]]]:
    """Tell looks and materials of the parts that a few views of an object show."""
    pictures: Pictures = example.sample.pictures
    few = pictures.take(range(0, len(pictures), max(1, len(pictures) // TRAINING_VIEWS)))
    parts = example.truth.parts
    index = {name: number for number, name in enumerate(materials.names)}
    of_part = np.array([index.get(material_of(part) or "", -1) for part in parts])
    numbers = part_numbers([part.mesh for part in parts], few.cameras)
    for view in range(len(few)):
        known = few.masks[view] & (numbers[view] > 0)
        known[known] = of_part[numbers[view][known] - 1] >= 0
        if known.any():
            segmentation, kept = kept_regions(numbers[view], known)
            yield looks(few.colors[view], segmentation), of_part[kept - 1]


def _cluster(
    scaled: Looks,
    labels: Int64[np.ndarray, "regions"],
    deviation: Float64[np.ndarray, "6"],
    rng: np.random.Generator,
) -> Centroids:
    """Give each material up to eight centroids by k-means."""
    places, owners, sizes, squares = [], [], [], []
    for material in np.unique(labels):
        own = scaled[labels == material]
        different = np.unique(own, axis=0)
        start = rng.choice(different, size=min(CENTROIDS, len(different)), replace=False)
        found, which = _kmeans(own, start)
        used, count = np.unique(which, return_counts=True)
        places.append(found[used])
        owners.append(np.full(len(used), material))
        sizes.append(count)
        squares.append(((own - found[which]) ** 2).sum(axis=1))
    spread = float(np.sqrt(np.concatenate(squares).mean()))
    return Centroids(
        np.concatenate(places),
        np.concatenate(owners),
        np.concatenate(sizes),
        deviation,
        max(spread, NARROWEST),
    )


def _kmeans(
    points: Looks, start: Float64[np.ndarray, "centroids 6"]
) -> tuple[Float64[np.ndarray, "centroids 6"], Int64[np.ndarray, "regions"]]:
    """Return centroids, some perhaps of no point, and the one of each point."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "One of the clusters is empty")
        places, which = kmeans2(points, start, minit="matrix")
    return places, which.astype(np.int64)
