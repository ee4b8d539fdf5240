"""What a release holds, said before any heavy work: one page that shows what a reader gets wrong.

Every count is by role, beside the names that no role took, so that a wrong guess of a name can be
mended from the page alone.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar

import numpy as np

from xden1k.errors import DataError
from xden_builder.published.given import PublishedObject
from xden_builder.published.reading import HubSource, Item, Release, Unit, read_item, unit_of
from xden_builder.published.reading.item import read_part_table
from xden_builder.published.reading.layout import ObjectFolder
from xden_builder.published.reading.roles import Role
from xden_builder.published.reading.table import PartTable
from xden_builder.published.reading.volume import VolumeHeader, read_header

__all__ = ["MOST_READ", "DryRun", "dry_run"]

MOST_READ: Final = 10
"""Objects whose meshes and volumes are read."""
MOST_NAMES: Final = 12
"""Names of unknown files that are shown, each with its first place."""
LIKE: Final = 0.004
MOST_APART: Final = 1.2
"""Ratio of the largest to the least of size / extent: meshes lose a few per cent of a side, where
what they stand on was not seen, and another thing has other proportions."""

Result = TypeVar("Result")

COUNTED: Final[tuple[Role, ...]] = ("mesh", "volume", "table", "image")


@dataclass(frozen=True, slots=True)
class DryRun:
    """What was found.

    Parameters
    ----------
    values
        Of JSON's types, in the order of the page.
    mismatches
        One line for each thing that is not as expected, in the order of the objects.
    """

    values: Mapping[str, Any]
    mismatches: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON."""
        return {**self.values, "mismatches": list(self.mismatches)}

    @property
    def text(self) -> str:
        """Page for people."""
        lines = [f"{name:<15}{_line(value)}" for name, value in self.values.items()]
        count = len(self.mismatches)
        first = self.mismatches[0] if self.mismatches else "none"
        more = f" (and {count - 1} more)" if count > 1 else ""
        return "\n".join([*lines, f"{'first mismatch':<15}{first}{more}"])


def _line(value: object) -> str:
    if isinstance(value, dict):
        return "   ".join(f"{key} {_line(each)}" for key, each in value.items() if each != {})
    if isinstance(value, list):
        return ", ".join(map(_line, value)) or "none"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def dry_run(
    release: Release, folders: Sequence[ObjectFolder], size_unit: Unit | None = None
) -> DryRun:
    """Look at a release.

    Of a repository only the names and the metadata are looked at; nothing else is downloaded.

    Parameters
    ----------
    release
        What to look at.
    folders
        Objects that were asked for.
    size_unit
        Of the sizes; None: cm, which is checked.
    """
    unit, of_unit = _unit(release, size_unit)
    values: dict[str, Any] = {
        "source": _source(release, folders),
        "objects": _objects(folders),
        "metadata": _metadata(release, folders),
        "other files": _others(release),
    }
    values |= {role: _role(folders, role) for role in COUNTED}
    if isinstance(release.source, HubSource):
        values["not looked at"] = "what is in the files: they are not downloaded"
        return DryRun(values, (*of_unit, *_of_names(release, folders)))
    items = release.items(folders, release.source.fetch(()), unit)
    headers, tables, wrong = _heads(items)
    values["volumes"] = _volumes(headers)
    values["tables"] = _tables(tables)
    read, unread = _each(items[:MOST_READ], lambda item: _figures(read_item(item)))
    values[f"first {len(items[:MOST_READ])}"] = _read(list(read.values()))
    with_parts = sum(table is not None for table in tables.values())
    values["would write"] = {
        "named parts": with_parts,
        "parts from volume": len(tables) - with_parts,
    }
    mismatches = {**_unlike(read), **wrong, **unread, **_problems(items)}
    found = [mismatches[item.object_id] for item in items if item.object_id in mismatches]
    return DryRun(values, (*of_unit, *found))


def _unit(release: Release, told: Unit | None) -> tuple[Unit, tuple[str, ...]]:
    """Give the unit of the sizes, and what is wrong with it."""
    try:
        return told or unit_of(release), ()
    except DataError as err:
        return "cm", (str(err),)


def _source(release: Release, folders: Sequence[ObjectFolder]) -> dict[str, Any]:
    values: dict[str, Any] = {
        "name": release.source.name,
        "commit": release.source.commit or "none",
        "files": len(release.files),
        "MB": release.bytes / 1e6,
    }
    if isinstance(release.source, HubSource):
        needed = release.needed(folders)
        values["MB to download"] = release.source.missing_bytes(needed) / 1e6
        values["MB free"] = release.source.free_bytes() / 1e6
    return values


def _objects(folders: Sequence[ObjectFolder]) -> dict[str, Any]:
    numbers = {int(each.key) for each in folders if each.key.isdecimal()}
    span = range(min(numbers), max(numbers) + 1) if numbers else range(0)
    return {
        "folders": len(folders),
        "first": folders[0].key,
        "last": folders[-1].key,
        "missing": sorted(set(span) - numbers),
    }


