"""Parts of a picture: what stands in for the masks of Segment Anything.

A segmentation is (rows, columns) int32: -1 off the object, 0 on it but in no kept region, k = in
region k. Regions are numbered from the largest; of two alike the one that begins further up,
then further left, comes first.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import trimesh
from jaxtyping import Bool, Int32, Integer, UInt8
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from xden1k.values.arrays import Mask
from xden_baselines.chat.candidates import Picture
from xden_baselines.views.cameras import Camera
from xden_baselines.views.rendering import render

__all__ = ["Segmentation", "color_regions", "kept_regions", "part_numbers"]

Segmentation = Int32[np.ndarray, "rows columns"]

CHROMA_STEP = 0.02
"""Largest step of red's and of green's share in a colour within a region."""
LIGHT_STEP = 0.12
"""Largest step of the logarithm of brightness: shading is smooth, an edge of colour is not."""
SMALLEST = 300 / 1280**2
"""Regions with less of the picture are dropped: the original's 300 px at 1280 px."""


def color_regions(picture: Picture, mask: Mask) -> Segmentation:
    """Cut the object into regions in which colour changes by small steps from pixel to pixel.

    It finds what is painted alike and touches; two parts of one colour are one region.
    """
    light = np.log(picture.sum(axis=-1, dtype=np.float64).clip(1, None))
    chroma = picture[..., :2] / np.exp(light)[..., None]
    pixels = np.arange(mask.size).reshape(mask.shape)
    links = []
    for one, other in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
        alike = (
            mask[one]
            & mask[other]
            & (np.abs(light[one] - light[other]) < LIGHT_STEP)
            & (np.abs(chroma[one] - chroma[other]) < CHROMA_STEP).all(axis=-1)
        )
        links.append(np.stack([pixels[one][alike], pixels[other][alike]]))
    ends = np.concatenate(links, axis=1)
    graph = coo_array((np.ones(ends.shape[1], dtype=bool), tuple(ends)), shape=(mask.size,) * 2)
    _, component = connected_components(graph, directed=False)
    return kept_regions(component.reshape(mask.shape), mask)[0]


def part_numbers(
    meshes: Sequence[trimesh.Trimesh], cameras: Sequence[Camera]
) -> UInt8[np.ndarray, "views rows columns"]:
    """Which part each pixel shows, from 1; 0 off the object. For methods that read ``PARTS``."""
    return render(meshes, [(0.0, 0.0, 0.0)] * len(meshes), cameras).parts


def kept_regions(
    numbers: Integer[np.ndarray, "rows columns"], mask: Bool[np.ndarray, "rows columns"]
) -> tuple[Segmentation, Integer[np.ndarray, "regions"]]:
    """Return regions numbered by size, small ones dropped; the largest always stays.

    Parameters
    ----------
    numbers
        Any number for each region, read where the mask is True.
    mask
        The object.

    Returns
    -------
    segmentation
        See the module.
    kept
        The number that each region, from the first, had.
    """
    found, first, which, sizes = np.unique(
        numbers[mask], return_index=True, return_inverse=True, return_counts=True
    )
    order = np.lexsort([first, -sizes])
    big = sizes[order] >= SMALLEST * mask.size
    big[:1] = True
    kept = order[big]
    new = np.zeros(len(found), dtype=np.int32)
    new[kept] = np.arange(1, len(kept) + 1)
    segmentation = np.full(mask.shape, -1, dtype=np.int32)
    segmentation[mask] = new[which]
    return segmentation, found[kept]
