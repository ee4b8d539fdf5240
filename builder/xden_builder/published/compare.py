"""Masses as published against ours: what other densities do to them, by category."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby
from statistics import median
from typing import Any, Final

import numpy as np
from tabulate import tabulate

from xden1k.errors import DataError
from xden1k.folder import DatasetFolder
from xden1k.format.records import split_meshes
from xden1k.format.shards import Row

__all__ = ["CategoryChange", "MassChange", "by_category", "change_table", "mass_changes"]

_COLUMNS: Final = (
    *("object_id", "category", "source", "flags", "part_names", "part_flags"),
    *("part_apparent_density_g_cm3", "part_density_g_cm3"),
    *("mesh_vertices", "mesh_faces", "face_part"),
)
_HEADS: Final = (
    *("category", "objects", "as published, g", "ours, g", "published / ours"),
    *("largest change", "there", "its flags"),
)


@dataclass(frozen=True, slots=True)
class MassChange:
    """Mass of an object of the release by its own densities and by ours.

    Parameters
    ----------
    object_id, category
        As in the dataset.
    published_g, ours_g
        Volumes of the part meshes times ``apparent_density`` and times ``density``.
    part
        The part whose mass changes most.
    flags
        Of the object and of that part, each once.
    """

    object_id: str
    category: str
    published_g: float
    ours_g: float
    part: str
    flags: tuple[str, ...]

    @property
    def ratio(self) -> float:
        """How many times as heavy as ours the published mass is."""
        return self.published_g / self.ours_g


@dataclass(frozen=True, slots=True)
class CategoryChange:
    """The same of a category.

    Parameters
    ----------
    category
        Its name.
    objects
        How many have both masses.
    published_g, ours_g, ratio
        Medians over them.
    largest
        The object whose mass changes by the largest factor, up or down.
    """

    category: str
    objects: int
    published_g: float
    ours_g: float
    ratio: float
    largest: MassChange


def mass_changes(folder: DatasetFolder) -> Iterator[MassChange]:
    """Compare the objects of the authors' release in a dataset folder, in the order of their ids.

    An object of which only the attenuation is known has no mass of ours, and is passed over.

    Raises
    ------
    DataError
        If the folder has no object of the source ``published``.
    """
    if not (published := folder.manifest.sources.get("published")):
        sources = ", ".join(folder.manifest.sources)
        raise DataError(
            f"{folder.root}: masses as published are those of the source 'published', of which "
            f"there are {published or 0} objects among {sources}"
        )
    for row in folder.rows(columns=_COLUMNS):
        known = np.isfinite(row["part_density_g_cm3"]).all()
        if row["source"] == "published" and known:
            yield _mass_change(row)


def _mass_change(row: Row) -> MassChange:
    volumes_cm3 = np.array([mesh.volume if len(mesh.faces) else 0.0 for mesh in split_meshes(row)])
    published_g = volumes_cm3 * row["part_apparent_density_g_cm3"]
    ours_g = volumes_cm3 * row["part_density_g_cm3"]
    part = int(np.abs(published_g - ours_g).argmax())
    return MassChange(
        object_id=row["object_id"],
        category=row["category"],
        published_g=float(published_g.sum()),
        ours_g=float(ours_g.sum()),
        part=row["part_names"][part],
        flags=tuple(dict.fromkeys([*row["flags"], *row["part_flags"][part]])),
    )


def by_category(changes: Iterable[MassChange]) -> list[CategoryChange]:
    """Gather the changes of each category, the one that changes by the largest factor first."""
    ordered = sorted(changes, key=lambda one: one.category)
    gathered = [
        _gathered(category, list(ones))
        for category, ones in groupby(ordered, key=lambda one: one.category)
    ]
    return sorted(gathered, key=lambda one: -abs(math.log(one.ratio)))


def _gathered(category: str, changes: list[MassChange]) -> CategoryChange:
    return CategoryChange(
        category=category,
        objects=len(changes),
        published_g=median(one.published_g for one in changes),
        ours_g=median(one.ours_g for one in changes),
        ratio=median(one.ratio for one in changes),
        largest=max(changes, key=lambda one: abs(math.log(one.ratio))),
    )


def change_table(changes: Iterable[MassChange]) -> str:
    """Text of the comparison: a line on all objects, and a table by category."""
    if not (every := list(changes)):
        return "0 objects have a mass as published and one of ours."
    ratios = np.quantile([one.ratio for one in every], (0.1, 0.5, 0.9))
    published_kg = sum(one.published_g for one in every) / 1000
    ours_kg = sum(one.ours_g for one in every) / 1000
    return (
        f"{len(every)} objects: {published_kg:.4g} kg as published, {ours_kg:.4g} kg by ours; "
        f"published / ours: median {ratios[1]:.2f}, 10 to 90 % {ratios[0]:.2f} to {ratios[2]:.2f}"
        f"\n\n{tabulate(map(_cells, by_category(every)), _HEADS, disable_numparse=True)}"
    )


def _cells(one: CategoryChange) -> tuple[Any, ...]:
    largest = one.largest
    return (
        one.category,
        one.objects,
        f"{one.published_g:.4g}",
        f"{one.ours_g:.4g}",
        f"{one.ratio:.2f}",
        f"{largest.object_id}, {largest.part}",
        f"{largest.ratio:.2f}",
        ", ".join(largest.flags),
    )
