"""Scene folders as NeRF2Physics lays them out: real pictures come in here.

::

    SCENE/  images/NAME.png                    RGBA, alpha > 0 on the object
            masks/NAME.png                     255 on the object, for others; not read here
            transforms.json                    fl_x, fl_y, cx, cy, w, h; frames[] with file_path,
                                               mask_path and transform_matrix, camera to object
                                               frame, metres
            points3d.ply                       points that pictures show, metres; not read here
            ns/renders/depth/NAME.npy.gz       (rows, columns, 1): distance along the ray, metres
            ns/point_cloud.ply                 the points as nerfstudio would scale them, by
            ns/dataparser_transforms.json      transform and scale; neither is read here

Without ``ns/renders/depth`` distances come from the object's outer surface. Pictures and depths go
by the names in ``frames``, not by their order. Where all cameras have the same intrinsics they are
written once, as in ABO-500: NeRF2Physics and PUGS look for them there.
"""

from __future__ import annotations

import gzip
import io
import json
import zipfile
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Float32, UInt8
from PIL import Image, UnidentifiedImageError

from xden1k.errors import DataError
from xden_baselines.views.cameras import Camera
from xden_baselines.views.pictures import BACKGROUND, Pictures
from xden_baselines.views.rendering import Surface

__all__ = ["read_scene", "write_scene"]

