"""Closed, disjoint solids of a model's parts, of its walls and of what fills it.

On a grid: where air does not come is inside. A part whose own surface, its holes covered, encloses
space is filled; an open one that does not, or is drawn to be hollow, gets a wall of a drawn
thickness. What then is left inside becomes filler, void, or filler with an inclusion, as drawn.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import trimesh
from jaxtyping import Bool, Float32, Float64, Int64
from scipy import ndimage

from xden1k.errors import DataError
from xden1k.rays import CubeGrid, field_solid, label_solids
from xden1k.values.arrays import Labels
from xden1k.values.closed import edge_faults
from xden1k.values.types import MAX_PARTS
from xden_builder.capture.solids import simplified
from xden_builder.phantoms.partnext.bodies import bodies, capped, filled, lined
from xden_builder.phantoms.partnext.flood import REACH, depths, flooded, near_voxels, sides
from xden_builder.phantoms.partnext.model import Model
from xden_builder.phantoms.partnext.surface import Surface

__all__ = ["FATES", "GRID", "HOLLOW_SHARE", "Shape", "Solid", "role_of", "shape_model"]

GRID: Final = 96
"""Voxels along each side by default; parts of the size of one are lost."""
LEAST_GRID: Final = 24
MARGIN: Final = 6
"""Voxels of air around a model, for walls that stand out from it."""
WALL_SHARE: Final = (0.02, 0.06)
"""Of the longest side: thickness of walls, drawn evenly in its logarithm."""
WALL_VOXELS: Final = (2.0, 6.0)
"""Thinner is not told apart on the grid, thicker does not fit its margin."""
HOLLOW_SHARE: Final = 0.5
"""Of the parts that enclose space only with their holes covered: they are shells."""
FATES: Final = ("filler", "void", "inclusion")
"""Of a space that no part fills, each as likely; an inclusion lies in filler."""
LEAST_ROOM: Final = 27
"""Voxels; a smaller space goes to the parts around it."""
LEAST_ROOM_SHARE: Final = 1e-3
"""Of the object, likewise."""
CORE: Final = 0.5
"""An inclusion is what lies deeper in its room than this share of the deepest point."""
SMOOTHED: Final = 0.02
"""Voxels by which facets of the outer surface may be moved to leave out others."""

Mask3D = Bool[np.ndarray, "x y z"]
Voxels = Int64[np.ndarray, "_"]
Draw = Callable[[str], np.random.Generator]
Kind = Literal["part", "filler", "inclusion"]


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """A piece of an object.

    Parameters
    ----------
    kind
        ``part`` for a leaf of the hierarchy; what is inside otherwise.
    leaf
        Index of the leaf; -1 for what is inside.
    mesh
        Closed, wound outwards, cm.
    """

    kind: Kind
    leaf: int
    mesh: trimesh.Trimesh


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """A model as solids, which fill the outer surface but for its voids.

    Parameters
    ----------
    outer
        Closed, cm: everything inside, voids included.
    solids
        Disjoint; the parts in the order of the leaves, then what is inside.
    voids, void_cm3
        How many spaces are left empty, and their volume.
    walls_cm
        By role: thickness of walls, of the parts that have any.
    """

    outer: trimesh.Trimesh
    solids: tuple[Solid, ...]
    voids: int
    void_cm3: float
    walls_cm: dict[str, float]


def role_of(name: str) -> str:
    """Spell a part's name as files do: small letters, digits, and _ for the rest.

    Examples
    --------
    >>> role_of("Surface Panel"), role_of("Türgriff/2"), role_of("?")
    ('surface_panel', 't_rgriff_2', 'part')
    """
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_") or "part"


def shape_model(model: Model, half_cm: float, draw: Draw, size: int = GRID) -> Shape:
    """Turn a model into solids.

    Parameters
    ----------
    model
        Its surface and parts.
    half_cm
        Half of the longest side of the box around the surface.
    draw
        Random numbers for a purpose, such as the wall of a role.
    size
        Voxels along each side of the grid.

    Raises
    ------
    DataError
        If the surface has no extent, or a part leaves no closed solid.
    """
    if size < LEAST_GRID:
        raise DataError(f"the grid must have at least {LEAST_GRID} voxels a side, got {size}")
    triangles, grid = _placed(model, half_cm, size)
    roles = [role_of(leaf.names[0]) for leaf in model.leaves]
    walls = np.array([WALL_VOXELS[0], *(_wall(draw, role, size) for role in roles)])
    whole = Surface.of(triangles)
    air = flooded(whole, (size,) * 3)
    front, back = sides(whole, air)
    depth = depths(whole.only(front | back), air)
    thick = _thickened(depth, whole.only(front & back), model.owner, walls)
    outer = simplified(field_solid(thick, grid), SMOOTHED * grid.voxel_size_cm)
    if not len(outer.faces):
        raise DataError(f"{model.where}: its surface encloses nothing")
    masks = [
        _space(triangles[model.owner == leaf], depth > 0, thick > 0, draw(f"hollow/{role}"), wall)
        for leaf, (role, wall) in enumerate(zip(roles, walls[1:].tolist(), strict=True), 1)
    ]
    labels = _labelled([voxels for voxels, _ in masks], (size,) * 3)
    _cover(labels, thick)
    kinds, void, voids = _fill_rooms(labels, thick > 0, len(masks), draw("rooms"))
    meshes = label_solids(outer, labels, grid, void)
    solids = _checked(model, kinds, meshes)
    lined_cm = {
        role: wall * grid.voxel_size_cm
        for role, wall, (_, shell) in zip(roles, walls[1:].tolist(), masks, strict=True)
        if shell
    }
    void_cm3 = float(outer.volume) - sum(float(solid.mesh.volume) for solid in solids)
    return Shape(outer, solids, voids, void_cm3 if voids else 0.0, lined_cm)


def _placed(
    model: Model, half_cm: float, size: int
) -> tuple[Float64[np.ndarray, "t 3 3"], CubeGrid]:
    """Put a model in the middle of a grid; its triangles in voxels."""
    triangles = model.vertices[model.faces]
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    longest = float((high - low).max())
    if not longest > 0:
        raise DataError(f"{model.where}: all of its faces are one point")
    step = (size - 2 * MARGIN) / longest
    voxel_cm = 2 * half_cm / (size - 2 * MARGIN)
    placed = (triangles - (low + high) / 2) * step + (size - 1) / 2
    return placed, CubeGrid(np.full(3, -(size - 1) / 2 * voxel_cm), voxel_cm, size)


def _wall(draw: Draw, role: str, size: int) -> float:
    """Draw the thickness of a role's walls, in voxels."""
    least, most = np.log(WALL_SHARE)
    share = float(np.exp(draw(f"wall/{role}").uniform(least, most)))
    return float(np.clip(share * (size - 2 * MARGIN), *WALL_VOXELS))


