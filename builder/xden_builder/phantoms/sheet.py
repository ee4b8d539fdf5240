"""A sheet of phantoms to look at: shaded, cut open, and both radiographs of each."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float

from xden1k.errors import require
from xden1k.values.arrays import Image, Vec3
from xden1k.values.views import XRayView
from xden_builder.phantoms.catalogue import CATALOGUE
from xden_builder.phantoms.phantom import Phantom, make_phantom, plan_objects
from xden_builder.phantoms.scanner import VIEWS, Scanner
from xden_builder.phantoms.shapes import from_mesh, to_mesh

__all__ = ["cut_open", "gallery", "shaded"]

Picture = Float[np.ndarray, "rows columns 3"]
Colors = Sequence[tuple[float, float, float]]
_LIGHT = np.array([-0.42, 0.6, -0.68]) / np.linalg.norm([-0.42, 0.6, -0.68])
"""Towards the light, in the camera's frame: right, up, away."""
_PANES = frozenset({"glass", "window"})
"""Roles that are drawn in the section only, since they would hide what lies behind them."""


def gallery(out_png: Path, seed: int = 0, categories: Sequence[str] = ()) -> None:
    """Draw the first object of each category: shaded, cut open, PA, LAT.

    Parameters
    ----------
    out_png
        The picture to write.
    seed
        Of the objects.
    categories
        Only these; all if empty.

    Raises
    ------
    MissingExtraError
        If matplotlib is not installed.
    """
    figures = require("matplotlib.figure", "view")
    plans = plan_objects(len(categories) or len(CATALOGUE), seed, categories)
    rows = -(-len(plans) // 2)
    figure = figures.Figure(figsize=(18.0, 2.3 * rows), layout="constrained")
    axes = figure.subplots(rows, 8, squeeze=False)
    for axis in axes.flat:
        axis.axis("off")
    for place, plan in enumerate(plans):
        phantom = make_phantom(plan)
        row = axes[place // 2, 4 * (place % 2) :][:4]
        row[0].set_title(f"{plan.object_id}, {phantom.mass_properties.mass_g:,.0f} g", fontsize=9)
        for axis, picture in zip(row, _pictures(phantom), strict=False):
            axis.imshow(picture, cmap="gray", vmin=0.0, vmax=1.0)
    figure.savefig(out_png, dpi=100)


def _pictures(phantom: Phantom) -> list[Picture | Image]:
    meshes = [part.mesh for part in phantom.parts]
    colors = [part.color_rgb for part in phantom.parts]
    azimuth, flat = _looks(meshes)
    azimuth, outside = _livelier_side(phantom, azimuth)
    normal = _horizontal(azimuth) if not flat else np.array([0.0, 0.0, 1.0])
    opened = [(mesh, color) for mesh, color in zip(cut_open(meshes, normal), colors, strict=True)]
    opened = [(mesh, color) for mesh, color in opened if len(mesh.faces)]
    _, scanner = Scanner(size_px=512).setting_for(phantom)
    views = [scanner.corrected(phantom, view) for view in VIEWS]
    return [
        outside,
        shaded([m for m, _ in opened], [c for _, c in opened], azimuth, 55.0 if flat else 18.0),
        *(_cropped(view, meshes) for view in views),
    ]


def _livelier_side(phantom: Phantom, azimuth: float) -> tuple[float, Picture]:
    """Choose between front and back: the side with more edges; panes are seen through."""
    seen = [part for part in phantom.parts if part.role not in _PANES]
    meshes, colors = [part.mesh for part in seen], [part.color_rgb for part in seen]
    sides = [(at, shaded(meshes, colors, at + 25.0, 28.0)) for at in (azimuth, azimuth + 180.0)]
    return max(sides, key=lambda side: _edges(side[1]))


def _edges(picture: Picture) -> float:
    """Sum of the steps between neighbouring pixels, but for those to the white around."""
    grey = np.where((picture == 1.0).all(axis=2), np.nan, picture.mean(axis=2))
    return float(sum(np.nansum(np.abs(np.diff(grey, axis=axis)) > 0.05) for axis in (0, 1)))


def _looks(meshes: Sequence[trimesh.Trimesh]) -> tuple[float, bool]:
    """From which azimuth (degrees) an object shows its breadth, and whether it is flat."""
    points = np.concatenate([mesh.triangles_center for mesh in meshes])
    across = points[:, :2] - points[:, :2].mean(axis=0)
    long = np.linalg.eigh(across.T @ across)[1][:, 1]
    size = np.ptp(points, axis=0)
    return float(np.degrees(np.arctan2(long[1], long[0]))) - 90.0, bool(size[2] < 0.25 * size.max())


def _horizontal(azimuth: float) -> Vec3:
    angle = np.radians(azimuth)
    return np.array([np.cos(angle), np.sin(angle), 0.0])


def cut_open(meshes: Sequence[trimesh.Trimesh], normal: Vec3) -> list[trimesh.Trimesh]:
    """Take away what lies on the normal's side of the middle; the cut faces are closed."""
    corners = np.concatenate([mesh.bounds for mesh in meshes])
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    plane = (-float(normal[0]), -float(normal[1]), -float(normal[2]))
    halves = [
        from_mesh(mesh).trim_by_plane(plane, -float(normal @ middle) - 1e-4) for mesh in meshes
    ]
    return [to_mesh(half) for half in halves]


def shaded(
    meshes: Sequence[trimesh.Trimesh],
    colors: Colors,
    azimuth: float,
    elevation: float,
    size_px: int = 300,
) -> Picture:
    """Picture of meshes under one light, in parallel projection, on white.

    Surfaces are drawn as dense points with a depth buffer, at twice the size, then averaged.

    Parameters
    ----------
    meshes, colors
        One colour for each mesh.
    azimuth, elevation
        Where the camera is, degrees.
    size_px
        Rows and columns.
    """
    camera, fine = _camera(azimuth, elevation), 2 * size_px
    corners = np.concatenate([mesh.vertices for mesh in meshes]) @ camera.T
    low, high = corners.min(axis=0), corners.max(axis=0)
    pixel_cm = 1.06 * max(high[0] - low[0], high[1] - low[1]) / fine
    clouds = [
        _points(mesh, color, camera, pixel_cm) for mesh, color in zip(meshes, colors, strict=True)
    ]
    points, lit = (np.concatenate(part) for part in zip(*clouds, strict=True))
    at = (points - (low + high) / 2) / pixel_cm + fine / 2
    pixel = (fine - 1 - at[:, 1].astype(int)) * fine + at[:, 0].astype(int)
    far_first = np.argsort(-points[:, 2])
    picture = np.ones((fine * fine, 3))
    picture[pixel[far_first]] = lit[far_first]
    return np.asarray(picture.reshape(size_px, 2, size_px, 2, 3).mean(axis=(1, 3)))


def _camera(azimuth: float, elevation: float) -> Float[np.ndarray, "3 3"]:
    """Rows: right, up, away."""
    toward = np.cos(np.radians(elevation)) * _horizontal(azimuth)
    toward[2] = np.sin(np.radians(elevation))
    right = np.cross([0.0, 0.0, 1.0], toward)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(toward, right), -toward])


