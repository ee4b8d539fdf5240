"""The closed list of materials that are voted on."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from xden1k.errors import DataError
from xden1k.predictor import Examples
from xden_baselines.materials import check_target, density_range_g_cm3, material_of

__all__ = ["ClosedList", "closed_list"]


@dataclass(frozen=True, slots=True)
class ClosedList:
    """Materials to choose from. Their order decides ties.

    Parameters
    ----------
    names
        Of the material library, or families of it; each once.
    objects
        How many training objects contain each.

    Raises
    ------
    DataError
        If there is none, one comes twice, or the counts are not one for each.
    """

    names: tuple[str, ...]
    objects: tuple[int, ...]

    def __post_init__(self) -> None:
        if not self.names or len(set(self.names)) < len(self.names):
            raise DataError(f"a list of materials must name some, each once, got {self.names}")
        if len(self.objects) != len(self.names) or min(self.objects) < 1:
            raise DataError(f"expected a count for each of {self.names}, got {self.objects}")

    def __len__(self) -> int:
        return len(self.names)

    @property
    def ranges_g_cm3(self) -> Float[np.ndarray, "materials 2"]:
        """Low and high of each, from the material library."""
        return np.array([density_range_g_cm3(name) for name in self.names])

    @property
    def middles_g_cm3(self) -> Float[np.ndarray, "materials"]:
        """Middle of each range."""
        return np.asarray(self.ranges_g_cm3.mean(axis=1))

    @property
    def shares(self) -> Float[np.ndarray, "materials"]:
        """How common each is in training; adds up to 1."""
        return np.array(self.objects) / sum(self.objects)


def closed_list(train: Examples) -> ClosedList:
    """Return the materials of the training split, those in most objects first, ties by name.

    The originals' list of about 600 materials was not published.

    Raises
    ------
    DataError
        If the targets are no true densities, which the library's are, or no material is known.
    """
    check_target(train)
    counts: Counter[str] = Counter()
    for example in train:
        counts.update({name for part in example.truth.parts if (name := material_of(part))})
    if not counts:
        raise DataError(f"no part of the split {train.split!r} has a material")
    names = tuple(sorted(counts, key=lambda name: (-counts[name], name)))
    return ClosedList(names, tuple(counts[name] for name in names))
