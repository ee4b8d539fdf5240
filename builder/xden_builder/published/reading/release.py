"""A release as a whole: its objects, in one unit, each with what is known from names alone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import Final, Literal, get_args

from xden1k.errors import DataError
from xden_builder.published.reading.item import Item, object_id_of
from xden_builder.published.reading.layout import Layout, ObjectFolder, lay_out
from xden_builder.published.reading.metadata import Entry, Metadata, find_metadata
from xden_builder.published.reading.roles import Roles
from xden_builder.published.reading.source import Listed, Source

__all__ = ["UNITS", "Release", "Unit", "chosen_folders", "open_release", "unit_of"]

Unit = Literal["cm", "mm", "m"]
UNITS: Final[tuple[Unit, ...]] = get_args(Unit)
CM_PER_UNIT: Final[dict[Unit, float]] = {"cm": 1.0, "mm": 0.1, "m": 100.0}
MEDIAN_CM: Final = (1.0, 150.0)
"""The longest side of a release of everyday objects lies between these in the median."""


@dataclass(frozen=True, slots=True)
class Release:
    """What a source holds.

    Parameters
    ----------
    source
        Where the files are.
    files
        All of them.
    layout
        Which is what.
    with_images
        Whether images are radiographs.
    metadata
        None where no file tells categories and sizes, which ``problem`` says.
    problem
        Empty where there are metadata.
    """

    source: Source
    files: Sequence[Listed]
    layout: Layout
    with_images: bool
    metadata: Metadata | None
    problem: str = ""

    @property
    def bytes(self) -> int:
        """Of all files."""
        return sum(file.bytes for file in self.files)

    def entry(self, key: str) -> Entry:
        """Return what is told of an object.

        Raises
        ------
        DataError
            If nothing is.
        """
        if self.metadata is None:
            raise DataError(self.problem)
        return self.metadata.entry(key)

    def needed(self, folders: Sequence[ObjectFolder]) -> list[Listed]:
        """Files that are read to import some objects."""
        read = {file for folder in folders for file in folder.read(self.with_images)}
        told = {self.metadata.path} if self.metadata else set()
        return [file for file in self.files if file.path in read | told]

    def items(self, folders: Sequence[ObjectFolder], root: Path, unit: Unit) -> list[Item]:
        """Say of some objects what is read to make them, sorted by id.

        Raises
        ------
        DataError
            If two of them would get one id.
        """
        told = [self._item(folder, root, unit) for folder in folders]
        items = {item.object_id: item for item in told}
        if len(items) < len(told):
            raise DataError(f"{self.source.name}: names of folders are too alike to be ids")
        return [items[object_id] for object_id in sorted(items)]

    def _item(self, folder: ObjectFolder, root: Path, unit: Unit) -> Item:
        item = Item(
            object_id_of(folder.key),
            root,
            folder,
            entry=None,
            cm_per_unit=CM_PER_UNIT[unit],
            commit=self.source.commit,
            with_images=self.with_images,
        )
        try:
            return replace(item, entry=self.entry(folder.key))
        except DataError as err:
            return replace(item, problem=f"{root}/{err}" if self.metadata else str(err))


def open_release(source: Source, roles: Roles) -> Release:
    """List a release, and read its metadata.

    Raises
    ------
    DataError
        If no folder of it is an object.
    """
    files = source.listing()
    try:
        layout = lay_out([file.path for file in files], roles)
    except DataError as err:
        raise DataError(f"{source.name}: {err}") from None
    keys = [folder.key for folder in layout.objects]
    known = partial(Release, source, files, layout, roles.scanner is not None)
    try:
        told = [(path, source.read(path)) for path in layout.metadata]
        return known(find_metadata(told, keys))
    except DataError as err:
        return known(None, f"{source.name}: {err}")


def chosen_folders(release: Release, told: str) -> list[ObjectFolder]:
    """Choose objects by their folders: ``0-39``, ``3,17``; empty for all.

    Raises
    ------
    DataError
        If one of them is not there.
    """
    by_key = {folder.key: folder for folder in release.layout.objects}
    if not told:
        return list(by_key.values())
    keys = list(dict.fromkeys(_spelt_out(told, by_key)))
    if missing := [key for key in keys if key not in by_key]:
        raise DataError(
            f"{release.source.name}: no object {missing[0]} among {len(by_key)}, "
            f"{next(iter(by_key))} to {next(reversed(by_key))}"
        )
    return [by_key[key] for key in keys]


def _spelt_out(told: str, known: dict[str, ObjectFolder]) -> Iterator[str]:
    for word in filter(None, told.split(",")):
        low, dash, high = word.partition("-")
        if word not in known and dash and low.isdecimal() and high.isdecimal():
            yield from map(str, range(int(low), int(high) + 1))
        else:
            yield word


def unit_of(release: Release) -> Unit:
    """Check that sizes of all objects are in centimetres, as the release's are known to be.

    Raises
    ------
    DataError
        If their median is no everyday object's; it says which unit they look like.
    """
    longest = []
    for folder in release.layout.objects:
        try:
            longest.append(max(release.entry(folder.key).size))
        except DataError:
            continue  # told when the object is read
    low, high = MEDIAN_CM
    if longest and not low <= (middle := median(longest)) <= high:
        unit: Unit = "m" if middle < low else "mm"
        raise DataError(
            f"{release.source.name}: expected sizes in cm, got a median longest side of "
            f"{middle:.3g}: if these are {unit}, factor {CM_PER_UNIT[unit]:g}, say --size-unit "
            f"{unit}; if they are cm, say --size-unit cm"
        )
    return "cm"