def _points(
    mesh: trimesh.Trimesh,
    color: tuple[float, float, float],
    camera: Float[np.ndarray, "3 3"],
    pixel_cm: float,
) -> tuple[Float[np.ndarray, "points 3"], Float[np.ndarray, "points 3"]]:
    """Points that cover the faces turned to the camera, and their lit colours."""
    toward = mesh.face_normals @ -camera[2]
    seen = np.flatnonzero(toward > 0)
    count = np.ceil(4 * mesh.area_faces[seen] * toward[seen] / pixel_cm**2).astype(int)
    face = np.repeat(seen, count)
    # the R2 sequence (Roberts, 2018) covers a face more evenly than random numbers
    u, v = np.outer([0.7548776662, 0.5698402910], np.arange(len(face))) % 1.0
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    weights = np.stack([1 - u - v, u, v], axis=1)[:, None]
    points = (weights @ mesh.triangles[face])[:, 0] @ camera.T
    normals = (weights @ _smooth_normals(mesh)[face])[:, 0] @ camera.T
    light = 0.4 + 0.6 * (normals @ _LIGHT).clip(0.0, 1.0)
    return points, light[:, None] * np.array(color)


def _smooth_normals(mesh: trimesh.Trimesh) -> Float[np.ndarray, "faces 3 3"]:
    """Give each corner of a face the normal of its vertex, at a sharp edge that of the face."""
    faces, corners = mesh.face_normals[:, None], mesh.vertex_normals[mesh.faces]
    smooth = (faces * corners).sum(axis=2, keepdims=True) > 0.93
    return np.where(smooth, corners, faces)


def _cropped(view: XRayView, meshes: Sequence[trimesh.Trimesh]) -> Image:
    """Square around the object, bright where thin, gamma 1/2."""
    corners = np.concatenate([mesh.vertices for mesh in meshes])
    columns, rows, _ = view.geometry.project(corners).T
    half = round(0.55 * max(np.ptp(rows), np.ptp(columns))) + 2
    middle = (int(np.ptp(at) / 2 + at.min()) for at in (rows, columns))
    window = tuple(slice(max(at - half, 0), at + half) for at in middle)
    return np.asarray(np.sqrt(np.nan_to_num(view.transmission[window]).clip(0.0, 1.0)))
