"""One object: its meshes into the scanner's frame, and what a person is shown of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import trimesh

from xden1k.values.plain import plain
from xden_builder.capture import CaptureFolder, CapturePart
from xden_builder.capture.folder import REGISTRATION_NAME
from xden_builder.capture.writing import write_json, write_parts
from xden_builder.pipeline.align.card import AlignCard, make_align_card
from xden_builder.registration.capture import registered

__all__ = ["align_object"]

SCHEMA: Final = "xden-registration/1"


def align_object(
    folder: CaptureFolder, out: Path, near_too: bool, object_id: str
) -> AlignCard | None:
    """Write the parts of an object where they stand before the scanner.

    Parameters
    ----------
    folder
        The captures.
    out
        Gets ``OBJECT_ID/parts/NAME.ply``, in the units of ``objects.csv``, and
        ``OBJECT_ID/registration.json``.
    near_too
        Whether meshes that are said to be near their place are looked for as well.
    object_id
        Which.

    Returns
    -------
    AlignCard or None
        None where the meshes were said to be near: they are written as they are.

    Raises
    ------
    DataError
        If the object cannot be read, or its meshes cannot be registered.
    """
    row = folder.rows[object_id]
    if row.pose == "near" and not near_too:
        parts, _ = folder.parts(object_id)
        write_parts(out / object_id, _meshes(parts), row.mesh_units)
        return None
    capture = folder.read(object_id)
    if capture.pose == "near":
        known = "known" if capture.scale_sought else capture.mesh_scale
        capture = replace(capture, pose="unknown", mesh_scale=known)
    there = registered(capture)
    assert there.registration is not None
    card = make_align_card(capture, there.registration)
    write_parts(out / object_id, _meshes(there.capture.parts), row.mesh_units)
    values: dict[str, Any] = plain(there.registration.to_dict())
    flags = list(there.registration.flags)
    write_json(
        out / object_id / REGISTRATION_NAME,
        {"schema": SCHEMA, "object_id": object_id, **values, "flags": flags},
    )
    return card


def _meshes(parts: Sequence[CapturePart]) -> dict[str, trimesh.Trimesh]:
    return {part.name: part.mesh for part in parts}
