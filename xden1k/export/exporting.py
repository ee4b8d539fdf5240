"""Write an object in a format others read, and check that it says the same."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Protocol, cast, runtime_checkable

from xden1k.errors import DataError
from xden1k.export.body import Body, body_of
from xden1k.export.check import Deviation, compare
from xden1k.export.place import in_place, write_record
from xden1k.export.si import Inertial
from xden1k.values.plain import plain
from xden1k.values.types import DensityObject

__all__ = ["FORMATS", "Exported", "Format", "export", "export_stack", "exported", "format_of"]

FORMATS: Final = ("mjcf", "urdf", "sdf", "usd", "glb", "obj", "nifti", "vti", "npz", "hdf5")
"""What an object can be written as."""
STACK: Final = "objects"


@runtime_checkable
class Format(Protocol):
    """What the module of a format has."""

    SUFFIX: str

    def write(self, body: Body, path: Path) -> None:
        """Write a body; files beside the main one may be written too."""

    def expected(self, body: Body) -> Inertial:
        """Return what a reader should find in the file."""

    def read(self, path: Path, body: Body) -> Inertial:
        """Read it back, with what the writing needs and no more."""

    def check(self, path: Path, body: Body) -> Inertial:
        """Read it with the format's own tools, which may refuse it."""


@dataclass(frozen=True, slots=True)
class Exported:
    """What became of one object.

    Parameters
    ----------
    object_id
        Which one.
    path
        Its main file.
    deviation
        How far what was read back is from the object.
    """

    object_id: str
    path: Path
    deviation: Deviation


def export(
    obj: DensityObject, format_name: str, out: Path | str, *, check: bool = False, pieces: int = 1
) -> Path:
    """Write an object in a format others read.

    Parameters
    ----------
    obj
        Each part with a density.
    format_name
        One of :data:`FORMATS`.
    out
        Folder in which the object gets a folder of its own name.
    check
        Whether to have it read by the format's own tools as well.
    pieces
        Convex pieces, at most, for the collision shape of each part; 1 = its hull.

    Returns
    -------
    Path
        The main file.

    Raises
    ------
    DataError
        If the object cannot be written so, the place is taken, or what is read back differs.
    MissingExtraError
        If a package is missing that writing or checking needs.

    Examples
    --------
    >>> import tempfile
    >>> from xden1k.access.hub import SAMPLE
    >>> from xden1k.folder import open_folder
    >>> hammer = open_folder(SAMPLE).object("hammer-0000")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     export(hammer, "mjcf", folder).name
    'hammer-0000.xml'
    """
    return exported(obj, format_name, out, check=check, pieces=pieces).path


def exported(
    obj: DensityObject, format_name: str, out: Path | str, *, check: bool = False, pieces: int = 1
) -> Exported:
    """Do as :func:`export` does, and say how far what is read back is from the object."""
    module = format_of(format_name)
    body = body_of(obj, pieces)
    with in_place(Path(out) / body.file_name, format_name, obj.object_id) as folder:
        path = folder / f"{body.file_name}{module.SUFFIX}"
        module.write(body, path)
        found = [module.read(path, body)] + ([module.check(path, body)] if check else [])
        place = Path(out) / body.file_name / path.name
        deviations = [compare(place, one, module.expected(body)) for one in found]
        write_record(folder, _record(body, format_name, path.name))
    return Exported(obj.object_id, place, max(deviations, key=lambda one: one.largest))


def export_stack(
    objects: Iterable[DensityObject], out: Path | str, *, check: bool = False
) -> list[Exported]:
    """Write many objects into one HDF5 file, stacked along the first axis.

    Parameters
    ----------
    objects
        At least one; held one at a time.
    out
        Folder in which ``objects/objects.h5`` is made.
    check
        Whether to have it read by ``datasets`` as well.

    Raises
    ------
    DataError
        If one of them cannot be written, or what is read back differs: then nothing is.
    """
    from xden1k.export import hdf5

    wanted: dict[str, Inertial] = {}

    def noted() -> Iterator[DensityObject]:
        for obj in objects:
            wanted[obj.object_id] = body_of(obj).inertial
            yield obj

    path = Path(out) / STACK / f"{STACK}{hdf5.SUFFIX}"
    with in_place(path.parent, "hdf5", STACK) as folder:
        if not hdf5.stack(noted(), folder / path.name):
            raise DataError(f"{path}: expected at least one object")
        ways = (hdf5.rows, hdf5.rows_by_datasets) if check else (hdf5.rows,)
        found = [pair for way in ways for pair in way(folder / path.name)]
        deviations = {name: compare(path, one, wanted[name]) for name, one in found}
        record = {"format": "hdf5", "file": path.name, "object_id": STACK, "objects": list(wanted)}
        write_record(folder, record)
    return [Exported(name, path, deviation) for name, deviation in deviations.items()]


def format_of(name: str) -> Format:
    """Return the module of a format.

    Raises
    ------
    DataError
        If there is no such format.
    """
    if name not in FORMATS:
        raise DataError(f"unknown format {name!r}; there are {', '.join(FORMATS)}")
    return cast(Format, importlib.import_module(f"xden1k.export.{name}"))


def _record(body: Body, format_name: str, main: str) -> dict[str, Any]:
    obj = body.obj
    figures = ("material", "density_g_cm3", "density_sd_g_cm3", "density_source", "flags")
    parts = [
        {"name": part.name, "written_as": name} | {key: getattr(part, key) for key in figures}
        for name, part in zip(body.part_names, obj.parts, strict=True)
    ]
    inertial = body.inertial
    values = {
        "format": format_name,
        "file": main,
        "object_id": obj.object_id,
        "written_as": body.name,
        "category": obj.category,
        "split": obj.split,
        "source": obj.source,
        "flags": obj.flags,
        "mass_kg": inertial.mass_kg,
        "com_m": inertial.com_m.tolist(),
        "inertia_kg_m2": inertial.inertia_kg_m2.tolist(),
        "parts": parts,
    }
    return cast(dict[str, Any], plain(values))
