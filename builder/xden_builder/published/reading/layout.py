"""Which folder of a listing is an object, and which of its files has which role."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath

from xden1k.errors import DataError
from xden_builder.published.reading.roles import Role, Roles

__all__ = ["Layout", "ObjectFolder", "lay_out"]


@dataclass(frozen=True, slots=True)
class ObjectFolder:
    """Files of one object.

    Parameters
    ----------
    key
        Name of the folder.
    path
        Relative to the release.
    files
        Relative to the release, by role, sorted.
    """

    key: str
    path: PurePosixPath
    files: Mapping[Role, tuple[PurePosixPath, ...]]

    def one(self, role: Role) -> PurePosixPath:
        """Return the file of a role that must be there.

        Raises
        ------
        DataError
            If there is none, or more than one.
        """
        found = self.files[role]
        if len(found) != 1:
            names = ", ".join(file.name for file in found) or "none"
            raise DataError(f"{self.path}: expected one file for the {role}, got {names}")
        return found[0]

    def read(self, with_images: bool) -> list[PurePosixPath]:
        """List the files that are read to make the object."""
        roles: tuple[Role, ...] = ("mesh", "volume", "table")
        return [
            file
            for role in (*roles, *(("image",) if with_images else ()))
            for file in self.files[role]
        ]

    def one_or_none(self, role: Role) -> PurePosixPath | None:
        """Return the file of a role that may be missing.

        Raises
        ------
        DataError
            If there is more than one.
        """
        return self.one(role) if self.files[role] else None


@dataclass(frozen=True, slots=True)
class Layout:
    """A listing, told apart.

    Parameters
    ----------
    objects
        In the order of their numbers, then by name.
    metadata
        Files beside or above the objects that may be the metadata, those on top first.
    others
        Files that no role took.
    """

    objects: tuple[ObjectFolder, ...]
    metadata: tuple[PurePosixPath, ...]
    others: tuple[PurePosixPath, ...]


def lay_out(paths: Iterable[PurePosixPath], roles: Roles) -> Layout:
    """Tell the files of a release apart.

    An object is a folder with a mesh or a volume; of several volumes those with ``lac`` in their
    name count, and of several tables likewise.

    Parameters
    ----------
    paths
        Of all files, relative to the release.
    roles
        What names mean.

    Raises
    ------
    DataError
        If no folder is an object, or two of them have one name.

    Examples
    --------
    >>> names = ["dataset/metadata.json", "dataset/7/mesh.glb", "dataset/7/lac.nii.gz", "LICENSE"]
    >>> found = lay_out(map(PurePosixPath, names), Roles())
    >>> found.objects[0].key, found.metadata[0].name, found.others[0].name
    ('7', 'metadata.json', 'LICENSE')
    """
    by_folder: dict[PurePosixPath, list[PurePosixPath]] = defaultdict(list)
    for path in sorted(paths):
        by_folder[path.parent].append(path)
    objects = [
        _object(folder, files, roles)
        for folder, files in by_folder.items()
        if any(roles.fits(file, "mesh") or roles.fits(file, "volume") for file in files)
    ]
    if not objects:
        raise DataError(
            "expected folders with a mesh (.glb) and a volume (.nii.gz), one for each object, got "
            f"none among {sum(map(len, by_folder.values()))} files: not laid out as the release"
        )
    _refuse_twins(objects)
    taken = {file for each in objects for files in each.files.values() for file in files}
    rest = [file for files in by_folder.values() for file in files if file not in taken]
    inside = {each.path for each in objects}
    metadata = [file for file in rest if roles.fits(file, "metadata") and file.parent not in inside]
    return Layout(
        tuple(sorted(objects, key=lambda each: _order(each.key))),
        tuple(sorted(metadata, key=lambda file: (len(file.parts), file))),
        tuple(file for file in rest if file not in metadata),
    )


def _object(folder: PurePosixPath, files: Sequence[PurePosixPath], roles: Roles) -> ObjectFolder:
    def of(role: Role) -> tuple[PurePosixPath, ...]:
        return tuple(file for file in files if roles.fits(file, role))

    return ObjectFolder(
        folder.name,
        folder,
        {
            "mesh": of("mesh"),
            "volume": _about_lac(of("volume")),
            "table": _about_lac(of("table")),
            "image": of("image"),
        },
    )


def _about_lac(files: tuple[PurePosixPath, ...]) -> tuple[PurePosixPath, ...]:
    """Of several files, those whose name says what they hold, if any does."""
    named = tuple(file for file in files if "lac" in file.name.lower())
    return named if len(files) > 1 and named else files


def _order(key: str) -> tuple[bool, int, str]:
    return (not key.isdecimal(), int(key) if key.isdecimal() else 0, key)


def _refuse_twins(objects: Sequence[ObjectFolder]) -> None:
    seen: dict[str, PurePosixPath] = {}
    for each in objects:
        if (other := seen.setdefault(each.key, each.path)) != each.path:
            raise DataError(f"expected one folder for object {each.key}, got {other}, {each.path}")
