"""The pictures that the network learns from, with the material that each pixel shows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Bool, UInt8

from xden1k.predictor import Example
from xden1k.values.types import Part
from xden_baselines.gaussian_property.regions import part_numbers
from xden_baselines.materials import material_of
from xden_baselines.surface.network import STRIDE
from xden_baselines.views.pictures import BACKGROUND, Pictures

__all__ = ["UNKNOWN", "Lesson", "lessons", "shown_materials"]

UNKNOWN = 255
"""Of what shows no part, or one whose material is not on the list."""


@dataclass(frozen=True, slots=True, eq=False)
class Lesson:
    """One picture, kept small: colours of the object's pixels alone.

    Parameters
    ----------
    mask
        Shape (rows, columns): where the object is.
    colors
        Shape (pixels, 3): of these pixels, in C order.
    materials
        Shape (rows / 4, columns / 4): index of the material at the centre of each block of pixels
        that the network answers for; :data:`UNKNOWN` if none is known.
    """

    mask: Bool[np.ndarray, "rows columns"]
    colors: UInt8[np.ndarray, "pixels 3"]
    materials: UInt8[np.ndarray, "down across"]

    @property
    def picture(self) -> UInt8[np.ndarray, "rows columns 3"]:
        """The picture as it was."""
        picture = np.full((*self.mask.shape, 3), BACKGROUND, dtype=np.uint8)
        picture[self.mask] = self.colors
        return picture


def lessons(
    example: Example, names: Sequence[str], views: int, rng: np.random.Generator
) -> Iterator[Lesson]:
    """Draw some views of a training object in which a known material is seen.

    Parameters
    ----------
    example
        Its sample has pictures.
    names
        Materials, at most 255.
    views
        How many are drawn.
    rng
        Draws them.
    """
    pictures: Pictures = example.sample.pictures
    drawn = pictures.take(sorted(rng.permutation(len(pictures))[:views].tolist()))
    parts = example.truth.parts
    shown = shown_materials([part.mesh for part in parts], of_parts(parts, names), drawn)
    for view in range(len(drawn)):
        materials = shown[view, STRIDE // 2 :: STRIDE, STRIDE // 2 :: STRIDE]
        if (materials != UNKNOWN).any():
            mask = drawn.masks[view]
            yield Lesson(mask, drawn.colors[view][mask], materials)


def of_parts(parts: Sequence[Part], names: Sequence[str]) -> UInt8[np.ndarray, "parts"]:
    """Index of the material of each part; :data:`UNKNOWN` where it is not one of them."""
    index = {name: number for number, name in enumerate(names)}
    found = [index.get(material_of(part) or "", UNKNOWN) for part in parts]
    return np.array(found, dtype=np.uint8)


def shown_materials(
    meshes: Sequence[trimesh.Trimesh], materials: UInt8[np.ndarray, "parts"], pictures: Pictures
) -> UInt8[np.ndarray, "views rows columns"]:
    """Index of the material that each pixel shows, :data:`UNKNOWN` off the object."""
    table = np.concatenate([np.array([UNKNOWN], dtype=np.uint8), materials])
    return np.asarray(table[part_numbers(meshes, pictures.cameras)])
