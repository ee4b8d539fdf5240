"""The closed list of materials that are voted on."""

from __future__ import annotations

import csv
from collections import Counter
from dataclasses import dataclass
from importlib.resources import files

import numpy as np
from jaxtyping import Float

from xden1k.errors import DataError
from xden1k.predictor import Examples
from xden_baselines.chat.candidates import Range
from xden_baselines.materials import check_target, density_range_g_cm3, material_of

__all__ = ["ClosedList", "closed_list", "published_list"]


@dataclass(frozen=True, slots=True)
class ClosedList:
    """Materials to choose from. Their order decides ties.

    Parameters
    ----------
    names
        Each once; of the material library, or families of it, where no densities are given.
    objects
        How many training objects contain each; 1 for each where nothing was learned.
    given_g_cm3
        Low and high density of each; empty for the material library's.

    Raises
    ------
    DataError
        If there is none, one comes twice, or counts or densities are not one for each.
    """

    names: tuple[str, ...]
    objects: tuple[int, ...]
    given_g_cm3: tuple[Range, ...] = ()

    def __post_init__(self) -> None:
        if not self.names or len(set(self.names)) < len(self.names):
            raise DataError(f"a list of materials must name some, each once, got {self.names}")
        if len(self.objects) != len(self.names) or min(self.objects) < 1:
            raise DataError(f"expected a count for each of {self.names}, got {self.objects}")
        if len(self.given_g_cm3) not in (0, len(self.names)):
            raise DataError(f"expected a range for each of {self.names}, got {self.given_g_cm3}")

    def __len__(self) -> int:
        return len(self.names)

    @property
    def ranges_g_cm3(self) -> Float[np.ndarray, "materials 2"]:
        """Low and high of each."""
        return np.array(self.given_g_cm3 or [density_range_g_cm3(name) for name in self.names])

    @property
    def middles_g_cm3(self) -> Float[np.ndarray, "materials"]:
        """Middle of each range."""
        return np.asarray(self.ranges_g_cm3.mean(axis=1))

    @property
    def shares(self) -> Float[np.ndarray, "materials"]:
        """How common each is in training; adds up to 1."""
        return np.array(self.objects) / sum(self.objects)


def published_list() -> ClosedList:
    """Return the twelve materials of the original's paper, in its order.

    The text gives the densities of five; the others' are the material library's.

    Examples
    --------
    >>> published_list().names[:3]
    ('wood', 'aluminium', 'steel')
    """
    file = files("xden_baselines.gaussian_property") / "published_list.csv"
    rows = list(csv.DictReader(file.read_text(encoding="utf-8").splitlines()))
    ranges = ((float(row["density_low_g_cm3"]), float(row["density_high_g_cm3"])) for row in rows)
    return ClosedList(tuple(row["name"] for row in rows), (1,) * len(rows), tuple(ranges))


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
