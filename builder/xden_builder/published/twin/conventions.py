"""What is the same for every object of a release, and what a reader must find out."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from itertools import permutations, product
from typing import Any, Final, Literal, get_args

import numpy as np
from jaxtyping import Int

from xden1k.errors import DataError
from xden_builder.phantoms.phantom import random_numbers

__all__ = ["VARIANTS", "Conventions", "Variant", "draw_conventions", "signed_permutations"]

Variant = Literal["A", "B", "tiny"]
VARIANTS: Final[tuple[Variant, ...]] = get_args(Variant)

ORDERS: Final = tuple(permutations(range(3)))[1:]
"""Of the three axes, all but their own."""

Axes = Int[np.ndarray, "3 3"]


@dataclass(frozen=True, slots=True, eq=False)
class Conventions:
    """How the files of a release relate to each other.

    Parameters
    ----------
    axes
        Shape (3, 3), a signed permutation: axes of the volume = ``axes`` @ axes of the mesh file.
    size_axes
        Entry i of ``size`` is the extent along axis ``size_axes[i]`` of the mesh file.
    stretched
        Whether each axis of the object is scaled to fill the volume by itself.
    soft_edges
        Whether a voxel holds the mean over its space, rather than the value at its centre.
    share_steps
        Into how many steps the share of a voxel is rounded, so that the file packs well; 0: not.
    padding
        Air on each side of the longest axis, as a share of the volume's edge.
    wandering
        Whether objects lie off the volume's centre, by up to half of the padding.
    voxels
        Along each edge of the volume.
    named_parts
        Whether a table's keys are names, rather than ``part_0``, ``part_1``.
    metadata_inside
        Whether ``metadata.json`` lies in ``dataset/``, rather than above it.
    stray_images
        Whether folders hold images of no stated meaning.
    facet
        Longest edge of the mesh's triangles, as a share of the object's longest extent.
    tolerance
        How far a simplified mesh may leave the object, as a share of its longest extent.
    texture_px
        Pixels along each side of a chart of the texture.
    """

    axes: Axes
    size_axes: tuple[int, int, int]
    stretched: bool
    soft_edges: bool
    share_steps: int
    padding: float
    wandering: bool
    voxels: int
    named_parts: bool
    metadata_inside: bool
    stray_images: bool
    facet: float
    tolerance: float
    texture_px: int

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON."""
        return asdict(self) | {"axes": self.axes.tolist()}


def signed_permutations(determinant: int) -> list[Axes]:
    """List the 24 signed permutations of three axes with a determinant of 1 or -1.

    Examples
    --------
    >>> len(signed_permutations(1)), len(signed_permutations(-1))
    (24, 24)
    """
    every = (
        np.diag(signs) @ np.eye(3, dtype=np.int64)[list(order)]
        for order in permutations(range(3))
        for signs in product((1, -1), repeat=3)
    )
    return [axes for axes in every if round(np.linalg.det(axes)) == determinant]


def draw_conventions(variant: Variant, seed: int) -> Conventions:
    """Draw a release.

    Parameters
    ----------
    variant
        ``A``: soft edges, one scale, right-handed, named parts, metadata in ``dataset/``. ``B``:
        hard edges, stretched to the box, mirrored, opaque keys, metadata on top, another order of
        ``size``, stray images. ``tiny``: as A, with volumes of 64³ and coarse meshes.
    seed
        Not negative.

    Raises
    ------
    DataError
        If there is no such variant.

    Examples
    --------
    >>> round(np.linalg.det(draw_conventions("B", 0).axes))
    -1
    """
    if variant not in VARIANTS:
        raise DataError(f"the variant must be one of {', '.join(VARIANTS)}, got {variant!r}")
    rng = random_numbers(seed, f"twin {variant}")
    plain = variant != "B"
    axes = signed_permutations(1 if plain else -1)
    first, second, third = (0, 1, 2) if plain else ORDERS[int(rng.integers(len(ORDERS)))]
    return Conventions(
        axes=axes[int(rng.integers(len(axes)))],
        size_axes=(first, second, third),
        stretched=not plain,
        soft_edges=plain,
        share_steps=8 if variant == "tiny" else 0,
        padding=0.08 if plain else 0.01,
        wandering=plain,
        voxels=64 if variant == "tiny" else 256,
        named_parts=plain,
        metadata_inside=plain,
        stray_images=not plain,
        facet=0.35 if variant == "tiny" else 0.012,
        tolerance=0.01 if variant == "tiny" else 0.0,
        texture_px=4 if variant == "tiny" else 64,
    )
