"""How thick a part is, by its mesh alone."""

from __future__ import annotations

import trimesh

__all__ = ["plate_thickness_cm"]


def plate_thickness_cm(mesh: trimesh.Trimesh) -> float:
    """Thickness of a wide plate of the same volume and surface: 2 V / A.

    Of a shell it is the wall, of a long rod the radius, of a cube a third of its edge.

    Examples
    --------
    >>> round(plate_thickness_cm(trimesh.creation.box((100, 100, 0.2))), 2)
    0.2
    """
    return 2 * abs(float(mesh.volume)) / float(mesh.area)
