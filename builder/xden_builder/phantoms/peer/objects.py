"""One object of the bench: as it is, and as an annotator and a scale tell of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import trimesh
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from xden1k.values.mass import MassProperties, mass_of_meshes
from xden_builder.phantoms.catalogue import CATALOGUE
from xden_builder.phantoms.peer.substances import Substance, labels_alike, substances_called
from xden_builder.phantoms.phantom import Plan, make_phantom, random_numbers

__all__ = ["LARGEST_CM", "PeerObject", "PeerPart", "draw_label", "make_object", "plan_bench"]

LARGEST_CM: Final = 22.0
"""Categories that grow larger may not fit the panel."""
WRONG_SHARE, MISSING_SHARE = 0.14, 0.05
ROTATION_DEG, SHIFT_CM = 0.6, 0.06
"""Root mean square of the angle and the length by which meshes are off."""
SCALE_SD: Final = 0.005


@dataclass(frozen=True, slots=True, eq=False)
class PeerPart:
    """One part.

    Parameters
    ----------
    name
        Unique in its object.
    mesh
        Where it is.
    substance, density_g_cm3
        What it is made of.
    label
        What ``parts.csv`` calls it; empty where it says nothing.
    """

    name: str
    mesh: trimesh.Trimesh
    substance: Substance
    density_g_cm3: float
    label: str


@dataclass(frozen=True, slots=True, eq=False)
class PeerObject:
    """One object.

    Parameters
    ----------
    plan
        Which shape it has.
    parts
        All of them, sharing no space.
    matrix
        From the object's points to those handed over.
    left_out
        Name of the part that nobody annotated; empty if there is none.
    scale_error
        Relative error of the mass on the scale.
    """

    plan: Plan
    parts: Sequence[PeerPart]
    matrix: Float[np.ndarray, "4 4"]
    left_out: str
    scale_error: float

    @property
    def annotated(self) -> list[PeerPart]:
        """The parts whose meshes are handed over."""
        return [part for part in self.parts if part.name != self.left_out]

    @property
    def mass_properties(self) -> MassProperties:
        """Exact mass, centre of mass and inertia."""
        densities = [part.density_g_cm3 for part in self.parts]
        return mass_of_meshes([part.mesh for part in self.parts], densities)

    def handed_over(self, part: PeerPart) -> trimesh.Trimesh:
        """Return the mesh of a part as the lab has it."""
        return part.mesh.copy().apply_transform(self.matrix)


def plan_bench(count: int, seed: int) -> list[Plan]:
    """Choose shapes: categories that fit the panel in random order, over and over."""
    places = [at for at, each in enumerate(CATALOGUE) if each.size_cm[1] <= LARGEST_CM]
    random_numbers(seed, "peer/categories").shuffle(places)
    return [Plan(seed, places[i % len(places)], i // len(places)) for i in range(count)]


def make_object(plan: Plan, *, unannotated_share: float = 0.0) -> PeerObject:
    """Give a shape of the catalogue other substances, labels that err and meshes that are off.

    Parameters
    ----------
    plan
        Which shape.
    unannotated_share
        Of the objects of two parts or more: one of their parts is left out.
    """
    phantom = make_phantom(plan)
    made, told = plan.rng("peer/substances"), plan.rng("peer/labels")
    batches: dict[str, tuple[Substance, float]] = {}
    parts = []
    for part in phantom.parts:
        if part.role not in batches:
            batches[part.role] = _draw_substance(made, part.material)
        label = draw_label(told, part.material)
        parts.append(PeerPart(part.name, part.mesh, *batches[part.role], label))
    off = plan.rng("peer/desk")
    return PeerObject(
        plan,
        parts,
        _draw_matrix(off),
        _draw_left_out(off, parts, unannotated_share),
        off.normal(0.0, SCALE_SD),
    )


def _draw_substance(rng: np.random.Generator, label: str) -> tuple[Substance, float]:
    options = substances_called(label)
    chosen = options[int(rng.integers(len(options)))]
    return chosen, rng.uniform(chosen.density_low_g_cm3, chosen.density_high_g_cm3)


def draw_label(rng: np.random.Generator, right: str) -> str:
    """Draw what an annotator writes down: mostly what is right, else another name, or nothing."""
    chance, pick = rng.random(), rng.random()
    if chance < MISSING_SHARE:
        return ""
    if chance >= MISSING_SHARE + WRONG_SHARE:
        return right
    others = labels_alike(right)
    return others[int(pick * len(others))]


def _draw_matrix(rng: np.random.Generator) -> Float[np.ndarray, "4 4"]:
    turn, shift = rng.normal(size=(2, 3)) * np.array([[ROTATION_DEG], [SHIFT_CM]]) / np.sqrt(3)
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(turn, degrees=True).as_matrix()
    matrix[:3, 3] = shift
    return matrix


def _draw_left_out(rng: np.random.Generator, parts: Sequence[PeerPart], share: float) -> str:
    chance, pick = rng.random(), rng.random()
    return parts[int(pick * len(parts))].name if len(parts) > 1 and chance < share else ""
