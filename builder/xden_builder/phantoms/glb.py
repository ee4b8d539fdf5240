"""What a camera sees of a phantom: its part meshes with their surfaces, as binary glTF."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import trimesh

from xden1k.export.glb import painted, write_nodes
from xden_builder.phantoms.phantom import PhantomPart

__all__ = ["write_glb"]


def write_glb(path: Path, parts: Sequence[PhantomPart], meshes: Sequence[trimesh.Trimesh]) -> None:
    """Write one node for each part, of its name, with its base colour, metalness and roughness.

    Parameters
    ----------
    path
        The ``.glb``.
    parts
        Whose surfaces to show; the material of a node has the part's name, not the material's,
        which no camera sees.
    meshes
        Their shapes, cm, object frame.
    """
    seen = {
        part.name: painted(mesh, part.name, part.color_rgb, part.metalness, part.roughness)
        for part, mesh in zip(parts, meshes, strict=True)
    }
    write_nodes(path, seen)
