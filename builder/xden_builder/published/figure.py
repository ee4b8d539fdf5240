"""The figure of the manual: imported objects beside the files that they come from.

``python -m xden_builder.published.figure RELEASE IMPORTED FIGURE.png ID...`` draws it.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any, Final

import numpy as np
import trimesh
from jaxtyping import Float, Float64
from PIL import Image
from PIL.Image import Dither
from scipy import ndimage

from xden1k.errors import require
from xden1k.folder import open_folder
from xden1k.values.types import DensityObject
from xden_builder.phantoms.sheet import shaded
from xden_builder.published.given import PublishedObject
from xden_builder.published.reading import (
    FolderSource,
    Roles,
    chosen_folders,
    open_release,
    read_item,
    unit_of,
)
from xden_builder.published.register import UPRIGHT

__all__ = ["distances_voxels", "draw_imported"]

GROUPS: Final = 3
"""Objects in a row, each two panels wide and two high."""
AZIMUTH: Final = 35.0
ELEVATION: Final = 25.0
"""Of the camera, degrees."""
STEPS_VOXELS: Final = (0.25, 0.5, 1.0, 2.0)
"""Distances at which the colour changes."""
STEP_COLORS: Final = ("#f2f2ee", "#fde3a7", "#f8b05c", "#e5603b", "#8e1b3c")
PART_COLORS: Final = (
    *("#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee"),
    *("#aa3377", "#bbbbbb", "#ee8866", "#99ddff", "#44bb99"),
)
MESH_COLOR: Final = "#c9c9c4"
SLICE_PX: Final = 300
ROOM: Final = 1.06
"""Side of a picture over that of the object."""
PANELS: Final = ("mesh", "slice of the volume", "distance", "imported parts")
DOTS_PER_INCH: Final = 100
INDEXED_COLORS: Final = 256
"""Of the picture, so that it stays small."""

Picture = Float[np.ndarray, "rows columns 3"]


def draw_imported(release: Path, imported: Path, ids: Sequence[str], out_png: Path) -> None:
    """Draw of each object its mesh, a slice of its volume, how far they are apart, and its parts.

    Parameters
    ----------
    release
        Folder of the release.
    imported
        What ``xden import`` made of it.
    ids
        Of objects in it.
    out_png
        The picture to write.

    Raises
    ------
    MissingExtraError
        If matplotlib (extra ``view``) is not installed.
    """
    figures = require("matplotlib.figure", "view")
    folder = open_folder(imported)
    rows = -(-len(ids) // GROUPS)
    figure = figures.Figure(figsize=(13.0, 4.75 * rows), layout="constrained")
    axes = figure.subplots(2 * rows, 2 * GROUPS, squeeze=False)
    for axis in axes.flat:
        axis.axis("off")
    for place, object_id in enumerate(ids):
        row, column = 2 * (place // GROUPS), 2 * (place % GROUPS)
        obj = folder.object(object_id)
        four = axes[row : row + 2, column : column + 2].ravel()
        _draw(four, _published(release, obj), obj, named=place == 0)
    figure.legend(handles=_legend(), loc="outside lower center", ncols=5, frameon=False)
    drawn = BytesIO()
    figure.savefig(drawn, dpi=DOTS_PER_INCH)
    picture = Image.open(drawn).convert("RGB").quantize(INDEXED_COLORS, dither=Dither.NONE)
    picture.save(out_png, optimize=True)


def _published(release: Path, obj: DensityObject) -> PublishedObject:
    opened = open_release(FolderSource(release), Roles())
    folders = chosen_folders(opened, obj.meta["published"]["id"])
    (item,) = opened.items(folders, release, unit_of(opened))
    return read_item(item)


def _draw(axes: Any, given: PublishedObject, obj: DensityObject, *, named: bool) -> None:
    """Fill four panels."""
    scale = obj.meta["registration"]["cm_per_unit"]
    vertices = scale * np.asarray(given.mesh.vertices) @ UPRIGHT.T
    mesh = trimesh.Trimesh(vertices, given.mesh.faces, process=False)
    parts = [part.mesh for part in obj.parts]
    shades = [PART_COLORS[place % len(PART_COLORS)] for place in range(len(parts))]
    axes[0].imshow(shaded([mesh], [_rgb(MESH_COLOR)], AZIMUTH, ELEVATION))
    _draw_slice(axes[1], given, obj, mesh)
    axes[2].imshow(_distances(mesh, parts, _voxel_cm(obj)))
    axes[3].imshow(shaded(parts, [_rgb(color) for color in shades], AZIMUTH, ELEVATION))
    axes[0].set_title(f"{obj.object_id}, {obj.category.replace('_', ' ')}", fontsize=10, loc="left")
    for axis, text in zip(axes, PANELS if named else (), strict=False):
        axis.text(0.5, 0, text, transform=axis.transAxes, ha="center", va="top", fontsize=9)


def _rgb(color: str) -> tuple[float, float, float]:
    red, green, blue = require("matplotlib.colors", "view").to_rgb(color)
    return red, green, blue


def _affine(obj: DensityObject) -> Float64[np.ndarray, "4 4"]:
    return np.array(obj.meta["registration"]["volume_to_object_cm"])


def _voxel_cm(obj: DensityObject) -> float:
    """Mean side of a voxel of the published volume."""
    return float(np.abs(np.linalg.det(_affine(obj)[:3, :3])) ** (1 / 3))


def _draw_slice(
    axis: Any, given: PublishedObject, obj: DensityObject, mesh: trimesh.Trimesh
) -> None:
    """Draw attenuation in the plane across the object's shortest side, and the mesh's cut there."""
    across = int(np.argmin(mesh.extents))
    right, up = (each for each in range(3) if each != across)
    middle, half = mesh.bounds.mean(axis=0), ROOM * mesh.extents.max() / 2
    at = np.linspace(-half, half, SLICE_PX)
    points = np.tile(middle, (SLICE_PX, SLICE_PX, 1))
    points[..., right] += at
    points[..., up] += at[:, None]
    inverse = np.linalg.inv(_affine(obj))
    voxels = points @ inverse[:3, :3].T + inverse[:3, 3] - 0.5
    seen = ndimage.map_coordinates(given.lac_per_cm, np.moveaxis(voxels, 2, 0), order=0)
    shown = np.sqrt(seen / max(float(given.lac_per_cm.max()), 1e-9))
    span = (-half, half, -half, half)
    axis.imshow(shown, cmap="gray_r", vmin=0, vmax=1, origin="lower", extent=span)
    cut = trimesh.intersections.mesh_plane(mesh, np.eye(3)[across], middle) - middle  # type: ignore[no-untyped-call]
    for start, end in cut[..., [right, up]]:
        axis.plot(*zip(start, end, strict=True), color="#d1495b", linewidth=0.7)


def _distances(mesh: trimesh.Trimesh, parts: Sequence[trimesh.Trimesh], voxel_cm: float) -> Picture:
    """Picture of the published mesh, coloured by how far its faces are from the imported parts."""
    step = np.searchsorted(STEPS_VOXELS, distances_voxels(mesh, parts, voxel_cm))
    met = np.unique(step)
    pieces = [
        trimesh.Trimesh(mesh.vertices, mesh.faces[step == each], process=False) for each in met
    ]
    return shaded(pieces, [_rgb(STEP_COLORS[each]) for each in met], AZIMUTH, ELEVATION)


def distances_voxels(
    mesh: trimesh.Trimesh, parts: Sequence[trimesh.Trimesh], voxel_cm: float
) -> Float64[np.ndarray, "faces"]:
    """Distance of the middle of each face of a mesh from the nearest surface of the parts.

    Parameters
    ----------
    mesh, parts
        In one frame, cm.
    voxel_cm
        Side of a voxel.

    Raises
    ------
    MissingExtraError
        If libigl (extra ``import``) is not installed.
    """
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = [part.faces + start for part, start in zip(parts, starts, strict=False)]
    squared, *_ = require("igl", "import").point_mesh_squared_distance(
        mesh.triangles_center,
        np.concatenate([part.vertices for part in parts]),
        np.concatenate(faces),
    )
    return np.sqrt(np.asarray(squared, dtype=np.float64)) / voxel_cm


def _legend() -> list[Any]:
    patches = require("matplotlib.patches", "view")
    named = [f"up to {step:g}" for step in STEPS_VOXELS]
    labels = [*named[:-1], f"{named[-1]} voxels apart", "farther"]
    return [
        patches.Patch(facecolor=color, edgecolor="#999999", label=label)
        for color, label in zip(STEP_COLORS, labels, strict=True)
    ]


if __name__ == "__main__":
    release, imported, figure, *ids = sys.argv[1:]
    draw_imported(Path(release), Path(imported), ids, Path(figure))
