"""What objects of a category usually are, as far as those that were learned from tell.

A training object is told of some of the others of its category (and, as half of one more, of the
mean over all objects), drawn anew each time. Told of itself, or always of all others, a network
would learn to trust what it is told more than it may when it predicts: what all others lack of the
category's sum is the object itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64, Int64

from xden_baselines.pixie.store import Stored

__all__ = ["USUAL", "Categories", "Kind", "Peers"]

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

    def kind(self, category: str) -> Kind:
        """Look up what is told of a category."""
        known = category in self.names
        return self.kinds[self.names.index(category) if known else len(self.names)]

    @property
    def table(self) -> Float32[np.ndarray, "categories told"]:
        """All that is told, a row for each category and one for all others."""
        return np.array([kind.usual for kind in self.kinds])


@dataclass(frozen=True, slots=True, eq=False)
class Peers:
    """Training objects, and what each can be told of the others of its category.

    Parameters
    ----------
    categories
        For whatever is predicted later: what all of a category tell.
    traits
        Shape (objects, 4): of each object.
    of_category
        The numbers of the objects of each category, in its order.
    place
        Of each object's category.
    """

    categories: Categories
    traits: Float64[np.ndarray, "objects traits"]
    of_category: tuple[Int64[np.ndarray, "_"], ...]
    place: Int64[np.ndarray, "objects"]

    @classmethod
    def of(cls, objects: Sequence[Stored]) -> Peers:
        """Sum up training objects."""
        names, place = np.unique([one.category for one in objects], return_inverse=True)
        traits = np.array([_traits(one) for one in objects])
        of_category = tuple(np.flatnonzero(place == index) for index in range(len(names)))
        overall = traits.mean(axis=0)
        told = [traits[numbers] for numbers in of_category] + [traits[:0]]
        kinds = tuple(Kind(index, _usual(each, overall)) for index, each in enumerate(told))
        return cls(Categories(tuple(names.tolist()), kinds), traits, of_category, place)

    def drawn(self, number: int, rng: np.random.Generator) -> Kind:
        """Tell an object of some others of its category: any number of them, none included."""
        place = int(self.place[number])
        others = self.of_category[place]
        others = rng.permutation(others[others != number])
        some = others[: rng.integers(len(others), endpoint=True)]
        return Kind(place, _usual(self.traits[some], self.traits.mean(axis=0)))


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
