"""Category and size of each object, from the one file that tells them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any, Final, Literal

from xden1k.errors import DataError
from xden_builder.published.reading.tolerant import field_named, is_number, parse_object

__all__ = ["Entry", "KeyRule", "Metadata", "find_metadata"]

CATEGORY: Final = ("category",)
SIZE: Final = ("size", "scale", "dimensions", "bbox")
AXES: Final = 3

KeyRule = Literal["numbers", "names", "from one"]
"""How folders are found: by number, by name, or by number with the first folder being 1."""


@dataclass(frozen=True, slots=True)
class Entry:
    """What the metadata tell of one object.

    Parameters
    ----------
    category
        Lower snake case.
    told_category
        As it is spelt.
    size
        Three sides of the bounding box, or one number, the longest; in the release's unit.
    """

    category: str
    told_category: str
    size: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Metadata:
    """The file of categories and sizes.

    Parameters
    ----------
    path
        Relative to the release.
    values
        As they were read, by key.
    keys
        Key of each object's folder; what it lacks is not told.
    rule
        How these were found.
    """

    path: PurePosixPath
    values: Mapping[str, Any]
    keys: Mapping[str, str]
    rule: KeyRule

    def entry(self, folder: str) -> Entry:
        """Return what is told of the object in a folder.

        Raises
        ------
        DataError
            If there is no entry, or it lacks a category or a size.
        """
        if folder not in self.keys:
            raise DataError(f"{self.path}: expected an entry for folder {folder}, got none")
        key = self.keys[folder]
        told = field_named(self.values[key], CATEGORY)
        category = re.sub(r"[^a-z0-9]+", "_", str(told or "").lower()).strip("_")
        if not isinstance(told, str) or not category:
            raise DataError(f"{self.path}: entry {key}: expected a category, got {told!r}")
        return Entry(category, told, self._size(key))

    def _size(self, key: str) -> tuple[float, ...]:
        told = field_named(self.values[key], SIZE)
        sides = tuple(told) if isinstance(told, list) else (told,)
        sound = all(is_number(side) and side > 0 for side in sides)
        if not sound or len(sides) not in (1, AXES):
            raise DataError(
                f"{self.path}: entry {key}: expected a size of three positive numbers, got {told!r}"
            )
        return tuple(map(float, sides))


def find_metadata(
    candidates: Sequence[tuple[PurePosixPath, bytes]], folders: Sequence[str]
) -> Metadata:
    """Find the metadata among the files beside and above the objects: values have a category.

    Parameters
    ----------
    candidates
        Path and content of each, the likeliest first.
    folders
        Names of the objects' folders.

    Raises
    ------
    DataError
        If none of them is it.
    """
    met = []
    for path, content in candidates:
        try:
            values = parse_object(content, path)
        except DataError as err:
            met.append(str(err))
            continue
        if any(field_named(value, CATEGORY) is not None for value in values.values()):
            keys, rule = _matched(list(values), folders)
            return Metadata(path, values, keys, rule)
        met.append(f"{path} without a category")
    raise DataError(
        "expected metadata.json, with category and size of each object, above their folders, got "
        f"{'; '.join(met) or 'no such file'}"
    )


def _matched(keys: Sequence[str], folders: Sequence[str]) -> tuple[dict[str, str], KeyRule]:
    """Pair folders and keys: as numbers, else as given, else from one where all fit so."""
    numbers = {int(key): key for key in keys if key.isdecimal()}
    wanted = {folder: int(folder) for folder in folders if folder.isdecimal()}
    shifted = {folder: numbers.get(number + 1) for folder, number in wanted.items()}
    from_one = 0 not in numbers and 0 in wanted.values() and len(numbers) == len(folders)
    if from_one and len(wanted) == len(folders) and None not in shifted.values():
        return {folder: key for folder, key in shifted.items() if key is not None}, "from one"
    by_number = {folder: numbers[number] for folder, number in wanted.items() if number in numbers}
    if by_number:
        return by_number | {name: name for name in folders if name in keys}, "numbers"
    return {name: name for name in folders if name in keys}, "names"
