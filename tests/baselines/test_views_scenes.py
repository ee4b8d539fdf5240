"""Scene folders: what is written is read again, and what breaks the layout is named."""

from __future__ import annotations

import gzip
import io
import json
import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from tests.baselines.painted import RED, camera_at, painted, sphere_pictures
from tests.phantoms import CUBE
from xden1k.errors import DataError
from xden1k.folder import open_folder, write_folder
from xden_baselines.views.pictures import Pictures
from xden_baselines.views.rendering import Surface
from xden_baselines.views.scenes import read_scene, write_scene
from xden_baselines.views.source import RenderedPhantoms, SceneFolders

CAMERAS = [camera_at((0, -5, 0)), camera_at((4, 3, -1), (0.2, 0, 0))]


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    write_scene(sphere_pictures(CAMERAS), tmp_path / "scene")
    return tmp_path / "scene"


def edit(scene: Path, change: Callable[[dict[str, Any]], object]) -> None:
    path = scene / "transforms.json"
    transforms = json.loads(path.read_text())
    change(transforms)
    path.write_text(json.dumps(transforms))


def assert_same(one: Pictures, other: Pictures) -> None:
    np.testing.assert_array_equal(one.colors, other.colors)
    np.testing.assert_array_equal(one.masks, other.masks)
    np.testing.assert_allclose(one.distance_cm, other.distance_cm, rtol=1e-6)
    for mine, yours in zip(one.cameras, other.cameras, strict=True):
        np.testing.assert_allclose(mine.camera_to_world, yours.camera_to_world)
        assert (mine.focal_px, mine.centre_px) == (yours.focal_px, yours.centre_px)


def test_a_scene_is_read_as_it_was_written(scene: Path) -> None:
    assert_same(read_scene(scene), sphere_pictures(CAMERAS))


def test_poses_and_distances_in_a_scene_are_in_metres(scene: Path) -> None:
    frame = json.loads((scene / "transforms.json").read_text())["frames"][0]
    assert np.array(frame["transform_matrix"])[:3, 3].tolist() == [0, -0.05, 0]
    packed = scene / "ns" / "renders" / "depth" / "000.npy.gz"
    with gzip.open(packed) as file:
        depth = np.load(file)
    assert depth.shape == (96, 128, 1)
    assert depth[48, 64, 0] == pytest.approx(0.04, rel=1e-3)


def test_frames_go_by_name_not_by_order(scene: Path) -> None:
    edit(scene, lambda found: found["frames"].reverse())
    assert_same(read_scene(scene), sphere_pictures(CAMERAS[::-1]))


def test_depths_in_another_unit_than_metres_are_refused_where_the_surface_is_known(
    scene: Path,
) -> None:
    surface = Surface(trimesh.creation.icosphere(subdivisions=5).triangles)
    assert_same(read_scene(scene, surface), sphere_pictures(CAMERAS))
    for depth in (scene / "ns" / "renders" / "depth").iterdir():
        scaled = 20 * np.load(io.BytesIO(gzip.decompress(depth.read_bytes())))
        with gzip.open(depth, "wb") as file:
            np.save(file, scaled)
    with pytest.raises(DataError, match=r"000\.npy\.gz: expected metres .* are 20 times those of"):
        read_scene(scene, surface)


def test_intrinsics_may_be_those_of_each_frame(tmp_path: Path) -> None:
    cameras = [CAMERAS[0], replace(CAMERAS[1], focal_px=(90.0, 91.0))]
    write_scene(sphere_pictures(cameras), tmp_path / "scene")
    assert "fl_x" not in json.loads((tmp_path / "scene" / "transforms.json").read_text())
    assert_same(read_scene(tmp_path / "scene"), sphere_pictures(cameras))


def test_without_depths_the_distances_are_those_of_the_surface(scene: Path) -> None:
    shutil.rmtree(scene / "ns")
    sphere = trimesh.creation.icosphere(subdivisions=5)
    assert_same(read_scene(scene, Surface(sphere.triangles)), sphere_pictures(CAMERAS))
    with pytest.raises(DataError, match="scene: no ns/renders/depth and so"):
        read_scene(scene)
    elsewhere = trimesh.creation.icosphere(radius=0.1)
    elsewhere.apply_translation([50, 0, 0])
    with pytest.raises(DataError, match="no picture shows the object where it should be"):
        read_scene(scene, Surface(elsewhere.triangles))


def scaled(found: dict[str, Any]) -> None:
    for frame in found["frames"]:
        pose = np.array(frame["transform_matrix"])
        pose[:3, 3] *= 3
        frame["transform_matrix"] = pose.tolist()


def test_cameras_whose_masks_are_not_where_the_object_is_are_refused(scene: Path) -> None:
    shutil.rmtree(scene / "ns")
    surface = Surface(trimesh.creation.icosphere(subdivisions=4).triangles)
    read_scene(scene, surface)
    edit(scene, scaled)
    with pytest.raises(DataError, match=r"masks and the object's outer surface share \d+% of"):
        read_scene(scene, surface)


