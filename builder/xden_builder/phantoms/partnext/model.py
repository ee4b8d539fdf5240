"""One model of PartNeXt: its surface, and which part each of its faces belongs to."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import trimesh
from jaxtyping import Int64

from xden1k.errors import DataError
from xden1k.values.arrays import Faces, Points
from xden_builder.capture.damage import decoding
from xden_builder.phantoms.partnext.annotations import Entry, read_fields

__all__ = ["Leaf", "Model", "glb_path", "read_model"]

MOST_LEAVES: Final = 200
"""A label is one byte, and what fills an object needs some too."""
UPRIGHT: Final = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""From the axes of glTF, y up, to ours, z up."""


@dataclass(frozen=True, slots=True)
class Leaf:
    """A part at the end of the hierarchy.

    Parameters
    ----------
    names
        As annotated: its own, then those of what it belongs to, without the whole's.
    mask
        Its ``maskId``.
    """

    names: tuple[str, ...]
    mask: str


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """An annotated surface.

    Parameters
    ----------
    vertices
        Shape (n, 3), z up, in a unit that nobody knows.
    faces
        Shape (m, 3), of all meshes, one after the other.
    owner
        Shape (m,): 0 for faces in no mask, k for those of ``leaves[k - 1]``.
    leaves
        Parts with at least one face.
    category
        Name of the whole.
    where
        Annotation and object, for messages.
    """

    vertices: Points
    faces: Faces
    owner: Int64[np.ndarray, "m"]
    leaves: tuple[Leaf, ...]
    category: str
    where: str


def glb_path(folder: Path, entry: Entry) -> Path:
    """Find the GLB of a model: in ``glbs`` of the folder, or of a folder in it.

    Raises
    ------
    DataError
        If there is none.
    """
    name = Path("glbs", entry.type_id, f"{entry.model_id}.glb")
    for place in (folder / name, *sorted(folder.glob(f"*/{name.as_posix()}"))):
        if place.is_file():
            return place
    raise DataError(f"{entry.where}: expected {name}, found no such file in {folder}")


def read_model(folder: Path, entry: Entry) -> Model:
    """Read a model with its annotation.

    Raises
    ------
    DataError
        If the GLB is missing, cannot be read or has no mesh, the annotation is malformed or is of
        other meshes, no leaf has a mask, or a face is in two.
    """
    fields = read_fields(entry)
    path = glb_path(folder, entry)
    scene = _read_scene(path, f"{path}: object {entry.model_id}")
    meshes = _annotated_meshes(scene, fields["mesh_face_num"], entry.where)
    leaves, category = _leaves(fields["hierarchyList"], entry.where)
    counts = [len(mesh.faces) for mesh in meshes]
    owner, used = _owners(fields["masks"], leaves, counts, entry.where)
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    vertices = np.concatenate([mesh.vertices for mesh in meshes]) @ UPRIGHT.T
    if not np.isfinite(vertices).all():
        raise DataError(f"{path}: object {entry.model_id}: a vertex is not finite")
    faces = np.concatenate(
        [mesh.faces + start for mesh, start in zip(meshes, starts[:-1], strict=True)]
    )
    return Model(vertices, faces, owner, used, category, entry.where)


def _read_scene(path: Path, where: str) -> trimesh.Scene:
    with decoding(path, "a GLB"):
        scene = trimesh.load_scene(path)
        kinds = {type(one).__name__ for one in scene.geometry.values()}
    if kinds != {"Trimesh"}:
        found = ", ".join(sorted(kinds)) or "none"
        raise DataError(f"{where}: expected meshes alone, got {found}")
    return scene


def _orders(scene: trimesh.Scene) -> Iterator[list[trimesh.Trimesh]]:
    """Yield the meshes in the scene's frame, in the orders that annotations may count them in.

    As they stand in the file, which is how the authors' toolkit reads them, if each stands in one
    place; and as ``dump(concatenate=False)`` gives them, which is how they document it. trimesh
    5.2 gives the nodes of a scene in reverse.
    """
    dumped = [mesh for mesh in scene.dump() if isinstance(mesh, trimesh.Trimesh)]
    by_name = {str(mesh.metadata["name"]): mesh for mesh in dumped}
    if len(by_name) == len(dumped):
        yield [by_name[name] for name in scene.geometry if name in by_name]
    yield dumped


def _annotated_meshes(scene: trimesh.Scene, told: Any, where: str) -> list[trimesh.Trimesh]:
    """Give the meshes in the order in which their face counts are those annotated."""
    where = f"{where}: mesh_face_num"
    if isinstance(told, list):
        told = dict(enumerate(told))
    if not isinstance(told, Mapping):
        raise DataError(f"{where}: expected face counts by mesh, got {told!r:.60}")
    stated = {str(at): count for at, count in told.items()}
    orders = list(_orders(scene))
    for meshes in orders:
        if stated == {str(at): len(mesh.faces) for at, mesh in enumerate(meshes)}:
            return meshes
    if len(stated) != len(orders[0]):
        raise DataError(f"{where}: expected {len(orders[0])} meshes as the GLB, got {len(stated)}")
    for at, mesh in enumerate(orders[0]):
        if (got := stated.get(str(at), "none")) != len(mesh.faces):
            raise DataError(
                f"{where}: expected {len(mesh.faces)} faces of mesh {at} as in the GLB, got {got}"
            )
    raise DataError(f"{where}: expected the face counts of the GLB, got {told!r:.60}")


