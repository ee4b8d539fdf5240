"""One density everywhere: what every other method has to beat.

All fill the envelope, the outer volume: they cannot know of cavities.
"""

from __future__ import annotations

from collections import defaultdict
from statistics import median

import numpy as np

from xden1k.predictor import Example, Examples, Prediction, SampleView
from xden1k.values.arrays import Grid
from xden1k.values.modality import Modality
from xden1k.values.types import FIELD_SIZE

__all__ = ["CategoryMedian", "TrainMedian", "Water", "Zero", "mean_density_g_cm3"]

UNSEEN = "a category unseen in training got the median of all training objects"


class _Constant:
    """What the four have in common."""

    version = "1"
    reads = Modality.GEOMETRY
    trainable = False
    external_data = False
    notes = ""

    def fit(self, train: Examples, *, seed: int) -> None:
        """Learn nothing."""


class Zero(_Constant):
    """Nothing at all: shows what a metric gives for no answer (``mass_mape`` 1.000)."""

    name = "zero"
    reads = Modality.NONE

    def predict(self, sample: SampleView) -> Grid:
        """Predict a density of 0."""
        return np.zeros((FIELD_SIZE,) * 3, dtype=np.float32)


class Water(_Constant):
    """1 g/cm³ in the envelope."""

    name = "water"

    def predict(self, sample: SampleView) -> Grid:
        """Predict water."""
        return sample.envelope


class TrainMedian(_Constant):
    """The median over the training objects of their mean density, in the envelope."""

    name = "train-median"
    trainable = True

    def fit(self, train: Examples, *, seed: int) -> None:
        """Find the median."""
        self._density_g_cm3 = median(map(mean_density_g_cm3, train))
        self.notes = f"{self._density_g_cm3:.4g} g/cm³"

    def predict(self, sample: SampleView) -> Grid:
        """Predict the median."""
        density: Grid = np.float32(self._density_g_cm3) * sample.envelope
        return density


class CategoryMedian(_Constant):
    """The median within the object's category, as train-median; of all for an unseen one."""

    name = "category-median"
    reads = Modality.GEOMETRY | Modality.CATEGORY
    trainable = True

    def fit(self, train: Examples, *, seed: int) -> None:
        """Find the medians."""
        means: dict[str, list[float]] = defaultdict(list)
        for example in train:
            means[example.sample.category].append(mean_density_g_cm3(example))
        self._by_category = {category: median(values) for category, values in means.items()}
        self._overall = median([value for values in means.values() for value in values])

    def predict(self, sample: SampleView) -> Prediction:
        """Predict the category's median."""
        value = self._by_category.get(sample.category, self._overall)
        remark = "" if sample.category in self._by_category else UNSEEN
        return Prediction(np.float32(value) * sample.envelope, remark=remark)


def mean_density_g_cm3(example: Example) -> float:
    """Mass over the volume inside the outer surface, cavities included."""
    mass = example.density_g_cm3.sum(dtype=np.float64)
    return float(mass / example.sample.envelope.sum(dtype=np.float64))
