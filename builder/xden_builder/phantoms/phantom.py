"""One simulated object: what it is, what it is made of, where it rests.

Every object has random numbers of its own, drawn from the seed and its id alone: it is the same
whatever the count, the order or the number of processes.
"""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol, runtime_checkable

import numpy as np
import trimesh

from xden1k.errors import DataError, MissingObjectError
from xden1k.values.mass import MassProperties, mass_of_meshes
from xden1k.values.materials import load_materials
from xden1k.values.types import UNSEEN, Split
from xden_builder.phantoms.appearance import draw_color, draw_finish, draw_paint
from xden_builder.phantoms.archetypes import ARCHETYPES
from xden_builder.phantoms.catalogue import CATALOGUE, Category
from xden_builder.phantoms.pieces import Piece, disjoint, moved
from xden_builder.phantoms.realism import TIDY, Realism, draw_label, draw_solid_share
from xden_builder.phantoms.shapes import to_mesh

__all__ = [
    "Identity",
    "Phantom",
    "PhantomPart",
    "Plan",
    "draw_density",
    "finished",
    "make_phantom",
    "plan_objects",
    "random_numbers",
]

_SPLITS: tuple[Split, ...] = (
    *("train", "train", "test", "train", "val"),
    *("train", "train", "test", "train", "train"),
)


@runtime_checkable
class Identity(Protocol):
    """What tells a simulated object from all others, and draws its random numbers."""

    @property
    def seed(self) -> int:
        """Of the whole set."""

    @property
    def object_id(self) -> str:
        """Unique in its set."""

    @property
    def kind(self) -> str:
        """Name of its category."""

    @property
    def split(self) -> Split:
        """Which one it is in."""

    def rng(self, purpose: str) -> np.random.Generator:
        """Return random numbers of this object for one purpose, independent of all others."""


@dataclass(frozen=True, slots=True)
class Plan:
    """Which object to make.

    Parameters
    ----------
    seed
        Of the whole set.
    place
        Index of the category in the catalogue.
    ordinal
        Number of the object in its category, from 0.
    unseen
        Whether its category is in no split but ``unseen``.

    Raises
    ------
    DataError
        If the seed is negative.
    """

    seed: int
    place: int
    ordinal: int
    unseen: bool = False

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise DataError(f"the seed must not be negative, got {self.seed}")

    @classmethod
    def of(cls, seed: int, object_id: str, unseen: Container[str] = ()) -> Plan:
        """Give the plan of an object by its id, and by the categories of the split ``unseen``.

        Raises
        ------
        MissingObjectError
            If no object is called so.

        Examples
        --------
        >>> Plan.of(7, "hammer-0003").ordinal
        3
        """
        name, _, number = object_id.rpartition("-")
        for place, category in enumerate(CATALOGUE):
            if category.name == name and number.isdecimal():
                return cls(seed, place, int(number), name in unseen)
        raise MissingObjectError(
            f"expected CATEGORY-NUMBER, such as hammer-0003, got {object_id!r}"
        )

    @property
    def category(self) -> Category:
        """Its kind."""
        return CATALOGUE[self.place]

    @property
    def kind(self) -> str:
        """Name of its category."""
        return self.category.name

    @property
    def object_id(self) -> str:
        """Category and number, such as ``hammer-0003``."""
        return f"{self.category.name}-{self.ordinal:04d}"

    @property
    def split(self) -> Split:
        """70 % train, 10 % val, 20 % test, over the first objects and within each category."""
        if self.unseen:
            return UNSEEN
        return _SPLITS[(self.place + 3 * self.ordinal) % len(_SPLITS)]

    def rng(self, purpose: str) -> np.random.Generator:
        """Return random numbers of this object for one purpose, independent of all others."""
        return random_numbers(self.seed, f"{self.object_id}/{purpose}")


