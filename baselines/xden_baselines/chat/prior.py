"""What objects of a category consisted of in the training split: needs no model."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable

import numpy as np

from xden1k.errors import DataError
from xden1k.predictor import Example, Examples
from xden1k.values.thickness import plate_thickness_cm
from xden_baselines.chat.candidates import MAX_CANDIDATES, Candidate, Picture, Range
from xden_baselines.materials import check_target, density_range_g_cm3, material_of

__all__ = ["PriorProposer"]

QUARTILES = (0.25, 0.75)


class PriorProposer:
    """The materials most common in the training objects of a category.

    Commonest first by the number of objects that contain them, ties by name; where a category has
    fewer than five, those most common in all objects follow. Densities are the material library's
    ranges. Thicknesses are the quartiles, over the training parts of the material, of what a plate
    of the part's volume and surface would have.

    Parameters
    ----------
    train
        The training split; targets must be true densities, which the library's are.

    Raises
    ------
    DataError
        If the target is another, or no training part has a material.
    """

    source = "material prior of the training split"
    fallbacks = 0

    def __init__(self, train: Examples) -> None:
        check_target(train)
        self._by_category, thicknesses = _survey(train)
        self._overall = sum(self._by_category.values(), Counter[str]())
        if not self._overall:
            raise DataError(f"no part of the split {train.split!r} has a material")
        self._candidates = {
            name: Candidate(_spoken(name), density_range_g_cm3(name), _quartiles(values))
            for name, values in thicknesses.items()
        }

    def propose(
        self, object_id: str, category: str, picture: Picture | None = None
    ) -> tuple[Candidate, ...]:
        """Give the candidates of a category; those of all objects for an unseen one."""
        common = _commonest(self._by_category.get(category, Counter()))
        names = dict.fromkeys([*common, *_commonest(self._overall)])
        return tuple(self._candidates[name] for name in list(names)[:MAX_CANDIDATES])


def _survey(train: Iterable[Example]) -> tuple[dict[str, Counter[str]], dict[str, list[float]]]:
    """Count the objects with each material, by category; thicknesses of the parts by material."""
    objects: dict[str, Counter[str]] = defaultdict(Counter)
    thicknesses: dict[str, list[float]] = defaultdict(list)
    for example in train:
        truth = example.truth
        found = [(name, part.mesh) for part in truth.parts if (name := material_of(part))]
        objects[truth.category].update({name for name, _ in found})
        for name, mesh in found:
            thicknesses[name].append(plate_thickness_cm(mesh))
    return dict(objects), dict(thicknesses)


def _commonest(counts: Counter[str]) -> list[str]:
    return sorted(counts, key=lambda name: (-counts[name], name))


def _quartiles(values: list[float]) -> Range:
    low, high = np.quantile(values, QUARTILES).tolist()
    return low, high


def _spoken(name: str) -> str:
    return name.replace("_", " ")
