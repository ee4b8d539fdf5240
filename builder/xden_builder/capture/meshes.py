"""Part meshes as their files hold them: one file for each part, or one scene."""

from __future__ import annotations

import json
import struct
import unicodedata
from collections.abc import Iterator, Sequence
from pathlib import Path

import trimesh

from xden1k.errors import DataError
from xden_builder.capture.damage import decoding

__all__ = ["MESH_SUFFIXES", "composed", "read_meshes"]

MESH_SUFFIXES = (".ply", ".stl", ".obj", ".glb")
SCENE = "mesh.glb"

_OTHER_FORMATS = (".gltf", ".off", ".dae", ".3mf", ".fbx", ".step", ".stp", ".iges", ".usdz")


def read_meshes(folder: Path) -> dict[str, tuple[Path, trimesh.Trimesh]]:
    """Read the meshes of an object as they are stored, in the file's units.

    Parameters
    ----------
    folder
        Holds ``parts/NAME.ply|stl|obj|glb`` or, instead, ``mesh.glb`` with a node for each part.

    Returns
    -------
    dict
        File and mesh of each part by name, sorted.

    Raises
    ------
    DataError
        If there is no mesh, both forms are there, two parts share a name, or a file is damaged.
    """
    scene, parts = folder / SCENE, folder / "parts"
    if scene.is_file() and parts.is_dir():
        raise DataError(f"{folder}: expected parts/ or {SCENE}, got both")
    found = _scene_parts(scene) if scene.is_file() else _file_parts(parts)
    if not found:
        raise DataError(f"{folder}: no mesh: expected parts/NAME.ply, stl, obj or glb, or {SCENE}")
    names: dict[str, str] = {}
    for name in found:
        if (same := names.setdefault(composed(name), name)) != name:
            raise DataError(f"{found[name][0]}: {found[same][0].name} is a part of the same name")
    return {name: found[names[name]] for name in sorted(names)}


def composed(name: str) -> str:
    """Write letters with accents as one character each: macOS tells files' names in two.

    Examples
    --------
    >>> len("ko\u0308rper"), len(composed("ko\u0308rper"))
    (7, 6)
    """
    return unicodedata.normalize("NFC", name)


def _file_parts(folder: Path) -> dict[str, tuple[Path, trimesh.Trimesh]]:
    found: dict[str, tuple[Path, trimesh.Trimesh]] = {}
    for path in sorted(folder.glob("[!.]*")):
        if path.suffix.lower() in _OTHER_FORMATS:
            raise DataError(f"{path}: expected a mesh as {', '.join(MESH_SUFFIXES)}")
        if path.suffix.lower() not in MESH_SUFFIXES:
            continue
        if path.stem in found:
            raise DataError(f"{path}: {found[path.stem][0].name} is a part of the same name")
        found[path.stem] = (path, _joined([mesh for _, mesh in _pieces(_load_scene(path))]))
    return found


def _scene_parts(path: Path) -> dict[str, tuple[Path, trimesh.Trimesh]]:
    """Return the part of each named node, its own and its parents' transforms applied."""
    parts: dict[str, list[trimesh.Trimesh]] = {name: [] for name in _mesh_node_names(path)}
    scene = _load_scene(path)
    for node, mesh in _pieces(scene):
        # trimesh hangs the pieces of a node of several materials below it, under random names
        name = node if node in parts else scene.graph.transforms.parents.get(node)
        if name not in parts:
            raise DataError(f"{path}: expected a name at each node with a mesh, got {node!r}")
        parts[name].append(mesh)
    return {name: (path, _joined(pieces)) for name, pieces in parts.items()}


def _mesh_node_names(path: Path) -> list[str]:
    """Return the names of the nodes that carry a mesh, as the file has them."""
    with decoding(path, "a binary glTF scene"):
        data = path.read_bytes()
        (length,) = struct.unpack_from("<I", data, 12)
        nodes = json.loads(data[20 : 20 + length])["nodes"]
        names = [node.get("name", "") for node in nodes if "mesh" in node]
    for name in names:
        if name.startswith(".") or set(name) & set("/\\\0"):
            raise DataError(f"{path}: part {name!r}: expected a name that a file may have")
        if not name or names.count(name) > 1:
            raise DataError(
                f"{path}: expected a name of its own at each node with a mesh, got {names}"
            )
    return names


def _load_scene(path: Path) -> trimesh.Scene:
    with decoding(path, "a mesh"):
        return trimesh.load_scene(path, process=False, skip_materials=True)


def _pieces(scene: trimesh.Scene) -> Iterator[tuple[str, trimesh.Trimesh]]:
    """Yield node name and bare triangles, without colours and normals, in the scene's frame."""
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
        geometry = scene.geometry[name]
        if isinstance(geometry, trimesh.Trimesh):
            bare = trimesh.Trimesh(geometry.vertices, geometry.faces, process=False)
            yield node, bare.apply_transform(transform)


def _joined(meshes: Sequence[trimesh.Trimesh]) -> trimesh.Trimesh:
    return trimesh.Scene(meshes).to_mesh() if meshes else trimesh.Trimesh()
