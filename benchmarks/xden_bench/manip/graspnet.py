"""Grasps of other detectors: the rows of GraspNet and AnyGrasp, and the frame that they are in.

A row is 17 numbers in metres: score, width, height, depth, rotation (9, row by row), translation
(3), object id. Its axes are x approach, y closing, z height, and its tips are at ``t + R [depth,
±width / 2, 0]`` (graspnetAPI, ``grasp.py``). AnyGrasp's are in the camera's frame: the matrix that
leads from there into the object's must come with them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
import trimesh
from jaxtyping import Float

from xden1k.errors import DataError
from xden1k.export.si import M_PER_CM
from xden_bench.manip.grasps import Grasps

__all__ = ["CAMERA", "ROWS", "graspnet_rows", "read_graspnet"]

ROWS: Final = "rows"
CAMERA: Final = "object_from_camera"
COLUMNS: Final = 17
SAME: Final = 1e-4
"""By how much a rotation may miss being one: detectors store single precision."""
HEIGHT_M: Final = 0.02
"""Of the fingers: what a row says of grasps that have none of their own."""

Rows = Float[np.ndarray, "n 17"]
Matrix = Float[np.ndarray, "4 4"]


def graspnet_rows(grasps: Grasps, object_from_camera: Matrix, depth_cm: float) -> Rows:
    """Write grasps of an object's frame as rows in a camera's.

    Parameters
    ----------
    grasps
        In the object's frame.
    object_from_camera
        In metres.
    depth_cm
        From the origin of a row's frame to the tips.
    """
    turn, shift_m = object_from_camera[:3, :3], object_from_camera[:3, 3]
    x, y, z = np.moveaxis(turn.T @ grasps.rotation, -1, 0)
    origins_m = (M_PER_CM * (grasps.centre_cm - depth_cm * grasps.approach) - shift_m) @ turn
    count = len(grasps)
    return np.column_stack(
        [
            grasps.score,
            M_PER_CM * grasps.width_cm,
            np.full(count, HEIGHT_M),
            np.full(count, M_PER_CM * depth_cm),
            np.stack([z, y, -x], axis=-1).reshape(count, 9),
            origins_m,
            np.zeros(count),
        ]
    )


def read_graspnet(path: Path, surface: trimesh.Trimesh) -> Grasps:
    """Read the grasps of one object.

    Parameters
    ----------
    path
        An ``.npz`` with ``rows`` (n, 17) and ``object_from_camera`` (4, 4), both in metres.
    surface
        Of the object, in its frame, cm: something must be between the tips.

    Returns
    -------
    Grasps
        In the object's frame.

    Raises
    ------
    DataError
        If there is no camera matrix, a row is not 17 finite numbers, a rotation is none, or every
        grasp misses the object, as when millimetres are taken for metres.
    """
    rows, camera = _arrays(path)
    _check_rows(path, rows)
    turns = rows[:, 4:13].reshape(-1, 3, 3)
    _check_rotations(f"{path}: {CAMERA}", camera[None, :3, :3])
    _check_rotations(f"{path}: {ROWS}", turns)
    x, y, z = np.moveaxis(camera[:3, :3] @ turns, -1, 0)
    tips_m = rows[:, 13:16] @ camera[:3, :3].T + camera[:3, 3] + rows[:, 3:4] * x
    found = Grasps(
        rows[:, 0], rows[:, 1] / M_PER_CM, np.stack([-z, y, x], axis=-1), tips_m / M_PER_CM
    )
    _check_hits(path, found, surface)
    return found


def _arrays(path: Path) -> tuple[Float[np.ndarray, "..."], Matrix]:
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in (ROWS, CAMERA) if name in file}
    except (ValueError, OSError, EOFError) as err:
        raise DataError(f"{path}: expected an .npz of grasps: {err}") from err
    for name, what in ((ROWS, "grasps"), (CAMERA, "camera matrix of 4 by 4")):
        if name not in arrays or not np.issubdtype(arrays[name].dtype, np.floating):
            raise DataError(f"{path}: expected {name!r}, the {what}, as floats; got {list(arrays)}")
    camera = arrays[CAMERA].astype(np.float64)
    if camera.shape != (4, 4) or not np.isfinite(camera).all():
        raise DataError(f"{path}: {CAMERA}: expected 4 by 4 finite numbers, got {camera.shape}")
    return arrays[ROWS].astype(np.float64), camera


def _check_rows(path: Path, rows: Float[np.ndarray, "..."]) -> None:
    if rows.ndim != 2 or rows.shape[1] != COLUMNS or not len(rows):
        raise DataError(f"{path}: {ROWS}: expected (n, {COLUMNS}), got {rows.shape}")
    if (bad := ~np.isfinite(rows).all(axis=1)).any():
        raise DataError(f"{path}: {ROWS}: row {bad.argmax()} is not finite")


def _check_rotations(where: str, turns: Float[np.ndarray, "n 3 3"]) -> None:
    products = turns @ np.swapaxes(turns, 1, 2) - np.eye(3)
    bad = (np.abs(products).max(axis=(1, 2)) > SAME) | (np.linalg.det(turns) < 0)
    if bad.any():
        first = int(bad.argmax())
        raise DataError(f"{where}: rotation {first} is none: {turns[first].round(4).tolist()}")


def _check_hits(path: Path, grasps: Grasps, surface: trimesh.Trimesh) -> None:
    """Refuse grasps of which none has its middle in the object's box."""
    low, high = surface.bounds
    inside = ((grasps.centre_cm >= low) & (grasps.centre_cm <= high)).all(axis=1)
    if not inside.any():
        first = grasps.centre_cm[0].round(3).tolist()
        raise DataError(
            f"{path}: no grasp meets the object, whose box is {low.round(1).tolist()} to "
            f"{high.round(1).tolist()} cm; row 0 is at {first} cm: millimetres for metres, or "
            "another frame?"
        )