def _leaves(roots: Any, where: str) -> tuple[tuple[Leaf, ...], str]:
    """List the leaves with a mask, and give the name of the whole."""
    where = f"{where}: hierarchyList"
    if isinstance(roots, Mapping):
        roots = [roots]
    if not isinstance(roots, list) or not roots:
        raise DataError(f"{where}: expected a list of nodes, got {roots!r:.60}")
    try:
        leaves = tuple(leaf for root in roots for leaf in _below(root, (), where))
    except RecursionError:
        raise DataError(f"{where}: expected nodes within nodes less deep") from None
    if not leaves:
        raise DataError(f"{where}: expected a leaf with a maskId, found none")
    masks = [leaf.mask for leaf in leaves]
    if twice := sorted({mask for mask in masks if masks.count(mask) > 1}):
        raise DataError(f"{where}: two leaves have the maskId {twice[0]}")
    return leaves, roots[0]["name"]


def _below(node: Any, above: tuple[str, ...], where: str) -> Iterator[Leaf]:
    if not isinstance(node, Mapping) or not isinstance(node.get("name"), str):
        raise DataError(f"{where}: expected nodes with a name, got {node!r:.60}")
    names = (node["name"], *above)
    children = node.get("children") or ()
    if not isinstance(children, list | tuple):
        raise DataError(f"{where}: {node['name']}: expected children in a list")
    if not children and node.get("maskId") is not None:
        yield Leaf(names[:-1] or names, str(node["maskId"]))
    for child in children:
        yield from _below(child, names, where)


def _owners(
    masks: Any, leaves: Sequence[Leaf], counts: Sequence[int], where: str
) -> tuple[Int64[np.ndarray, "m"], tuple[Leaf, ...]]:
    """Give each face its leaf, and the leaves that have any."""
    where = f"{where}: masks"
    if not isinstance(masks, Mapping):
        raise DataError(f"{where}: expected faces by mask and mesh, got {masks!r:.60}")
    known = {str(mask): by_mesh for mask, by_mesh in masks.items()}
    starts = np.cumsum([0, *counts])
    owner = np.zeros(starts[-1], dtype=np.int64)
    used: list[Leaf] = []
    for leaf in leaves:
        if leaf.mask not in known:
            raise DataError(f"{where}: expected mask {leaf.mask} of {leaf.names[0]}, found none")
        at = f"{where}: mask {leaf.mask} of {leaf.names[0]}"
        faces = _faces_of(known[leaf.mask], counts, starts, at)
        if not len(faces):
            continue
        if (taken := owner[faces]).any():
            other = used[int(taken[taken > 0][0]) - 1]
            raise DataError(
                f"{at}: {int((taken > 0).sum())} faces are in mask {other.mask} of "
                f"{other.names[0]} too"
            )
        used.append(leaf)
        owner[faces] = len(used)
    if not used:
        raise DataError(f"{where}: expected a face in a mask of a leaf, found none")
    if len(used) > MOST_LEAVES:
        raise DataError(f"{where}: expected {MOST_LEAVES} parts at most, got {len(used)}")
    return owner, tuple(used)


def _faces_of(
    by_mesh: Any, counts: Sequence[int], starts: Int64[np.ndarray, "_"], where: str
) -> Int64[np.ndarray, "n"]:
    """List the faces of a mask, counted through all meshes."""
    if not isinstance(by_mesh, Mapping):
        raise DataError(f"{where}: expected faces by mesh, got {by_mesh!r:.60}")
    found = [np.empty(0, dtype=np.int64)]
    for mesh, faces in by_mesh.items():
        if not str(mesh).isdecimal() or int(mesh) >= len(counts):
            raise DataError(f"{where}: names mesh {mesh}, but there are {len(counts)} from 0")
        indices = _whole(
            faces, f"{where}: expected faces of mesh {mesh} as whole numbers in a list"
        )
        wrong = indices[(indices < 0) | (indices >= counts[int(mesh)])]
        if len(wrong):
            raise DataError(
                f"{where}: names face {wrong[0]} of mesh {mesh}, which has {counts[int(mesh)]} "
                "from 0"
            )
        found.append(indices + starts[int(mesh)])
    return np.concatenate(found)


def _whole(values: Any, expected: str) -> Int64[np.ndarray, "n"]:
    """Give whole numbers once each, in ascending order; none of another kind is rounded."""
    if not isinstance(values, list | tuple) or not all(
        type(value) is int and abs(value) < 1 << 62 for value in values
    ):
        raise DataError(f"{expected}, got {values!r:.60}")
    return np.unique(np.array(values, dtype=np.int64))
