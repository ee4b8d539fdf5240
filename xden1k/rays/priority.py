"""Who owns the space where parts overlap."""

from __future__ import annotations

from collections.abc import Sequence

import trimesh

from xden1k.errors import DataError

__all__ = ["check_order", "ownership_order"]


def ownership_order(
    meshes: Sequence[trimesh.Trimesh], priorities: Sequence[int | None] | None = None
) -> list[int]:
    """Order parts by who owns shared space, strongest first.

    The higher priority wins. A missing priority counts as 0, so a positive one beats every part
    without and a negative one yields to them. Among equals the smaller mesh volume wins, then the
    lower index: a screw owns its place in the handle.

    Parameters
    ----------
    meshes
        Closed, outward-wound.
    priorities
        One for each mesh, None where not given; None altogether = no part has one.

    Returns
    -------
    list of int
        Indices of the meshes.

    Raises
    ------
    DataError
        If the counts differ, or a mesh encloses a negative volume: it is wound inwards.

    Examples
    --------
    >>> handle, screw = trimesh.creation.box((2, 2, 9)), trimesh.creation.box((1, 1, 5))
    >>> ownership_order([handle, screw])
    [1, 0]
    >>> ownership_order([handle, screw], [1, None])
    [0, 1]
    """
    given = [None] * len(meshes) if priorities is None else list(priorities)
    if len(given) != len(meshes):
        raise DataError(f"{len(meshes)} meshes need as many priorities, got {len(given)}")
    # trimesh warns when it divides by the volume of an empty mesh
    volumes = [float(mesh.volume) if len(mesh.faces) else 0.0 for mesh in meshes]
    for part, volume in enumerate(volumes):
        if volume < 0:
            raise DataError(f"part {part} is wound inwards: its volume is {volume:.6g} cm³")
    return sorted(range(len(meshes)), key=lambda part: (-(given[part] or 0), volumes[part]))


def check_order(order: Sequence[int], parts: int) -> None:
    """Refuse an order that does not name each part once.

    Raises
    ------
    DataError
        If it does not.
    """
    if sorted(order) != list(range(parts)):
        raise DataError(f"order must hold each of 0 to {parts - 1} once, got {list(order)}")
