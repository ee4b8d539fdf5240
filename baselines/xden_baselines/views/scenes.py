"""Scene folders as NeRF2Physics lays them out: real pictures come in here.

::

    SCENE/  images/NAME.png                    RGBA, alpha > 0 on the object
            masks/NAME.png                     255 on the object, for others; not read here
            transforms.json                    fl_x, fl_y, cx, cy; frames[] with file_path,
                                               mask_path and transform_matrix, camera to object
                                               frame, metres
            ns/dataparser_transforms.json      scale, from metres to the unit of the depths
            ns/renders/depth/NAME.npy.gz       (rows, columns, 1): distance along the ray

The folders named ``ns`` may be missing: distances then come from the object's outer surface.
Pictures and depths go by the names in ``frames``, not by their order.
"""

from __future__ import annotations

import gzip
import io
import json
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32, UInt8
from PIL import Image, UnidentifiedImageError

from xden1k.errors import DataError
from xden_baselines.views.cameras import Camera
from xden_baselines.views.pictures import BACKGROUND, Pictures
from xden_baselines.views.rendering import Surface

__all__ = ["read_scene", "write_scene"]

CM_PER_M = 100.0
_INTRINSICS = ("fl_x", "fl_y", "cx", "cy")
_DISTORTION = ("k1", "k2", "k3", "k4", "p1", "p2")


def write_scene(pictures: Pictures, scene: Path) -> None:
    """Write pictures, cameras and distances as a scene folder, at a scale of 1."""
    depths = scene / "ns" / "renders" / "depth"
    for folder in (scene / "images", scene / "masks", depths):
        folder.mkdir(parents=True)
    frames = []
    for view, camera in enumerate(pictures.cameras):
        alpha = np.where(pictures.masks[view], 255, 0).astype(np.uint8)
        rgba = np.concatenate([pictures.colors[view], alpha[..., None]], axis=-1)
        Image.fromarray(rgba).save(scene / "images" / f"{view:03d}.png")
        Image.fromarray(alpha).save(scene / "masks" / f"{view:03d}.png")
        distance_m = np.where(pictures.masks[view], pictures.distance_cm[view] / CM_PER_M, 0)
        (depths / f"{view:03d}.npy.gz").write_bytes(_packed(distance_m[..., None]))
        frames.append(_frame(camera, f"{view:03d}.png"))
    _write_json(scene / "transforms.json", {"camera_model": "OPENCV", "frames": frames})
    parser = {"transform": np.eye(4)[:3].tolist(), "scale": 1.0}
    _write_json(scene / "ns" / "dataparser_transforms.json", parser)


def read_scene(scene: Path, surface: Surface | None = None) -> Pictures:
    """Read a scene folder.

    Parameters
    ----------
    scene
        The folder; its cameras are in the object frame.
    surface
        The object's outer surface, for the distances of a folder that has none.

    Raises
    ------
    DataError
        If a file is missing or cannot be read, pictures differ in size, a lens is distorted, or
        the distances come from a surface that a picture does not show where its mask is.
    """
    transforms = _read_json(scene / "transforms.json")
    scale = _depth_scale(scene)
    colors, masks, distances, cameras = [], [], [], []
    for frame in _frames(transforms, scene):
        name = Path(frame["file_path"])
        rgba = _read_picture(scene / "images" / f"{name.stem}{name.suffix or '.png'}")
        camera, mask = _camera({**transforms, **frame}, rgba.shape[:2], scene), rgba[..., 3] > 0
        if scale is not None:
            depth = _read_depth(scene / "ns" / "renders" / "depth" / f"{name.stem}.npy.gz", mask)
            distance = (depth * (CM_PER_M / scale)).astype(np.float32)
        elif surface is not None:
            distance = surface.first_hits(camera.position_cm, camera.rays())[1]
            mask = mask & np.isfinite(distance)
        else:
            raise DataError(f"{scene}: no ns/dataparser_transforms.json and so no distances")
        colors.append(np.where(mask[..., None], rgba[..., :3], np.uint8(BACKGROUND)))
        masks.append(mask)
        distances.append(np.where(mask, distance, np.float32(np.inf)))
        cameras.append(camera)
    if len({mask.shape for mask in masks}) > 1:
        raise DataError(f"{scene}: all pictures must have one size")
    if not any(mask.any() for mask in masks):
        raise DataError(f"{scene}: no picture shows the object where it should be")
    return Pictures(np.stack(colors), np.stack(masks), np.stack(distances), tuple(cameras))


