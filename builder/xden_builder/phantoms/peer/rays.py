"""Path lengths by gVirtualXray (Vidal et al. 2009, doi:10.2312/EG3DTA.20091008), headless."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Float32

from xden1k.errors import DataError, require
from xden1k.values.views import ViewGeometry
from xden_builder.phantoms.peer.matter import EXTRA

__all__ = ["cropped", "gvxr", "path_lengths_cm", "shadow"]


@cache
def gvxr() -> Any:
    """Import gVirtualXray and open its context, which serves the whole process.

    Raises
    ------
    MissingExtraError
        If it, or a library of the system that it needs, is not installed.
    """
    library = require("gvxrPython3", EXTRA).gvxr
    library.useLogFile(os.devnull)
    with _silent():
        library.createOpenGLContext()
    return library


@contextmanager
def _silent() -> Iterator[None]:
    """Keep what C libraries print, such as that there is no display, from the terminal."""
    kept, sink = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(sink, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(sink)


def path_lengths_cm(
    meshes: Sequence[trimesh.Trimesh], geometry: ViewGeometry
) -> Float32[np.ndarray, "parts rows columns"]:
    """Length of the ray to each pixel's centre inside each mesh.

    Only the pixels around the meshes' shadow are rendered.

    Parameters
    ----------
    meshes
        Closed, in cm, sharing no space.
    geometry
        A cone beam; pixels are square, rows and columns perpendicular.

    Raises
    ------
    DataError
        If the beam is not a cone, or a mesh reaches beyond the panel.
    """
    if geometry.source_cm is None:
        raise DataError("gVirtualXray is set up for cone beams here, got a parallel one")
    library = gvxr()
    rows, columns = shadow(meshes, geometry)
    _place(library, cropped(geometry, rows, columns))
    lengths = np.zeros((len(meshes), *geometry.shape), dtype=np.float32)
    for place, mesh in enumerate(meshes):
        lengths[place, rows, columns] = _lengths(library, mesh)
    return lengths


def shadow(
    meshes: Sequence[trimesh.Trimesh], geometry: ViewGeometry, margin: int = 0
) -> tuple[slice, slice]:
    """Rows and columns of the rectangle that holds every mesh's shadow, and so many pixels more.

    Raises
    ------
    DataError
        If a mesh reaches beyond the panel.
    """
    at = geometry.project(np.concatenate([mesh.vertices for mesh in meshes]))
    low, high = np.floor(at.min(axis=0)).astype(int), np.ceil(at.max(axis=0)).astype(int) + 1
    sides = [(low[1], high[1], geometry.shape[0]), (low[0], high[0], geometry.shape[1])]
    if any(first < 0 or last > count for first, last, count in sides):
        raise DataError("the object reaches beyond the panel")
    rows, columns = (
        slice(int(max(first - margin, 0)), int(min(last + margin, count)))
        for first, last, count in sides
    )
    return rows, columns


def cropped(geometry: ViewGeometry, rows: slice, columns: slice) -> ViewGeometry:
    """Keep a part of a panel."""
    corner = rows.start * geometry.row_step_cm + columns.start * geometry.column_step_cm
    shape = (rows.stop - rows.start, columns.stop - columns.start)
    return replace(geometry, pixel00_cm=geometry.pixel00_cm + corner, shape=shape)


def _place(library: Any, geometry: ViewGeometry) -> None:
    rows, columns = geometry.shape
    right, down = geometry.column_step_cm, geometry.row_step_cm
    middle = geometry.pixel00_cm + (columns - 1) / 2 * right + (rows - 1) / 2 * down
    pitch = float(np.linalg.norm(right))
    assert geometry.source_cm is not None
    library.setSourcePosition(*geometry.source_cm.tolist(), "cm")
    library.setDetectorPosition(*middle.tolist(), "cm")
    # its rows run along the up vector, its columns to the left of a viewer for whom rows run down
    library.setDetectorUpVector(*(down / pitch).tolist())
    library.setDetectorRightVector(*(-right / pitch).tolist())
    library.setDetectorNumberOfPixels(columns, rows)
    library.setDetectorPixelSize(pitch, pitch, "cm")
    library.usePointSource()
    library.setMonoChromaticPerPixelAtSDD(60.0, "keV", 1)  # lengths do not depend on it
    library.disableArtefactFiltering()  # for open meshes: ours are closed


def _lengths(library: Any, mesh: trimesh.Trimesh) -> Float32[np.ndarray, "rows columns"]:
    corners = np.asarray(mesh.vertices, dtype=np.float32).ravel().tolist()
    library.removePolygonMeshesFromSceneGraph()
    library.makeTriangularMesh("part", corners, mesh.faces.ravel().tolist(), "cm")
    library.addPolygonMeshAsInnerSurface("part")
    lengths = np.asarray(library.computeLBuffer("part"), dtype=np.float32)
    return np.asarray(np.fliplr(lengths).clip(min=0.0))
