"""One simulated object on a shape of PartNeXt: how large, of what, in which pose."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from xden1k.errors import DataError
from xden1k.format.shapes import ON_PARTNEXT
from xden1k.values.types import Split
from xden_builder.phantoms.appearance import draw_color
from xden_builder.phantoms.partnext.model import Leaf, Model
from xden_builder.phantoms.partnext.priors import (
    FILLERS,
    draw_material,
    materials_named,
    usual_materials,
)
from xden_builder.phantoms.partnext.solids import GRID, LEAST_GRID, Shape, role_of, shape_model
from xden_builder.phantoms.phantom import (
    Phantom,
    PhantomPart,
    draw_density,
    finished,
    random_numbers,
)
from xden_builder.phantoms.realism import TIDY, Realism

__all__ = ["HALF_CM", "ModelPlan", "Shaping", "model_phantom"]

HALF_CM: Final = (2.0, 10.0)
"""Half of the longest side, drawn evenly in its logarithm: a GLB has no scale."""
_SPLITS: Final[tuple[tuple[float, Split], ...]] = ((0.7, "train"), (0.8, "val"), (1.0, "test"))


@dataclass(frozen=True, slots=True)
class Shaping:
    """How shapes become objects.

    Parameters
    ----------
    half_cm
        Least and greatest half of the longest side.
    grid
        Voxels along each side of the grid on which parts are made solids.

    Raises
    ------
    DataError
        If the sizes are not positive and ascending, or the grid is too coarse.
    """

    half_cm: tuple[float, float] = HALF_CM
    grid: int = GRID

    def __post_init__(self) -> None:
        least, most = self.half_cm
        if not 0 < least <= most < np.inf:
            raise DataError(f"sizes must be positive and ascending, got {least:g} and {most:g} cm")
        if self.grid < LEAST_GRID:
            raise DataError(f"the grid must have {LEAST_GRID} voxels a side, got {self.grid}")


@dataclass(frozen=True, slots=True)
class ModelPlan:
    """Which object to make.

    Parameters
    ----------
    seed
        Of the whole set.
    object_id
        The model's.
    kind
        Name of the whole, as a category.
    """

    seed: int
    object_id: str
    kind: str

    @property
    def split(self) -> Split:
        """70 % train, 10 % val, 20 % test by the model alone: a shape is in one, with any seed."""
        digest = hashlib.sha256(self.object_id.encode()).digest()
        share = int.from_bytes(digest[:6], "big") / 2**48
        return next(split for most, split in _SPLITS if share < most)

    def rng(self, purpose: str) -> np.random.Generator:
        """Return random numbers of this object for one purpose, independent of all others."""
        return random_numbers(self.seed, f"partnext/{self.object_id}/{purpose}")


def model_phantom(
    model: Model, seed: int, object_id: str, shaping: Shaping, realism: Realism = TIDY
) -> tuple[Phantom, dict[str, Any]]:
    """Build an object: solids, size, materials; it stands as the GLB has it, turned about z.

    Parts whose leaves share a name are of one batch: the same material, density and colour.

    Returns
    -------
    phantom
        The centre of its box at the origin, z up.
    told
        What was drawn of the shape, of JSON's types, for ``truth.json``.

    Raises
    ------
    DataError
        If a part leaves no closed solid.
    """
    plan = ModelPlan(seed, object_id, role_of(model.category))
    least, most = np.log(shaping.half_cm)
    half_cm = float(np.exp(plan.rng("size").uniform(least, most)))
    shape = shape_model(model, half_cm, plan.rng, shaping.grid)
    yaw = Rotation.from_euler("z", plan.rng("pose").uniform(0.0, 2 * np.pi)).as_matrix()
    parts = _with_materials(_named(model, shape), plan, yaw)
    told = {
        "notes": ON_PARTNEXT,
        "half_side_cm": half_cm,
        "voids": shape.voids,
        "void_cm3": shape.void_cm3,
        "walls_cm": shape.walls_cm,
        "grid": shaping.grid,
        "unowned_faces": int((model.owner == 0).sum()),
    }
    return Phantom(plan, finished(parts, plan, realism)), told


@dataclass(frozen=True, slots=True, eq=False)
class _Named:
    """A solid with its name, its role, and what it may be made of."""

    name: str
    role: str
    mesh: trimesh.Trimesh
    choices: tuple[str, ...]


def _named(model: Model, shape: Shape) -> list[_Named]:
    """Name the solids by their role, numbered where several have it."""
    roles = [_role(solid.leaf, solid.kind, model.leaves) for solid in shape.solids]
    counts = Counter(roles)
    numbers: Counter[str] = Counter()
    found = []
    for solid, role in zip(shape.solids, roles, strict=True):
        numbers[role] += 1
        name = role if counts[role] == 1 else f"{role}-{numbers[role]:03d}"
        if solid.leaf >= 0:
            choices = materials_named(model.leaves[solid.leaf].names)
        else:
            choices = FILLERS if solid.kind == "filler" else usual_materials()
        found.append(_Named(name, role, solid.mesh, choices))
    return found


def _role(leaf: int, kind: str, leaves: Sequence[Leaf]) -> str:
    """Spell a leaf's name; what is inside is called otherwise than any leaf can be."""
    return role_of(leaves[leaf].names[0]) if leaf >= 0 else f"inside-{kind}"


def _with_materials(named: Sequence[_Named], plan: ModelPlan, yaw: np.ndarray) -> list[PhantomPart]:
    """Draw a material for each role, and place the meshes."""
    turned = [one.mesh.vertices @ yaw.T for one in named]
    middle = (
        np.min([points.min(axis=0) for points in turned], axis=0)
        + np.max([points.max(axis=0) for points in turned], axis=0)
    ) / 2
    batches: dict[str, Mapping[str, Any]] = {}
    parts = []
    for one, points in zip(named, turned, strict=True):
        if one.role not in batches:
            rng = plan.rng(f"material/{one.role}")
            material = draw_material(rng, one.choices)
            batches[one.role] = {
                "material": material,
                "density_g_cm3": draw_density(rng, material),
                "color_rgb": draw_color(rng, material),
            }
        mesh = trimesh.Trimesh(points - middle, one.mesh.faces, process=False)
        parts.append(PhantomPart(one.name, one.role, mesh, **batches[one.role]))
    return parts
