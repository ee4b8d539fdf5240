"""One object of a release: the files it is read from, and reading them."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Any, Final

import numpy as np

from xden1k.errors import DataError
from xden1k.values.arrays import Vec3
from xden_builder.published.given import PublishedObject
from xden_builder.published.reading.layout import ObjectFolder
from xden_builder.published.reading.mesh import read_mesh
from xden_builder.published.reading.metadata import Entry
from xden_builder.published.reading.table import PartTable, read_table
from xden_builder.published.reading.volume import read_volume

__all__ = ["Item", "object_id_of", "read_item"]

PLAUSIBLE_CM: Final = (0.5, 300.0)
"""Longest sides of what people scan."""


@dataclass(frozen=True)
class Item:
    """What is read to make one object.

    Parameters
    ----------
    object_id
        In the dataset.
    root
        Folder of the release on this machine.
    folder
        Of the object, with its files by role.
    entry
        Category and size; None where they are not told, which ``problem`` says.
    cm_per_unit
        Of the sizes.
    commit
        Of the repository it came from; empty for a folder.
    problem
        Why it cannot be read, if that is known from names alone; empty otherwise.
    with_images
        Whether its images are read as well, as radiographs.
    """

    object_id: str
    root: Path
    folder: ObjectFolder
    entry: Entry | None
    cm_per_unit: float
    commit: str = ""
    problem: str = ""
    with_images: bool = False

    @property
    def files(self) -> list[PurePosixPath]:
        """Files that are read."""
        return self.folder.read(self.with_images)

    @property
    def size_cm(self) -> tuple[float, ...]:
        """Three sides in the release's order, or the longest alone; empty where it is not told."""
        return tuple(side * self.cm_per_unit for side in self.entry.size) if self.entry else ()

    @cached_property
    def digest(self) -> str:
        """Checksum of the files, of what the metadata tell, and of the unit."""
        told = f"{self.object_id}\n{self.entry}\n{self.cm_per_unit}\n{self.commit}\n"
        return hashlib.sha256(f"{told}{sorted(self.checksums.items())}".encode()).hexdigest()

    @cached_property
    def checksums(self) -> dict[str, str]:
        """SHA-256 of each file, by its name."""
        found = {}
        for file in self.files:
            with (self.root / file).open("rb") as stream:
                found[file.name] = hashlib.file_digest(stream, "sha256").hexdigest()
        return found


def object_id_of(key: str) -> str:
    """Name an object by its folder.

    Examples
    --------
    >>> object_id_of("4"), object_id_of("red mug")
    ('xden1k-0004', 'red-mug')
    """
    return f"xden1k-{int(key):04d}" if key.isdecimal() else re.sub(r"[^A-Za-z0-9._-]+", "-", key)


def read_item(item: Item) -> PublishedObject:
    """Read an object.

    Raises
    ------
    DataError
        If a file is missing, damaged or of another meaning; one line that names it.
    """
    if item.entry is None:
        raise DataError(item.problem)
    mesh, colors_rgb = read_mesh(item.root / item.folder.one("mesh"))
    table = read_part_table(item)
    volume, was_density = read_volume(item.root / item.folder.one("volume"), table)
    return PublishedObject(
        object_id=item.object_id,
        category=item.entry.category,
        mesh=mesh,
        colors_rgb=colors_rgb,
        lac_per_cm=volume,
        table_lac_per_cm={} if table is None else dict(table.lac_per_cm),
        size_cm=_size_cm(item, np.ptp(mesh.bounds, axis=0)),
        meta=_provenance(item, item.entry, table, _flags(item, was_density)),
    )


def read_part_table(item: Item) -> PartTable | None:
    """Read the table of parts of an object; None where it has none.

    Raises
    ------
    DataError
        If it is damaged or of another meaning.
    """
    file = item.folder.one_or_none("table")
    return None if file is None else read_table((item.root / file).read_bytes(), item.root / file)


def _size_cm(item: Item, extents: Vec3) -> Vec3:
    """Give three sides; a single number is the longest, and the mesh has the others."""
    told = np.array(item.size_cm)
    return told if len(told) > 1 else told * extents / extents.max()


def _flags(item: Item, was_density: bool) -> tuple[str, ...]:
    least, most = PLAUSIBLE_CM
    raised = {
        "size_unlikely": not least <= max(item.size_cm) <= most,
        "longest_side_only": len(item.size_cm) == 1,
        "density_volume": was_density,
    }
    return tuple(flag for flag, is_raised in raised.items() if is_raised)


def _provenance(
    item: Item, entry: Entry, table: PartTable | None, flags: tuple[str, ...]
) -> dict[str, Any]:
    return {
        "id": item.folder.key,
        "category": entry.told_category,
        "size": list(entry.size),
        "cm_per_size_unit": item.cm_per_unit,
        "commit": item.commit or None,
        "mesh": str(item.folder.one("mesh")),
        "sha256": item.checksums,
        "part_keys": None if table is None else list(table.lac_per_cm),
        "other_density_rule": [] if table is None else list(table.other_rule),
        "flags": list(flags),
    }