def _thickened(
    depth: Float32[np.ndarray, "x y z"],
    sheets: Surface,
    owner: Int64[np.ndarray, "_"],
    walls: Float64[np.ndarray, "_"],
) -> Float32[np.ndarray, "x y z"]:
    """Give what has air on both sides half of its wall on either."""
    if not len(sheets.points):
        return depth
    reach = float(walls.max()) / 2 + 1.0
    voxels = near_voxels(sheets, depth.shape, reach)
    hit, feet, which = sheets.nearest(voxels.astype(np.float64), reach)
    near = voxels[hit]
    wall = walls[owner[sheets.triangle[which]]]
    thick = depth.copy()
    at = tuple(near.T)
    thick[at] = np.maximum(thick[at], wall / 2 - np.linalg.norm(near - feet, axis=1))
    return thick


def _space(
    triangles: Float64[np.ndarray, "t 3 3"],
    inside: Mask3D,
    full: Mask3D,
    rng: np.random.Generator,
    wall: float,
) -> tuple[Voxels, bool]:
    """List the voxels of a part, and whether some of them are a wall.

    A closed piece within another one is a cavity.
    """
    hollow = rng.random() < HOLLOW_SHARE
    solid = np.zeros(full.size, dtype=np.bool_)
    shells = []
    for body in bodies(triangles):
        whole = capped(body)
        is_open = len(whole) > len(body)
        voxels = np.empty(0, dtype=np.int64)
        if not (is_open and hollow):
            voxels = filled(whole, full.shape)
            kept = voxels[inside.reshape(-1)[voxels]]
            voxels = kept if 2 * len(kept) > len(voxels) else kept[:0]
        if not len(voxels):
            shells.append(body)
        elif not is_open and solid[voxels].all():
            solid[voxels] = False
        else:
            solid[voxels] = True
    if shells:
        near = lined(Surface.of(np.concatenate(shells)), full, wall)
        solid[near] = True
    return np.flatnonzero(solid), bool(shells)


