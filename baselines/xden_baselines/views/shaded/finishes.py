"""What a phantom's parts look like: the finish of each, and whether it is painted.

``looks.csv`` says with which finishes a material or a family is found, ``finishes.csv`` what each
is like. What a finish is drawn from is the object's id and the colour of the batch, never the
material: two alloys that are found with the same finishes look the same to the bit, and so does
paint on whatever it covers. Both tables are our own judgement of everyday things.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import numpy as np
from jaxtyping import Float

from xden1k.errors import DataError
from xden1k.values.materials import load_materials
from xden1k.values.palette import Color, is_coat
from xden1k.values.types import Part

__all__ = ["Finish", "Look", "draw_looks", "finishes_of"]

PAINT, CLOUDY = "paint", "cloudy"


@dataclass(frozen=True, slots=True)
class Finish:
    """How a kind of surface looks.

    Parameters
    ----------
    name
        Of the finish.
    texture
        One of ``TEXTURES``.
    scale_cm
        Size of the texture's features.
    metalness
        1 for metals, 0 for all else, as glTF 2.0 has it.
    roughness_low, roughness_high
        As glTF 2.0 has it, from 0 to 1.
    relief
        Slope of the texture.
    contrast
        By how much the texture lightens and darkens the colour.
    refractive_index
        Of what can be seen through; 0 of what is opaque.
    tint_cm
        Thickness at which what can be seen through has its colour; 0 of what is opaque.
    """

    name: str
    texture: str
    scale_cm: float
    metalness: float
    roughness_low: float
    roughness_high: float
    relief: float
    contrast: float
    refractive_index: float
    tint_cm: float


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """What one part looks like.

    Parameters
    ----------
    finish
        Of its surface.
    color
        Base colour, linear red, green and blue.
    roughness
        Of the whole part.
    offset
        Where in the texture the part was cut, in features.
    """

    finish: Finish
    color: Float[np.ndarray, "3"]
    roughness: float
    offset: Float[np.ndarray, "3"]

    @property
    def clear(self) -> bool:
        """Whether one can see through it."""
        return self.finish.refractive_index > 0

    @property
    def holds_others(self) -> bool:
        """Whether other parts may stick in it, their surfaces on its own, and be seen there."""
        return self.clear or self.finish.name == CLOUDY


def draw_looks(object_id: str, parts: Sequence[Part]) -> list[Look]:
    """Draw how the parts of an object look; those of one colour and finish are of one batch.

    Raises
    ------
    DataError
        If a part has no material: nothing then says how it shines.
    """
    return [_draw(object_id, part) for part in parts]


def finishes_of(material: str) -> tuple[Finish, ...]:
    """Finishes that a material or family of the library is found with, usual ones more than once.

    Raises
    ------
    DataError
        If the library knows no such name.
    """
    looks, library = _looks(), load_materials()
    if material in looks:
        return looks[material]
    if material not in library:
        raise DataError(f"no look is known of the material {material!r}")
    return looks[library[material].family]


def _draw(object_id: str, part: Part) -> Look:
    if not part.material:
        raise DataError(
            f"{object_id}: the part {part.name} has no material, and nothing says how it shines: "
            "take flat pictures"
        )
    painted = is_coat(part.material, part.color_rgb)
    choices = (_finishes()[PAINT],) if painted else finishes_of(part.material)
    batch, piece = _rng(object_id, part.color_rgb), _rng(f"{object_id}/{part.name}", part.color_rgb)
    finish = choices[int(batch.random() * len(choices))]
    share, offset = batch.random(), piece.uniform(0, 64, 3)
    roughness = finish.roughness_low + share * (finish.roughness_high - finish.roughness_low)
    return Look(finish, linear(np.array(part.color_rgb)), roughness, offset)


def linear(displayed: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """Light of displayed values from 0 to 1, by sRGB (IEC 61966-2-1)."""
    steep = ((displayed + 0.055) / 1.055) ** 2.4
    return np.where(displayed <= 0.04045, displayed / 12.92, steep)


def _rng(name: str, color: Color) -> np.random.Generator:
    return np.random.default_rng([*name.encode(), *(round(1000 * value) for value in color)])


@cache
def _finishes() -> dict[str, Finish]:
    found = {}
    for row in _table("finishes.csv"):
        name, texture = row.pop("finish"), row.pop("texture")
        found[name] = Finish(name, texture, **{key: float(text) for key, text in row.items()})
    return found


@cache
def _looks() -> dict[str, tuple[Finish, ...]]:
    finishes = _finishes()
    return {
        row["subject"]: tuple(finishes[name] for name in row["finishes"].split())
        for row in _table("looks.csv")
    }


def _table(name: str) -> list[dict[str, str]]:
    text = files(__package__).joinpath(name).read_text(encoding="utf-8")
    return list(csv.DictReader(text.splitlines()))
