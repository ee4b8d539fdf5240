"""One object: its meshes into the scanner's frame, and what a person is shown of it."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import trimesh

from xden1k.values.plain import plain
from xden_builder.capture import CaptureFolder, CapturePart
from xden_builder.capture.folder import REGISTRATION_NAME
from xden_builder.capture.origin import ORIGIN_NAME
from xden_builder.capture.writing import write_json, write_parts
from xden_builder.pipeline.align.card import AlignCard, make_align_card
from xden_builder.pipeline.align.kept import card_of, row_of
from xden_builder.pipeline.work import load_row, save_row
from xden_builder.registration.capture import registered

__all__ = ["Placed", "align_object"]

SCHEMA: Final = "xden-registration/1"
OF_COPIES: Final = ("meshes", "mesh_units", "pose")
"""What meshes that are near as told come from: no image has told where they are."""


@dataclass(frozen=True, slots=True)
class Placed:
    """What became of an object.

    Parameters
    ----------
    digest
        Of its work file.
    card
        None where its meshes were said to be near: they are kept as they are.
    """

    digest: str
    card: AlignCard | None


def align_object(
    folder: CaptureFolder, work: Path, made_by: str, near_too: bool, object_id: str
) -> Placed:
    """Keep the parts of an object where they stand before the scanner, unless they are kept.

    Parameters
    ----------
    folder
        The captures.
    work
        Gets a work file (:func:`xden_builder.pipeline.work.save_row`) of ``parts/NAME.ply``, in
        the units of ``objects.csv``, of ``registration.json`` and of the object's card.
    made_by
        Checksum of settings and code.
    near_too
        Whether meshes that are said to be near their place are looked for as well.
    object_id
        Which.

    Raises
    ------
    DataError
        If the object cannot be read, or its meshes cannot be registered.
    """
    digest = hashlib.sha256(f"{made_by}\n{folder.digest(object_id)}".encode()).hexdigest()
    row = load_row(work, object_id, digest)
    if row is None:
        with TemporaryDirectory() as made:
            card = _placed(folder, Path(made), near_too, object_id)
            row = row_of(card, Path(made))
        save_row(work, object_id, digest, row)
    return Placed(digest, card_of(row))


def _placed(folder: CaptureFolder, out: Path, near_too: bool, object_id: str) -> AlignCard | None:
    """Write an object's meshes in place, and make its card."""
    row = folder.rows[object_id]
    made_from = folder.made_from(object_id)
    folder.copy_own_table(object_id, out)
    if row.pose == "near" and not near_too:
        parts, _ = folder.parts(object_id)
        made_from = {key: made_from[key] for key in OF_COPIES if key in made_from}
        write_json(out / ORIGIN_NAME, made_from)
        write_parts(out, _meshes(parts), row.mesh_units)
        return None
    capture = folder.read(object_id)
    write_json(out / ORIGIN_NAME, made_from)
    if capture.pose == "near":
        known = "known" if capture.scale_sought else capture.mesh_scale
        capture = replace(capture, pose="unknown", mesh_scale=known)
    there = registered(capture)
    assert there.registration is not None
    write_parts(out, _meshes(there.capture.parts), row.mesh_units)
    values: dict[str, Any] = plain(there.registration.to_dict())
    flags = list(there.registration.flags)
    write_json(
        out / REGISTRATION_NAME,
        {"schema": SCHEMA, "object_id": object_id, **values, "flags": flags},
    )
    return make_align_card(capture, there.registration)


def _meshes(parts: Sequence[CapturePart]) -> dict[str, trimesh.Trimesh]:
    return {part.name: part.mesh for part in parts}
