"""Mend every mesh of a capture folder into a folder of parts that a rebuild can take."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

from xden1k.errors import DataError
from xden1k.folder.place import new_folder
from xden1k.values.ply import CM_PER_UNIT
from xden_builder.capture import CaptureFolder
from xden_builder.capture.mending import mended
from xden_builder.capture.meshes import read_meshes
from xden_builder.capture.writing import write_parts, write_table
from xden_builder.workers import gather

__all__ = ["TABLE_NAME", "MendedPart", "Mending", "mend_folder"]

TABLE_NAME: Final = "mended.csv"
COLUMNS: Final = ("object_id", "part", "done", "look")


@dataclass(frozen=True, slots=True)
class MendedPart:
    """A part that was mended.

    Parameters
    ----------
    name
        Of the part.
    deeds
        What was done to it, in words.
    wide
        Whether a wide hole was closed.
    """

    name: str
    deeds: tuple[str, ...]
    wide: bool

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON."""
        return {"part": self.name, "done": list(self.deeds), "look": self.wide}


@dataclass(frozen=True, slots=True)
class Mending:
    """What became of every object.

    Parameters
    ----------
    objects
        By id: the parts that were mended, none where all were solids.
    failures
        Object id and reason of those that could not be.
    """

    objects: Mapping[str, tuple[MendedPart, ...]]
    failures: tuple[tuple[str, str], ...]

    @property
    def sound(self) -> tuple[str, ...]:
        """Ids of objects whose meshes all were solids."""
        return tuple(key for key, parts in self.objects.items() if not parts)

    @property
    def parts(self) -> Iterable[tuple[str, MendedPart]]:
        """Object id and part of all that was mended."""
        return [(key, part) for key, parts in self.objects.items() for part in parts]

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON."""
        return {
            "schema": "xden-mend/1",
            "objects": {
                key: [part.to_dict() for part in each] for key, each in self.objects.items()
            },
            "failures": [{"object_id": key, "message": why} for key, why in self.failures],
        }


def mend_folder(
    captures: Path, out: Path, *, workers: int, on_done: Callable[[str], None] = lambda _: None
) -> Mending:
    """Write the meshes of every object as solids, into a folder of their own.

    Parameters
    ----------
    captures
        The capture folder, which is left as it is.
    out
        A folder that is empty or does not exist; it appears complete or not at all. Gets
        ``OBJECT_ID/parts/NAME.ply``, in the units of ``objects.csv``, and a table of what was done.
    workers
        Number of processes.
    on_done
        Called with each object's id as it is done.

    Raises
    ------
    DataError
        If the capture folder as a whole cannot be read, ``out`` is not empty, or not one object
        could be mended; then nothing is written.
    """
    folder = CaptureFolder(captures.absolute())
    with new_folder(out) as made:
        task = partial(_mend_object, folder, made)
        objects, failures = gather(task, folder.object_ids, workers, on_done)
        if not objects:
            object_id, why = failures[0]
            raise DataError(
                f"{captures}: no object could be mended, {out} is not written; the first, "
                f"{object_id}: {why}"
            )
        for object_id, _ in failures:
            shutil.rmtree(made / object_id, ignore_errors=True)
        mending = Mending(objects, tuple(failures))
        write_table(made / TABLE_NAME, COLUMNS, [_row(*each) for each in mending.parts])
    return mending


def _mend_object(folder: CaptureFolder, out: Path, object_id: str) -> tuple[MendedPart, ...]:
    """Write the parts of an object; tell which of them were mended."""
    units, solids, told = folder.rows[object_id].mesh_units, {}, []
    for name, (path, mesh) in read_meshes(folder.root / object_id).items():
        found = mended(mesh, CM_PER_UNIT[units], f"{path}, part {name}")
        solids[name] = found.mesh
        if found.deeds:
            told.append(MendedPart(name, found.deeds, found.wide))
    write_parts(out / object_id, solids, units)
    return tuple(told)


def _row(object_id: str, part: MendedPart) -> list[str]:
    return [object_id, part.name, "; ".join(part.deeds), "yes" if part.wide else ""]