def _labelled(spaces: Sequence[Voxels], shape: tuple[int, ...]) -> Labels:
    """Give each voxel to the smallest part that claims it."""
    labels = np.zeros(shape, dtype=np.uint8)
    flat = labels.reshape(-1)
    for place in sorted(range(len(spaces)), key=lambda place: -len(spaces[place])):
        flat[spaces[place]] = place + 1
    return labels


def _cover(labels: Labels, thick: Float32[np.ndarray, "x y z"]) -> None:
    """Give what no part claims just below the outer surface to the nearest part, in place.

    So no room reaches the air where faces belong to no part.
    """
    bare = (thick > 0) & (thick < REACH) & (labels == 0)
    if bare.any() and labels.any():
        nearest = ndimage.distance_transform_edt(
            labels == 0, return_distances=False, return_indices=True
        )
        labels[bare] = labels[tuple(nearest)][bare]


def _fill_rooms(
    labels: Labels, full: Mask3D, parts: int, rng: np.random.Generator
) -> tuple[list[Kind], int | None, int]:
    """Label what no part claims, in place.

    Returns
    -------
    kinds
        Of the labels 1, 2, ...
    void
        The label of what is left empty, which is the last one, if any is.
    voids
        How many spaces that are.
    """
    kinds: list[Kind] = ["part"] * parts
    rooms, count = ndimage.label(full & (labels == 0))
    sizes = np.bincount(rooms.reshape(-1), minlength=count + 1)[1:]
    least = max(LEAST_ROOM, LEAST_ROOM_SHARE * int(full.sum()))
    empty = []
    for room in (np.flatnonzero(sizes >= least) + 1).tolist():
        fate = str(rng.choice(FATES))
        if fate == "void" or len(kinds) + 3 > MAX_PARTS:
            empty.append(room)
            continue
        mine = rooms == room
        kinds.append("filler")
        labels[mine] = len(kinds)
        if fate == "inclusion":
            deep = ndimage.distance_transform_edt(mine)
            kinds.append("inclusion")
            labels[deep > CORE * deep.max()] = len(kinds)
    if not empty:
        return kinds, None, 0
    labels[np.isin(rooms, empty)] = len(kinds) + 1
    return kinds, len(kinds) + 1, len(empty)


def _checked(
    model: Model, kinds: Sequence[Kind], meshes: Sequence[trimesh.Trimesh]
) -> tuple[Solid, ...]:
    """Refuse parts that did not become solids; what is inside may have become nothing."""
    solids = []
    for place, kind in enumerate(kinds):
        mesh = meshes[place] if place < len(meshes) else trimesh.Trimesh()
        faults = edge_faults(np.asarray(mesh.faces))
        sound = len(mesh.faces) and not any(faults) and mesh.volume > 0
        if kind == "part" and not sound:
            leaf = model.leaves[place]
            what = f"{faults.open} open edges" if len(mesh.faces) else "nothing left of it"
            raise DataError(
                f"{model.where}: mask {leaf.mask} of {leaf.names[0]}: expected a closed solid "
                f"after filling, got {what}: it is too small for the grid, or wholly inside others"
            )
        if sound:
            solids.append(Solid(kind, place if kind == "part" else -1, mesh))
    return tuple(solids)