CM_PER_M = 100.0
_INTRINSICS = ("fl_x", "fl_y", "cx", "cy")
_DISTORTION = ("k1", "k2", "k3", "k4", "p1", "p2")
_MODELS = ("OPENCV", "PERSPECTIVE", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")
"""Of lenses: those that do not distort where their coefficients are 0."""
_POINTS = 100_000
"""Written of each scene at most, as many as NeRF2Physics takes from its NeRF."""
_MOST_OFF = 0.1
"""By which share distances may differ from those of the outer surface, in the median."""
_LEAST_SHARED = 0.5
"""Of the pixels in the mask or on the outer surface, those in both, in the median view."""


def write_scene(pictures: Pictures, scene: Path) -> None:
    """Write pictures, cameras, distances and the points that they show as a scene folder.

    The point cloud is scaled as nerfstudio scales a scene: the farthest coordinate of a camera is
    1. NeRF2Physics' and PUGS' steps of 1 % are of that unit.
    """
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
    lenses = [_lens(camera) for camera in pictures.cameras]
    common = lenses[0] if all(lens == lenses[0] for lens in lenses) else {}
    if not common:
        frames = [{**frame, **lens} for frame, lens in zip(frames, lenses, strict=True)]
    _write_json(scene / "transforms.json", {"camera_model": "OPENCV", **common, "frames": frames})
    farthest_cm = max(np.abs(camera.position_cm).max() for camera in pictures.cameras)
    scale = float(CM_PER_M / farthest_cm)
    parser = {"transform": np.eye(4)[:3].tolist(), "scale": scale}
    _write_json(scene / "ns" / "dataparser_transforms.json", parser)
    points_m, colors = _seen_points(pictures)
    _write_cloud(scene / "points3d.ply", points_m, colors)
    _write_cloud(scene / "ns" / "point_cloud.ply", points_m * scale, colors)


def read_scene(scene: Path, surface: Surface | None = None) -> Pictures:
    """Read a scene folder.

    Parameters
    ----------
    scene
        The folder; its cameras are in the object frame.
    surface
        The object's outer surface: for the distances of a folder that has none, and to check those
        of one that has.

    Raises
    ------
    DataError
        If a file is missing or cannot be read, pictures differ in size, or are of another than
        their cameras say, a lens is distorted, distances are a tenth off those of the surface, or
        the masks are elsewhere than it is.
    """
    transforms = _read_json(scene / "transforms.json")
    depths = scene / "ns" / "renders" / "depth"
    colors, masks, distances, cameras, shared = [], [], [], [], []
    for frame in _frames(transforms, scene):
        name = Path(frame["file_path"])
        rgba = _read_picture(scene / "images" / f"{name.stem}{name.suffix or '.png'}")
        camera, mask = _camera({**transforms, **frame}, rgba.shape[:2], scene), rgba[..., 3] > 0
        first_cm = None
        if surface is not None:
            first_cm = surface.first_hits(camera.position_cm, camera.rays())[1]
            shared.append(_shared(mask, np.isfinite(first_cm)))
        if depths.is_dir():
            path = depths / f"{name.stem}.npy.gz"
            distance = (_read_depth(path, mask) * CM_PER_M).astype(np.float32)
            if first_cm is not None:
                _check_distances(path, distance, first_cm, mask)
        elif first_cm is not None:
            distance, mask = first_cm, mask & np.isfinite(first_cm)
        else:
            raise DataError(f"{scene}: no ns/renders/depth and so no distances")
        colors.append(np.where(mask[..., None], rgba[..., :3], np.uint8(BACKGROUND)))
        masks.append(mask)
        distances.append(np.where(mask, distance, np.float32(np.inf)))
        cameras.append(camera)
    if len({mask.shape for mask in masks}) > 1:
        raise DataError(f"{scene}: all pictures must have one size")
    if not any(mask.any() for mask in masks):
        raise DataError(f"{scene}: no picture shows the object where it should be")
    _check_shared(shared, scene)
    try:
        return Pictures(np.stack(colors), np.stack(masks), np.stack(distances), tuple(cameras))
    except DataError as err:
        raise DataError(f"{scene}: {err}") from err


def _shared(
    mask: Bool[np.ndarray, "rows columns"], other: Bool[np.ndarray, "rows columns"]
) -> float:
    """Share of the pixels in either that are in both; 1 if there are none."""
    either = int((mask | other).sum())
    return int((mask & other).sum()) / either if either else 1.0


def _check_shared(shared: Sequence[float], scene: Path) -> None:
    """Refuse masks that are not where the outer surface is."""
    if shared and (share := float(np.median(shared))) < _LEAST_SHARED:
        raise DataError(
            f"{scene}: masks and the object's outer surface share {share:.0%} of their pixels in "
            f"the median view, expected at least {_LEAST_SHARED:.0%}: cameras are in another frame "
            "or scale, or alpha is no mask"
        )


def _frame(camera: Camera, name: str) -> dict[str, Any]:
    pose = camera.camera_to_world.copy()
    pose[:3, 3] /= CM_PER_M
    return {
        "file_path": f"images/{name}",
        "mask_path": f"masks/{name}",
        "transform_matrix": pose.tolist(),
    }


def _lens(camera: Camera) -> dict[str, float]:
    rows, columns = camera.shape
    intrinsics = zip(_INTRINSICS, (*camera.focal_px, *camera.centre_px), strict=True)
    return {**dict(intrinsics), "h": rows, "w": columns}


def _seen_points(
    pictures: Pictures,
) -> tuple[Float[np.ndarray, "points 3"], UInt8[np.ndarray, "points 3"]]:
    """Points that pixels show, metres, and their colours: evenly many of all pixels."""
    points_cm, colors = [], []
    for view, camera in enumerate(pictures.cameras):
        mask = pictures.masks[view]
        ways_cm = camera.rays()[mask] * pictures.distance_cm[view][mask, None]
        points_cm.append(camera.position_cm + ways_cm)
        colors.append(pictures.colors[view][mask])
    all_points, all_colors = np.concatenate(points_cm), np.concatenate(colors)
    some = np.linspace(0, len(all_points) - 1, min(_POINTS, len(all_points))).astype(int)
    return all_points[some] / CM_PER_M, all_colors[some]


def _frames(transforms: Mapping[str, Any], scene: Path) -> list[Mapping[str, Any]]:
    frames = transforms.get("frames")
    if not (
        isinstance(frames, list)
        and frames
        and all(isinstance(frame, dict) for frame in frames)
        and all(isinstance(frame.get("file_path"), str) for frame in frames)
    ):
        raise DataError(f"{scene}/transforms.json: frames must be a list, each with a file_path")
    names = [Path(frame["file_path"]).stem for frame in frames]
    if twice := [name for name, count in Counter(names).items() if count > 1]:
        raise DataError(f"{scene}/transforms.json: each picture once, got {twice[0]!r} twice")
    return frames


def _camera(frame: Mapping[str, Any], shape: tuple[int, int], scene: Path) -> Camera:
    where = f"{scene}/transforms.json: {frame['file_path']}"
    if bent := [name for name in _DISTORTION if frame.get(name)]:
        raise DataError(f"{where}: a lens without distortion is expected, got {bent}")
    if (model := frame.get("camera_model", _MODELS[0])) not in _MODELS:
        raise DataError(f"{where}: camera_model must be one of {_MODELS}, got {model!r}")
    said = tuple(frame.get(key, edge) for key, edge in zip("hw", shape, strict=True))
    if said != shape:
        raise DataError(f"{where}: h and w are {said}, the picture's rows and columns {shape}")
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


def _write_cloud(
    path: Path, points: Float[np.ndarray, "points 3"], colors: UInt8[np.ndarray, "points 3"]
) -> None:
    cloud = trimesh.PointCloud(points, colors)  # type: ignore[no-untyped-call]
    cloud.export(path)  # type: ignore[no-untyped-call]


def _check_distances(
    path: Path,
    distance_cm: Float32[np.ndarray, "rows columns"],
    first_cm: Float32[np.ndarray, "rows columns"],
    mask: Bool[np.ndarray, "rows columns"],
) -> None:
    """Refuse distances in another unit: those before nerfstudio divided them by its scale, say."""
    known = mask & np.isfinite(first_cm)
    if known.any():
        ratio = float(np.median(distance_cm[known] / first_cm[known]))
        if abs(ratio - 1) > _MOST_OFF:
            raise DataError(
                f"{path}: expected metres along the ray; distances are {ratio:.3g} times those of "
                "the object's outer surface"
            )


def _read_picture(path: Path) -> UInt8[np.ndarray, "rows columns 4"]:
    try:
        with Image.open(path) as image:
            if image.mode != "RGBA":
                raise DataError(f"{path}: expected RGBA, got {image.mode}")
            return np.array(image)
    except (OSError, UnidentifiedImageError, Image.DecompressionBombError) as err:
        raise DataError(f"{path}: {err}") from err


def _read_depth(
    path: Path, mask: Bool[np.ndarray, "rows columns"]
) -> Float32[np.ndarray, "rows columns"]:
    try:
        found = np.load(io.BytesIO(gzip.decompress(path.read_bytes())), allow_pickle=False)
    except (OSError, EOFError, ValueError, zlib.error, zipfile.BadZipFile) as err:
        raise DataError(f"{path}: {err}") from err
    if not isinstance(found, np.ndarray) or found.dtype.kind != "f":
        raise DataError(f"{path}: expected an .npy array of floats")
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
    except (OSError, ValueError, RecursionError) as err:
        raise DataError(f"{path}: {err}") from err
    if not isinstance(found, dict):
        raise DataError(f"{path}: expected a JSON object, got {type(found).__name__}")
    return found


def _write_json(path: Path, value: Mapping[str, Any]) -> None:
    path.write_text(json.dumps(value, indent=1) + "\n", encoding="utf-8")
