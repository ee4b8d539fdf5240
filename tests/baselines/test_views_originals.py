"""Exported scenes by the steps of the programs that they are for, re-implemented from their code.

NeRF2Physics at 175e60e (utils.py, feature_fusion.py, arguments.py) and PUGS at edd2c10
(scene/__init__.py, scene/dataset_readers.py, utils/enhance_utils.py), with their default flags.
"""

from __future__ import annotations

import gzip
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from jaxtyping import Float
from PIL import Image

from tests.baselines.painted import GREY, RED, painted
from tests.phantoms import BAR
from xden1k.folder import open_folder, write_folder
from xden_baselines.views.cameras import Rig
from xden_baselines.views.exporting import export_scenes
from xden_baselines.views.source import RenderedPhantoms

OCCLUSION = VOXEL = 0.01
"""``--occ_thr`` and ``--feature_voxel_size``."""

Points = Float[np.ndarray, "n 3"]


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("originals")
    obj = painted("bar-0001", BAR, {"plastic": RED, "steel": GREY}, split="test")
    write_folder([obj], root / "dataset", version="0.1.0", builder="tests")
    source = RenderedPhantoms(Rig(per_ring=4, size_px=96))
    export_scenes(open_folder(root / "dataset"), "test", source, root / "runs")
    return root / "runs"


@pytest.fixture
def scene(runs: Path) -> Path:
    return runs / "scenes" / "bar-0001"


def transforms(scene: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((scene / "transforms.json").read_text())
    return found


def intrinsics(found: dict[str, Any]) -> Float[np.ndarray, "3 3"]:
    """``parse_transforms_json`` without ``--different_Ks``."""
    return np.array([[found["fl_x"], 0, found["cx"]], [0, found["fl_y"], found["cy"]], [0, 0, 1]])


def projected(
    points: Points, to_camera: Float[np.ndarray, "4 4"], matrix: Float[np.ndarray, "3 3"]
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n"]]:
    """``project_3d_to_2d``: columns and rows, and distances."""
    seen = points @ to_camera[:3, :3].T + to_camera[:3, 3]
    seen = seen * [1, -1, -1]
    at = seen @ matrix.T
    return at[:, :2] / at[:, 2:], np.linalg.norm(seen, axis=1)


def ns_point_cloud(scene: Path) -> tuple[Points, float]:
    """``load_ns_point_cloud``: thinned, then out of nerfstudio's frame; and the scale."""
    cloud = np.asarray(trimesh.load(scene / "ns" / "point_cloud.ply").vertices)
    cloud = cloud[np.unique(np.floor(cloud / VOXEL), axis=0, return_index=True)[1]]
    parser = json.loads((scene / "ns" / "dataparser_transforms.json").read_text())
    matrix = np.vstack([np.asarray(parser["transform"]), [0, 0, 0, 1 / parser["scale"]]])
    found = np.column_stack([cloud, np.ones(len(cloud))]) @ np.linalg.inv(matrix).T
    return found[:, :3] / found[:, 3:], parser["scale"]


def test_the_folder_of_scenes_holds_scenes_alone(runs: Path) -> None:
    assert sorted(path.name for path in (runs / "scenes").iterdir()) == ["bar-0001"]


def test_nerf2physics_sees_the_points_of_its_cloud_where_pictures_show_them(scene: Path) -> None:
    found, (points, scale) = transforms(scene), ns_point_cloud(scene)
    images, depths = (
        sorted(path.iterdir()) for path in (scene / "images", scene / "ns/renders/depth")
    )
    assert [path.stem for path in images] == [path.name.split(".")[0] for path in depths]
    seen_by = np.zeros(len(points), dtype=int)
    for frame, image, depth in zip(found["frames"], images, depths, strict=True):
        assert Path(frame["file_path"]).name == image.name  # frames go by their order there
        to_camera = np.linalg.inv(np.array(frame["transform_matrix"]))
        at, distance = projected(points, to_camera, intrinsics(found))
        column, row = np.round(at).astype(int).T
        shown = np.load(io.BytesIO(gzip.decompress(depth.read_bytes())))[:, :, 0]
        height, width = shown.shape
        within = (column >= 0) & (row >= 0) & (column < width) & (row < height)
        seen_by[within] += (
            distance[within] <= shown[row[within], column[within]] + OCCLUSION * scale
        )
    assert len(points) > 100
    assert (seen_by > 0).all()
    assert scale * np.abs(
        [np.array(one["transform_matrix"])[:3, 3] for one in found["frames"]]
    ).max() == pytest.approx(1)
    extent_m = points.max(axis=0) - points.min(axis=0)
    np.testing.assert_allclose(
        extent_m,
        np.ptp([box.high for box in BAR] + [box.low for box in BAR], axis=0) / 100,
        atol=2 * VOXEL / scale,
    )


def test_nerf2physics_masks_pictures_by_their_alpha(scene: Path) -> None:
    for path in sorted((scene / "images").iterdir()):
        image = np.array(Image.open(path))
        assert image.shape[2] == 4
        mask = np.array(Image.open(scene / "masks" / path.name)) > 0
        np.testing.assert_array_equal(image[:, :, 3] > 0, mask)


def test_pugs_takes_the_scene_for_one_of_abo_and_begins_with_its_points(scene: Path) -> None:
    assert not (scene / "sparse").exists()
    assert not (scene / "transforms_train.json").exists()
    found = transforms(scene)
    for name in ("w", "fl_x", "h", "fl_y"):  # its first guess, LERF, fails as it does on ABO-500
        assert name not in found["frames"][0]
        assert found[name] > 0
    for frame in found["frames"]:
        assert (scene / frame["file_path"]).is_file()
    cloud = trimesh.load(scene / "points3d.ply")
    assert set(cloud.metadata["_ply_raw"]["vertex"]["properties"]) >= {
        "x",
        "y",
        "z",
        "red",
        "green",
        "blue",
    }
    matrix = intrinsics(found)
    for frame in found["frames"]:  # every point lies in every mask or behind the object
        to_camera = np.linalg.inv(np.array(frame["transform_matrix"]))
        at, _ = projected(np.asarray(cloud.vertices), to_camera, matrix)
        column, row = at.astype(int).T
        mask = np.array(Image.open(scene / frame["mask_path"])) > 0
        assert mask[row, column].mean() > 0.9
