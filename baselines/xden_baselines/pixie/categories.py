"""What objects of a category usually are, as far as those that were learned from tell.

A training object is told of the others of its category only (and, as half of one more, the mean
over all objects): else a network would come to trust what it is told more than it may when it
predicts.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64

from xden_baselines.pixie.store import Stored

__all__ = ["USUAL", "Categories", "Kind"]

_TRAITS = ("log10_material", "log10_material_spread", "empty_share", "log10_overall")
USUAL = (*_TRAITS, *(f"{name}_deviation" for name in _TRAITS), "known")
"""What is told of a category: means and deviations over its objects, and how many there were."""
PRIOR_OBJECTS = 0.5
"""The mean over all objects counts as so many objects of each category."""
MANY_OBJECTS = 10
"""So many objects or more are told as the number 1."""
SOLID, FAINTEST_G_CM3 = 0.05, 1e-3
"""Emptier voxels are left out; lower densities are raised to this."""


@dataclass(frozen=True, slots=True, eq=False)
class Kind:
    """What a network is told of an object's category.

    Parameters
    ----------
    index
        Its place among the categories; their number if it is none of them.
    usual
        Shape (9,): see :data:`USUAL`.
    """

    index: int
    usual: Float32[np.ndarray, "told"]


@dataclass(frozen=True, slots=True, eq=False)
class Categories:
    """The categories that were learned from.

    Parameters
    ----------
    names
        In alphabetical order.
    kinds
        What is told of each; one more for all other categories.
    """

    names: tuple[str, ...]
    kinds: tuple[Kind, ...]

    @classmethod
    def of(cls, objects: Sequence[Stored]) -> tuple[Categories, list[Kind]]:
        """Sum up training objects.

        Returns
        -------
        Categories
            For whatever is predicted later.
        list of Kind
            For each of these objects, what the others of its category tell.
        """
        by_category: dict[str, list[int]] = defaultdict(list)
        for index, one in enumerate(objects):
            by_category[one.category].append(index)
        traits = np.array([_traits(one) for one in objects])
        overall = traits.mean(axis=0)
        names = sorted(by_category)
        others = []
        for index, one in enumerate(objects):
            rest = [each for each in by_category[one.category] if each != index]
            others.append(Kind(names.index(one.category), _usual(traits[rest], overall)))
        known = [
            Kind(place, _usual(traits[by_category[name]], overall))
            for place, name in enumerate(names)
        ]
        unknown = Kind(len(names), _usual(traits[:0], overall))
        return cls(tuple(names), (*known, unknown)), others

    def kind(self, category: str) -> Kind:
        """Look up what is told of a category."""
        known = category in self.names
        return self.kinds[self.names.index(category) if known else len(self.names)]

    @property
    def table(self) -> Float32[np.ndarray, "categories told"]:
        """All that is told, a row for each category and one for all others."""
        return np.array([kind.usual for kind in self.kinds])


def _traits(one: Stored) -> Float64[np.ndarray, "traits"]:
    """Return the traits of one object; one without material has that of 1 g/cm³."""
    weight = one.envelope.astype(np.float64)
    solid = one.solid.astype(np.float64)
    mean_log, spread = 0.0, 0.0
    if (filled := solid > SOLID).any():
        logs = np.log10(one.stuff_g_cm3[filled].clip(FAINTEST_G_CM3, None))
        mean_log = float(np.average(logs, weights=(weight * solid)[filled]))
        spread = float(logs.std())
    empty = float(np.average(1 - solid, weights=weight))
    return np.array([mean_log, spread, empty, np.log10(max(one.overall_g_cm3, FAINTEST_G_CM3))])


def _usual(
    traits: Float64[np.ndarray, "objects traits"], overall: Float64[np.ndarray, "traits"]
) -> Float32[np.ndarray, "told"]:
    """Mean, drawn a little to that of all objects, deviation, and number of objects."""
    count = len(traits)
    mean = (traits.sum(axis=0) + PRIOR_OBJECTS * overall) / (count + PRIOR_OBJECTS)
    deviation = traits.std(axis=0) if count else np.zeros(len(overall))
    return np.array([*mean, *deviation, min(count, MANY_OBJECTS) / MANY_OBJECTS], dtype=np.float32)
