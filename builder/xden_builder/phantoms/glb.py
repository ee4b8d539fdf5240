"""What a camera sees of a phantom: its part meshes with their surfaces, as binary glTF."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from xden_builder.phantoms.phantom import PhantomPart

__all__ = ["write_glb"]

M_PER_CM = 0.01
_UPRIGHT = M_PER_CM * np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""From cm, z up, to glTF's metres, y up."""


def write_glb(path: Path, parts: Sequence[PhantomPart], meshes: Sequence[trimesh.Trimesh]) -> None:
    """Write one node for each part, of its name, with its base colour, metalness and roughness.

    Parameters
    ----------
    path
        The ``.glb``.
    parts
        Whose surfaces to show.
    meshes
        Their shapes, cm, object frame; vertices are stored so, as float32, and the transform of
        each node makes them metres, y up.
    """
    transform, scene = np.eye(4), trimesh.Scene()
    transform[:3, :3] = _UPRIGHT
    for part, mesh in zip(parts, meshes, strict=True):
        surface = PBRMaterial(  # type: ignore[no-untyped-call]
            name=part.name,  # not the material's: no camera sees that
            baseColorFactor=[*part.color_rgb, 1.0],
            metallicFactor=part.metalness,
            roughnessFactor=part.roughness,
        )
        visual = TextureVisuals(material=surface)  # type: ignore[no-untyped-call]
        seen = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False, visual=visual)
        scene.add_geometry(seen, node_name=part.name, geom_name=part.name, transform=transform)
    path.write_bytes(scene.export(file_type="glb"))  # type: ignore[no-untyped-call]
