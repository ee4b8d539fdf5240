"""Charts of a texture: what splits the vertices of a mesh along seams."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import trimesh
from jaxtyping import Float64, Int64, UInt8
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

__all__ = ["Atlas", "textured"]

SIDES: Final = 6
"""Charts of a part: one for each direction that a box is seen from."""
GRAIN: Final = 0.04
"""Standard deviation of the texture's brightness."""

Color = tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Atlas:
    """One picture for all surfaces of an object: a column for each part, a row for each side.

    Parameters
    ----------
    colors
        Of each part, values from 0 to 1.
    chart_px
        Pixels along each side of a chart.
    """

    colors: Sequence[Color]
    chart_px: int

    def image(self, rng: np.random.Generator) -> Image.Image:
        """Paint the picture: the colours of the parts, with some grain."""
        parts, edge = len(self.colors), self.chart_px
        painted = np.broadcast_to(np.array(self.colors), (SIDES, parts, 3))
        pixels = painted.repeat(edge, axis=0).repeat(edge, axis=1)
        grain = rng.normal(1.0, GRAIN, (*pixels.shape[:2], 1))
        rgb: UInt8[np.ndarray, "rows columns 3"] = (255 * pixels * grain).clip(0, 255).astype("u1")
        return Image.fromarray(rgb)

    def place(
        self,
        inside: Float64[np.ndarray, "n 2"],
        part: Int64[np.ndarray, "n"],
        side: Int64[np.ndarray, "n"],
    ) -> Float64[np.ndarray, "n 2"]:
        """Place points of charts, 0 to 1 in each, in the picture, half a pixel off its edges."""
        margin = 0.5 / self.chart_px
        within = margin + (1 - 2 * margin) * inside
        at = np.stack([part + within[:, 0], SIDES - 1 - side + within[:, 1]], axis=1)
        return np.asarray(at / [len(self.colors), SIDES])


def textured(
    mesh: trimesh.Trimesh, part: Int64[np.ndarray, "faces"], atlas: Atlas, image: Image.Image
) -> trimesh.Trimesh:
    """Give a mesh its texture; each chart gets vertices of its own.

    Parameters
    ----------
    mesh
        Its faces may be wound either way.
    part
        Column of the atlas, for each face.
    atlas, image
        What it looks like.
    """
    side = _sides(mesh)
    corners = np.stack([mesh.faces.ravel(), np.repeat(SIDES * part + side, 3)], axis=1)
    kept, faces = np.unique(corners, axis=0, return_inverse=True)
    vertices = mesh.vertices[kept[:, 0]]
    column, row = np.divmod(kept[:, 1], SIDES)
    low, high = mesh.bounds
    inside = (vertices - low) / np.maximum(high - low, np.finfo(np.float64).tiny)
    flat = np.array([[1, 2], [0, 2], [0, 1]])[row % 3]
    uv = atlas.place(np.take_along_axis(inside, flat, axis=1), column, row)
    material = PBRMaterial(  # type: ignore[no-untyped-call]
        baseColorTexture=image, metallicFactor=0.0, roughnessFactor=0.8
    )
    visual = TextureVisuals(uv=uv, material=material)  # type: ignore[no-untyped-call]
    return trimesh.Trimesh(vertices, faces.reshape(-1, 3), process=False, visual=visual)


def _sides(mesh: trimesh.Trimesh) -> Int64[np.ndarray, "faces"]:
    """Which way each face looks: x, y, z, or the opposite, as 0 to 5."""
    crosses = mesh.triangles_cross
    axis = np.abs(crosses).argmax(axis=1)
    backwards = np.take_along_axis(crosses, axis[:, None], axis=1)[:, 0] < 0
    return np.asarray(axis + 3 * backwards)