def _metadata(release: Release, folders: Sequence[ObjectFolder]) -> dict[str, Any]:
    if release.metadata is None:
        return {"entries": 0, "problem": release.problem}
    values = release.metadata.values
    found = sum(each.key in release.metadata.keys for each in folders)
    fields = Counter(
        field for value in values.values() if isinstance(value, dict) for field in value
    )
    return {
        "file": str(release.metadata.path),
        "entries": len(values),
        "fields": dict(fields),
        "keys": f"by {release.metadata.rule}",
        "objects found": found,
    }


def _role(folders: Sequence[ObjectFolder], role: Role) -> dict[str, Any]:
    names = Counter(file.name for each in folders for file in each.files[role])
    return {
        "objects": sum(bool(each.files[role]) for each in folders),
        "of": len(folders),
        "names": dict(names.most_common(MOST_NAMES)),
    }


def _others(release: Release) -> list[str]:
    """Each name that no role took, with its count and first place."""
    first: dict[str, str] = {}
    for file in release.layout.others:
        first.setdefault(file.name, str(file))
    counts = Counter(file.name for file in release.layout.others)
    shown = [f"{name} ({counts[name]}, first {first[name]})" for name in sorted(first)]
    return shown[:MOST_NAMES] + [f"and {len(shown) - MOST_NAMES} more"] * (len(shown) > MOST_NAMES)


def _of_names(release: Release, folders: Sequence[ObjectFolder]) -> Iterator[str]:
    """Yield what names alone tell to be wrong."""
    for folder in folders:
        try:
            release.entry(folder.key)
            folder.one("mesh")
            folder.one("volume")
            folder.one_or_none("table")
        except DataError as err:
            yield str(err)


def _problems(items: Sequence[Item]) -> dict[str, str]:
    return {item.object_id: item.problem for item in items if item.problem}


def _heads(
    items: Sequence[Item],
) -> tuple[dict[str, VolumeHeader], dict[str, PartTable | None], dict[str, str]]:
    """Read what is small of every object: the head of its volume, and its table."""
    headers, no_header = _each(items, lambda item: read_header(_volume_path(item)))
    tables, no_table = _each(items, read_part_table)
    _, no_mesh = _each(items, lambda item: item.folder.one("mesh"))
    return headers, tables, {**no_mesh, **no_table, **no_header}


def _unlike(read: Mapping[str, _Figures]) -> dict[str, str]:
    """Name objects whose sizes are of another shape than their meshes."""
    return {
        object_id: f"metadata: {object_id}: expected a size with the proportions of the mesh, got "
        f"sides {one.size_spread:.2g} times apart: another object's entry, or shifted keys"
        for object_id, one in read.items()
        if one.size_spread > MOST_APART
    }


def _volume_path(item: Item) -> Path:
    return item.root / item.folder.one("volume")


def _each(
    items: Sequence[Item], read: Callable[[Item], Result]
) -> tuple[dict[str, Result], dict[str, str]]:
    """Read something of each object, and say why it cannot be read."""
    found, wrong = {}, {}
    for item in items:
        try:
            found[item.object_id] = read(item)
        except DataError as err:
            wrong[item.object_id] = str(err)
    return found, wrong


def _volumes(headers: Mapping[str, VolumeHeader]) -> dict[str, Any]:
    every = list(headers.values())
    return {
        "shapes": dict(Counter(" ".join(map(str, head.shape)) for head in every)),
        "types": dict(Counter(head.dtype for head in every)),
        "affine identity": sum(head.identity for head in every),
        "of": len(every),
    }


def _tables(tables: Mapping[str, PartTable | None]) -> dict[str, Any]:
    known = [table for table in tables.values() if table is not None]
    return {
        "read": len(known),
        "with Density": sum(bool(table.density_g_cm3) for table in known),
        "Density = LAC / 0.17": sum(not table.other_rule for table in known),
        "parts": sum(len(table.lac_per_cm) for table in known),
    }


class _Figures(NamedTuple):
    """What is kept of an object that was read, which itself takes 100 MB."""

    extent: float
    levels_met: int
    parts: int
    size_spread: float
    flags: list[str]


def _figures(given: PublishedObject) -> _Figures:
    return _Figures(
        float(np.ptp(given.mesh.bounds, axis=0).max()),
        _levels_met(given),
        len(given.table_lac_per_cm),
        _size_spread(given),
        given.meta["flags"],
    )


def _read(objects: Sequence[_Figures]) -> dict[str, Any]:
    """Sum up the objects that were read."""
    if not objects:
        return {"read": 0}
    extents = [one.extent for one in objects]
    return {
        "read": len(objects),
        "mesh extent": [min(extents), max(extents)],
        "parts whose level is in the volume": sum(one.levels_met for one in objects),
        "parts in tables": sum(one.parts for one in objects),
        "size against extents, worst": max(one.size_spread for one in objects),
        "flags": dict(Counter(flag for one in objects for flag in one.flags)),
    }


def _levels_met(given: PublishedObject) -> int:
    return sum(
        bool((np.abs(given.lac_per_cm - level) <= LIKE * level).any())
        for level in given.table_lac_per_cm.values()
    )


def _size_spread(given: PublishedObject) -> float:
    """How far the sorted sides are from one scale of the sorted extents: 1 is the same shape."""
    ratio = np.sort(given.size_cm) / np.sort(np.ptp(given.mesh.bounds, axis=0))
    return float(ratio.max() / ratio.min())