def _frame(camera: Camera, name: str) -> dict[str, Any]:
    pose = camera.camera_to_world.copy()
    pose[:3, 3] /= CM_PER_M
    intrinsics = zip(_INTRINSICS, (*camera.focal_px, *camera.centre_px), strict=True)
    rows, columns = camera.shape
    return {
        "file_path": f"images/{name}",
        "mask_path": f"masks/{name}",
        "transform_matrix": pose.tolist(),
        **dict(intrinsics),
        "h": rows,
        "w": columns,
    }


def _frames(transforms: Mapping[str, Any], scene: Path) -> list[Mapping[str, Any]]:
    frames = transforms.get("frames")
    if not (
        isinstance(frames, list)
        and frames
        and all(isinstance(frame, dict) for frame in frames)
        and all(isinstance(frame.get("file_path"), str) for frame in frames)
    ):
        raise DataError(f"{scene}/transforms.json: frames must be a list, each with a file_path")
    return frames


def _camera(frame: Mapping[str, Any], shape: tuple[int, int], scene: Path) -> Camera:
    where = f"{scene}/transforms.json: {frame['file_path']}"
    if bent := [name for name in _DISTORTION if frame.get(name)]:
        raise DataError(f"{where}: a lens without distortion is expected, got {bent}")
    try:
        pose = np.array(frame["transform_matrix"], dtype=np.float64)
        fl_x, fl_y, cx, cy = (float(frame[name]) for name in _INTRINSICS)
    except KeyError as err:
        raise DataError(f"{where}: {err} is missing") from err
    except (TypeError, ValueError) as err:
        raise DataError(f"{where}: {err}") from err
    if pose.shape != (4, 4):
        raise DataError(f"{where}: transform_matrix must be 4 by 4, got {pose.shape}")
    pose[:3, 3] *= CM_PER_M
    try:
        return Camera(pose, focal_px=(fl_x, fl_y), centre_px=(cx, cy), shape=shape)
    except DataError as err:
        raise DataError(f"{where}: {err}") from err


def _depth_scale(scene: Path) -> float | None:
    """Return the units of depth in a metre; None if the folder has none."""
    path = scene / "ns" / "dataparser_transforms.json"
    if not path.exists():
        return None
    scale = _read_json(path).get("scale")
    if not isinstance(scale, int | float) or not 0 < scale < np.inf:
        raise DataError(f"{path}: scale must be a positive number, got {scale!r}")
    return float(scale)


def _read_picture(path: Path) -> UInt8[np.ndarray, "rows columns 4"]:
    try:
        with Image.open(path) as image:
            if image.mode != "RGBA":
                raise DataError(f"{path}: expected RGBA, got {image.mode}")
            return np.array(image)
    except (OSError, UnidentifiedImageError) as err:
        raise DataError(f"{path}: {err}") from err


def _read_depth(path: Path, mask: np.ndarray) -> Float32[np.ndarray, "rows columns"]:
    try:
        found = np.load(io.BytesIO(gzip.decompress(path.read_bytes())), allow_pickle=False)
    except (OSError, EOFError, ValueError, zlib.error) as err:
        raise DataError(f"{path}: {err}") from err
    if found.shape != (*mask.shape, 1):
        raise DataError(f"{path}: shape must be {(*mask.shape, 1)}, got {found.shape}")
    return np.asarray(found[..., 0], dtype=np.float32)


def _packed(depth: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, depth.astype(np.float32))
    return gzip.compress(file.getvalue(), compresslevel=1, mtime=0)


def _read_json(path: Path) -> dict[str, Any]:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as err:
        raise DataError(f"{path}: {err}") from err
    if not isinstance(found, dict):
        raise DataError(f"{path}: expected a JSON object, got {type(found).__name__}")
    return found


def _write_json(path: Path, value: Mapping[str, Any]) -> None:
    path.write_text(json.dumps(value, indent=1) + "\n", encoding="utf-8")