def test_pictures_without_a_mask_are_refused(scene: Path) -> None:
    shutil.rmtree(scene / "ns")
    surface = Surface(trimesh.creation.icosphere(subdivisions=4).triangles)
    for path in (scene / "images").iterdir():
        with Image.open(path) as picture:
            picture.putalpha(255)
            picture.save(path)
    with pytest.raises(DataError, match="or alpha is no mask"):
        read_scene(scene, surface)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda found: found.update(frames=[]), "frames must be a list"),
        (lambda found: found.update(frames=[1]), "frames must be a list"),
        (lambda found: found["frames"][0].pop("file_path"), "each with a file_path"),
        (lambda found: found.pop("fl_x"), r"000\.png: 'fl_x' is missing"),
        (lambda found: found["frames"][0].update(cx="left"), r"000\.png: could not convert"),
        (lambda found: found["frames"][0].update(k1=0.1), r"without distortion .* \['k1'\]"),
        (
            lambda found: found["frames"][1].update(transform_matrix=np.eye(3).tolist()),
            r"001\.png: transform_matrix must be 4 by 4, got \(3, 3\)",
        ),
        (
            lambda found: found["frames"][1].update(transform_matrix=np.zeros((4, 4)).tolist()),
            r"001\.png: camera_to_world must be a rotation",
        ),
        (lambda found: found["frames"][0].update(file_path="images/9.png"), r"9\.png"),
        (lambda found: found["frames"][1].update(file_path="b/000.png"), r"once, got '000' twice"),
        (lambda found: found.update(w=64, h=48), r"h and w are \(48, 64\), the .* \(96, 128\)"),
        (lambda found: found.update(camera_model="OPENCV_FISHEYE"), "got 'OPENCV_FISHEYE'"),
        (lambda found: found.update(fl_y=float("nan")), r"got \[100\.0, nan\]"),
        (lambda found: found.update(fl_x=float("inf")), r"got \[inf, 100\.0\]"),
    ],
)
def test_cameras_that_break_the_layout_are_named(
    scene: Path, change: Callable[[dict[str, Any]], object], message: str
) -> None:
    edit(scene, change)
    with pytest.raises(DataError, match=message):
        read_scene(scene)


def test_files_that_break_the_layout_are_named(scene: Path) -> None:
    depth = scene / "ns" / "renders" / "depth" / "001.npy.gz"
    whole = depth.read_bytes()
    for damaged in (b"", whole[:-20], gzip.compress(b"none")):
        depth.write_bytes(damaged)
        with pytest.raises(DataError, match=r"001\.npy\.gz"):
            read_scene(scene)
    for save in (np.savez, lambda file, zeros: np.save(file, zeros.astype(str))):
        file = io.BytesIO()
        save(file, np.zeros((96, 128, 1)))
        depth.write_bytes(gzip.compress(file.getvalue()))
        with pytest.raises(DataError, match=r"001\.npy\.gz: expected an \.npy array of floats"):
            read_scene(scene)
    with gzip.open(depth, "wb") as file:
        np.save(file, np.zeros((3, 4, 1), dtype=np.float32))
    with pytest.raises(DataError, match=r"shape must be \(96, 128, 1\), got \(3, 4, 1\)"):
        read_scene(scene)
    with gzip.open(depth, "wb") as file:
        np.save(file, np.zeros((96, 128, 1), dtype=np.float32))
    with pytest.raises(DataError, match="positive and finite"):
        read_scene(scene)
    Image.new("RGB", (128, 96)).save(scene / "images" / "001.png")
    with pytest.raises(DataError, match=r"001\.png: expected RGBA, got RGB"):
        read_scene(scene)
    (scene / "transforms.json").write_text('{"frames":' + "[" * 100_000)
    with pytest.raises(DataError, match=r"transforms\.json"):
        read_scene(scene)
    (scene / "transforms.json").write_text("[]")
    with pytest.raises(DataError, match="expected a JSON object, got list"):
        read_scene(scene)


def test_scene_folders_give_the_pictures_of_an_object_by_its_id(tmp_path: Path) -> None:
    obj = painted("cube-0001", CUBE, {"cube": RED}, split="test")
    write_folder([obj], tmp_path / "data", version="0.1.0", builder="tests")
    folder = open_folder(tmp_path / "data")
    drawn = RenderedPhantoms()(folder, "cube-0001")
    write_scene(drawn, tmp_path / "scenes" / "cube-0001")
    source = SceneFolders(tmp_path / "scenes")
    assert_same(source(folder, "cube-0001"), drawn)
    before = source.fingerprint
    edit(tmp_path / "scenes" / "cube-0001", lambda found: found["frames"].pop())
    assert source.fingerprint != before
    before, picture = source.fingerprint, tmp_path / "scenes" / "cube-0001" / "images" / "000.png"
    os.utime(picture, ns=(0, 0))  # as if drawn anew, of the same size
    assert source.fingerprint != before