def random_numbers(seed: int, purpose: str) -> np.random.Generator:
    """Give random numbers for one purpose, independent of those for all others."""
    return np.random.default_rng(np.random.SeedSequence([seed, *purpose.encode()]))


def plan_objects(
    count: int,
    seed: int,
    categories: Sequence[str] = (),
    split: Split | None = None,
    unseen: Sequence[str] = (),
) -> list[Plan]:
    """List the objects of a set: each category in turn, over and over.

    Parameters
    ----------
    count
        How many.
    seed
        Not negative.
    categories
        Only these; all if empty.
    split
        Of these objects, only those of one split.
    unseen
        Categories whose objects are all in the split ``unseen``.

    Raises
    ------
    DataError
        If the count is not positive, the seed is negative, a category unknown or no object left.

    Examples
    --------
    >>> [plan.object_id for plan in plan_objects(3, seed=0, categories=["mug", "hammer"])]
    ['hammer-0000', 'mug-0000', 'hammer-0001']
    """
    if count < 1:
        raise DataError(f"the number of objects must be positive, got {count}")
    names = [category.name for category in CATALOGUE]
    if unknown := sorted({*categories, *unseen} - set(names)):
        raise DataError(f"unknown categories {unknown}; known are {sorted(names)}")
    places = [place for place, name in enumerate(names) if not categories or name in categories]
    turns = [(places[i % len(places)], i // len(places)) for i in range(count)]
    plans = [Plan(seed, place, turn, names[place] in unseen) for place, turn in turns]
    chosen = [plan for plan in plans if split in (None, plan.split)]
    if not chosen:
        raise DataError(f"none of these {count} objects is of the split {split}")
    return chosen


@dataclass(frozen=True, slots=True, eq=False)
class PhantomPart:
    """One part of a simulated object.

    Parameters
    ----------
    name
        Unique in its object.
    role
        What it is for.
    mesh
        Closed, outward-wound, cm, object frame; disjoint from all other parts.
    material
        A name of the material library.
    density_g_cm3
        Within the material's range, times ``solid_share``.
    color_rgb
        Base colour, three values from 0 to 1.
    solid_share
        Share of the volume that is material; the rest is pores.
    metalness, roughness
        Of the surface, from 0 to 1, as glTF 2.0 has them.
    painted
        Whether colour and finish are those of a coat, not of the material.
    label
        What an annotator takes the material for: empty when left out, None when right.
    """

    name: str
    role: str
    mesh: trimesh.Trimesh
    material: str
    density_g_cm3: float
    color_rgb: tuple[float, float, float]
    solid_share: float = 1.0
    metalness: float = 0.0
    roughness: float = 0.5
    painted: bool = False
    label: str | None = None

    @property
    def label_material(self) -> str:
        """The material an annotator writes down; empty when left out."""
        return self.material if self.label is None else self.label


@dataclass(frozen=True, eq=False)
class Phantom:
    """A simulated object whose inside is known everywhere.

    Parameters
    ----------
    plan
        Which one it is.
    parts
        Sorted by name, disjoint.
    """

    plan: Identity
    parts: tuple[PhantomPart, ...]

    @cached_property
    def mass_properties(self) -> MassProperties:
        """Exact mass, centre of mass and inertia."""
        return mass_of_meshes(
            [part.mesh for part in self.parts], [part.density_g_cm3 for part in self.parts]
        )


def make_phantom(plan: Plan, realism: Realism = TIDY) -> Phantom:
    """Build an object: shape, pose, materials.

    ``realism`` changes what parts are like, never their shape, and leaves what it does not concern
    as it is: the same material, the same place.

    It rests as on a table, the centre of its bounding box at the origin, z up. What lies flat, an
    operator may also hold up on end in a block of foam, and turns it across both views'
    directions, so that neither looks along it. All else is turned at random about z.
    """
    shape = plan.rng("shape")
    size_cm = float(shape.uniform(*plan.category.size_cm))
    pieces = disjoint(ARCHETYPES[plan.category.archetype].build(shape, size_cm))
    parts = _draw_materials(_placed(pieces, plan.rng("pose")), plan)
    return Phantom(plan, finished(parts, plan, realism))


def finished(
    parts: Sequence[PhantomPart], plan: Identity, realism: Realism
) -> tuple[PhantomPart, ...]:
    """Give parts their finish, pores, paint and labels, and sort them by name."""
    parts = _labelled(_weathered(parts, plan, realism), plan, realism)
    return tuple(sorted(parts, key=lambda part: part.name))


def _placed(pieces: Sequence[Piece], rng: np.random.Generator) -> list[Piece]:
    low, high = _bounds(pieces)
    long, _, tall = high - low
    on_end, yaw = rng.random() < 0.5, float(rng.uniform(0.0, 360.0))
    if long > 1.5 * tall:
        if on_end and not any(piece.role == "liquid" for piece in pieces):  # it would pour out
            pieces = moved(pieces, lambda solid: solid.rotate((0.0, -90.0, 0.0)))
        yaw = 45.0 + 90.0 * (yaw // 90.0) + rng.uniform(-20.0, 20.0)
    turned = moved(pieces, lambda solid: solid.rotate((0.0, 0.0, yaw)))
    middle = np.mean(_bounds(turned), axis=0)
    shift = (-float(middle[0]), -float(middle[1]), -float(middle[2]))
    return moved(turned, lambda solid: solid.translate(shift))


def _bounds(pieces: Sequence[Piece]) -> np.ndarray:
    """Lowest and highest corner of all pieces, shape (2, 3)."""
    boxes = np.array([piece.solid.bounding_box() for piece in pieces])
    return np.stack([boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)])


def _draw_materials(pieces: Sequence[Piece], plan: Plan) -> list[PhantomPart]:
    """Parts of one role are of one batch: the same material, density and colour."""
    rng, choices = plan.rng("materials"), plan.category.materials
    batches: dict[str, tuple[str, float, tuple[float, float, float]]] = {}
    for role in dict.fromkeys(piece.role for piece in pieces):
        material = str(rng.choice(choices[role].split()))
        batches[role] = (material, draw_density(rng, material), draw_color(rng, material))
    return [
        PhantomPart(piece.name, piece.role, to_mesh(piece.solid), *batches[piece.role])
        for piece in pieces
    ]


def _weathered(parts: Sequence[PhantomPart], plan: Identity, realism: Realism) -> list[PhantomPart]:
    """Give the parts of each batch their finish, pores and paint."""
    finish, pores, paint, shades = map(plan.rng, ("finish", "pores", "paint", "shades"))
    batches: dict[str, dict[str, Any]] = {}
    for part in parts:
        if part.role in batches:
            continue
        metalness, roughness = draw_finish(finish, part.material)
        solid_share = draw_solid_share(pores, part.material, realism.porous_share)
        batch: dict[str, Any] = {
            "density_g_cm3": part.density_g_cm3 * solid_share,
            "solid_share": solid_share,
            "metalness": metalness,
            "roughness": roughness,
        }
        chance, (color, coat) = paint.random(), draw_paint(paint, shades)
        if chance < realism.paint_share:
            batch |= {"color_rgb": color, "metalness": 0.0, "roughness": coat, "painted": True}
        batches[part.role] = batch
    return [replace(part, **batches[part.role]) for part in parts]


def _labelled(parts: Sequence[PhantomPart], plan: Identity, realism: Realism) -> list[PhantomPart]:
    rng = plan.rng("labels")
    return [replace(part, label=draw_label(rng, part.material, realism)) for part in parts]


def draw_density(rng: np.random.Generator, material: str) -> float:
    """Draw a density of the material's range, most likely near its usual value."""
    known = load_materials()[material]
    return float(
        rng.triangular(
            known.density_low_g_cm3, known.density_nominal_g_cm3, known.density_high_g_cm3
        )
    )
