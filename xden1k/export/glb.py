"""Binary glTF: a node of its own name and a material for each part, m, y up.

The one writer of GLB in this project: what cameras see of phantoms and what the web app shows go
through :func:`write_nodes` too. Vertices stay in cm, z up, in single precision, as the dataset has
them; the transform of each node, which every reader applies, makes them glTF's metres, y up.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import trimesh
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from xden1k.errors import DataError
from xden1k.export.body import Body
from xden1k.export.closed import closed_mesh
from xden1k.export.obj import of_meshes
from xden1k.export.si import M_PER_CM, Inertial
from xden1k.values.plain import plain

__all__ = ["SUFFIX", "check", "expected", "painted", "read", "write", "write_nodes"]

SUFFIX: Final = ".glb"
UPRIGHT: Final = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""From z up to y up."""

Finish = Callable[[dict[str, Any]], None]


def write_nodes(
    path: Path,
    meshes: Mapping[str, trimesh.Trimesh],
    *,
    normals: bool | None = None,
    finish: Finish | None = None,
) -> None:
    """Write meshes as nodes.

    Parameters
    ----------
    path
        The ``.glb``.
    meshes
        By the names of their nodes, with their looks; cm, object frame.
    normals
        Whether to write the normals of vertices; None = where a mesh has them.
    finish
        Changes the glTF document before it is written.
    """
    transform, scene = np.eye(4), trimesh.Scene()
    transform[:3, :3] = M_PER_CM * UPRIGHT
    for name, mesh in meshes.items():
        scene.add_geometry(mesh, node_name=name, geom_name=name, transform=transform)
    exported = scene.export(  # type: ignore[no-untyped-call]
        file_type="glb", include_normals=normals, tree_postprocessor=finish
    )
    path.write_bytes(exported)


def painted(
    mesh: trimesh.Trimesh,
    name: str,
    color_rgb: tuple[float, float, float],
    metalness: float = 0.0,
    roughness: float = 0.5,
) -> trimesh.Trimesh:
    """Return the same shape with a surface: a material of that name, and how it looks."""
    surface = PBRMaterial(  # type: ignore[no-untyped-call]
        name=name,
        baseColorFactor=[*color_rgb, 1.0],
        metallicFactor=metalness,
        roughnessFactor=roughness,
    )
    visual = TextureVisuals(material=surface)  # type: ignore[no-untyped-call]
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False, visual=visual)


def write(body: Body, path: Path) -> None:
    """Write the parts; density and material of each are extras of its node."""
    parts = {part.name: part for part in body.obj.parts}
    figures = ("material", "density_g_cm3", "density_sd_g_cm3", "density_source")

    def annotate(tree: dict[str, Any]) -> None:
        for node in tree["nodes"]:
            if part := parts.get(node.get("name")):
                node["extras"] = plain({name: getattr(part, name) for name in figures})

    shown = {
        name: painted(_closed(body, name, part.mesh), name, part.color_rgb)
        for name, part in parts.items()
    }
    write_nodes(path, shown, finish=annotate)


def _closed(body: Body, name: str, mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    try:
        return closed_mesh(mesh, single=True)
    except DataError as err:
        raise DataError(f"{body.obj.object_id}: part {name}: {err}") from err


def expected(body: Body) -> Inertial:
    """Return what a reader should find who knows the densities."""
    return body.inertial


def read(path: Path, body: Body) -> Inertial:
    """Integrate the meshes as ``trimesh.load`` gives them, with the densities of the parts.

    Raises
    ------
    DataError
        If a part is missing, or no longer closed.
    """
    scene = trimesh.load_scene(path)
    back = np.eye(4)
    back[:3, :3] = UPRIGHT.T
    meshes: list[object] = [None] * len(body.obj.parts)
    for k, part in enumerate(body.obj.parts):
        if part.name in scene.graph.nodes_geometry:
            transform, name = scene.graph[part.name]
            meshes[k] = scene.geometry[name].copy().apply_transform(back @ transform)
    return of_meshes(path, body, meshes)


check = read
