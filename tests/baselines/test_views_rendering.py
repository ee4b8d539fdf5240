"""Rendering: the depth of a sphere, what hides what, light, and who may see the pictures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.baselines.painted import BROWN, GREY, RED, camera_at, painted, sphere_pictures
from tests.phantoms import BAR, FILLED
from xden1k.errors import DataError
from xden1k.folder import DatasetFolder, open_folder, write_folder
from xden1k.predictor import PictureSource, SampleView
from xden1k.values.modality import Modality, ModalityError
from xden_baselines.views.cameras import Rig
from xden_baselines.views.pictures import BACKGROUND, Pictures, visible
from xden_baselines.views.rendering import AMBIENT, LIGHTS, Surface, render, shaded
from xden_baselines.views.source import RenderedPhantoms, SceneFolders, render_object

PAINT = {"plastic": RED, "steel": GREY, "shell": BROWN, "core": RED}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> DatasetFolder:
    root = tmp_path_factory.mktemp("views") / "dataset"
    objects = [
        painted("bar-0001", BAR, PAINT, split="test"),
        painted("bar-0002", BAR, PAINT, split="test", source="scan"),
    ]
    write_folder(objects, root, version="0.1.0", builder="tests")
    return open_folder(root)


def test_distances_to_a_sphere_are_those_of_the_formula() -> None:
    camera = camera_at((3.0, -2.0, 1.5), (0.1, 0.2, 0.0))
    pictures = sphere_pictures([camera])
    along = -(camera.rays() @ camera.position_cm)
    closest_squared = camera.position_cm @ camera.position_cm - along**2
    exact = along - np.sqrt((1 - closest_squared).clip(min=0))
    well_inside = closest_squared < 0.9
    assert well_inside.sum() > 1000
    # the facets of the mesh lie at most 4e-4 under the sphere, and are seen slanted
    np.testing.assert_allclose(pictures.distance_cm[0][well_inside], exact[well_inside], atol=2e-3)
    assert not pictures.masks[0][closest_squared > 1].any()
    assert pictures.masks[0][closest_squared < 0.995].all()


def test_the_nearer_of_two_is_drawn() -> None:
    near = trimesh.creation.box(bounds=[[-1, -3, -1], [1, -2, 1]])
    far = trimesh.creation.box(bounds=[[-2, 2, -2], [2, 3, 2]])
    drawn = render([far, near], [GREY, RED], [camera_at((0, -10, 0))])
    middle = drawn.parts[0, 48, 64]
    assert middle == 2
    assert drawn.pictures.distance_cm[0, 48, 64] == pytest.approx(7, abs=0.01)
    beside = drawn.parts[0, 48, 64 + 15]
    assert beside == 1
    assert (drawn.parts[0, 0] == 0).all()


def test_what_is_hidden_leaves_no_trace_in_the_pictures() -> None:
    whole = render_object(painted("filled-0001", FILLED, PAINT))
    shell = render_object(painted("filled-0001", FILLED[:1], PAINT))
    np.testing.assert_array_equal(whole.pictures.colors, shell.pictures.colors)
    np.testing.assert_array_equal(whole.pictures.distance_cm, shell.pictures.distance_cm)
    assert set(np.unique(whole.parts)) == {0, 1}


def test_the_order_of_parts_does_not_change_the_pictures() -> None:
    cameras = Rig(per_ring=2, size_px=96).cameras(np.array([[0.0, 0, 0], [2, 2, 4]]))
    meshes, colors = [box.mesh for box in BAR], [RED, GREY]
    one = render(meshes, colors, cameras)
    other = render(meshes[::-1], colors[::-1], cameras)
    np.testing.assert_array_equal(one.pictures.colors, other.pictures.colors)
    np.testing.assert_array_equal(one.parts == 1, other.parts == 2)


def test_light_dims_a_colour_and_never_changes_its_hue() -> None:
    pictures = sphere_pictures([camera_at((4, 1, 2)), camera_at((-4, 1, -2))])
    seen = pictures.colors[pictures.masks] / 255.0
    np.testing.assert_allclose(seen[:, 0] / seen[:, 1], 8, rtol=0.06)  # 0.8 to 0.1, in bytes
    assert seen[:, 0].min() >= AMBIENT * 0.8 - 0.003
    assert seen[:, 0].max() <= 0.8
    assert (pictures.colors[~pictures.masks] == BACKGROUND).all()


def test_shading_is_lamberts_law() -> None:
    towards, strength = np.array(LIGHTS[2][0]), LIGHTS[2][1]
    towards = towards / np.linalg.norm(towards)
    beside = np.cross(towards, [1.0, 0, 0])
    beside /= np.linalg.norm(beside)
    angles = np.array([0.0, 0.5, 1.0])
    normals = np.cos(angles)[:, None] * towards + np.sin(angles)[:, None] * beside
    others = sum(
        weight * (normals @ (np.array(light) / np.linalg.norm(light))).clip(min=0)
        for light, weight in LIGHTS[:2]
    )
    found = shaded(normals, -normals)
    np.testing.assert_allclose(found, AMBIENT + strength * np.cos(angles) + others)
    np.testing.assert_allclose(shaded(-normals, -normals), found)
    assert AMBIENT + sum(weight for _, weight in LIGHTS) == pytest.approx(1)


def test_a_point_is_visible_only_from_its_side() -> None:
    pictures = sphere_pictures([camera_at((0, -5, 0)), camera_at((0, 5, 0))])
    points = np.array([[0, -1.0, 0], [0, 1.0, 0], [0, -1.2, 0], [0, -0.7, 0]])
    front, at = visible(points, pictures, 0, tolerance_cm=0.1)
    back, _ = visible(points, pictures, 1, tolerance_cm=0.1)
    assert front.tolist() == [True, False, True, False]
    assert back.tolist() == [False, True, False, False]
    assert at.tolist() == [[48, 64], [48, 64]]


def test_a_point_near_the_edge_is_not_visible_with_a_margin() -> None:
    pictures = sphere_pictures([camera_at((0, -2, 0), (0.9, 0, 0.3))])
    point = np.array([[0.0, -1.0, 0.0]])
    column, row, _ = pictures.cameras[0].project(point)[0]
    margin = int(min(row, column, 96 - row, 128 - column))
    assert visible(point, pictures, 0, tolerance_cm=0.1, margin_px=margin)[0].all()
    assert not visible(point, pictures, 0, tolerance_cm=0.1, margin_px=margin + 1)[0].any()


def test_a_point_that_projects_off_the_object_is_not_visible() -> None:
    pictures = sphere_pictures([camera_at((0, -5, 0))])
    assert not visible(np.array([[1.5, 0.0, 0.0]]), pictures, 0, tolerance_cm=9.0)[0].any()


def test_pictures_of_different_shapes_are_refused() -> None:
    good = sphere_pictures([camera_at((0, -5, 0))])
    tall = replace(good.cameras[0], shape=(97, 128))
    with pytest.raises(DataError, match="must have one shape"):
        Pictures(good.colors, good.masks, good.distance_cm, (tall,))
    with pytest.raises(DataError, match="positive and finite"):
        Pictures(good.colors, ~good.masks, good.distance_cm, good.cameras)
    with pytest.raises(DataError, match="at least one view"):
        Pictures(good.colors[:0], good.masks[:0], good.distance_cm[:0], ())


def test_nothing_cannot_be_drawn() -> None:
    with pytest.raises(DataError, match="needs triangles"):
        Surface(np.zeros((0, 3, 3)))
    with pytest.raises(DataError, match="at least one camera"):
        render([BAR[0].mesh], [RED], [])


def test_phantoms_are_drawn_for_methods_that_declare_pictures(folder: DatasetFolder) -> None:
    source = RenderedPhantoms()
    assert isinstance(source, PictureSource)
    sample = SampleView(folder, "bar-0001", Modality.RGB, source)
    assert len(sample.pictures) == 12
    assert source.description == "12 views of 256 x 256 px rendered in part colours"
    assert source.fingerprint != RenderedPhantoms(Rig(per_ring=9)).fingerprint
    with pytest.raises(ModalityError, match="pictures needs the modality RGB"):
        _ = SampleView(folder, "bar-0001", Modality.GEOMETRY, source).pictures


def test_a_scan_is_never_drawn_in_made_up_colours(folder: DatasetFolder) -> None:
    with pytest.raises(DataError, match="bar-0002: its parts have no true colours"):
        RenderedPhantoms()(folder, "bar-0002")


def test_an_object_without_a_scene_is_an_error(folder: DatasetFolder, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="bar-0002: no scene folder"):
        SceneFolders(tmp_path)(folder, "bar-0002")
    with pytest.raises(DataError, match="no folder of scenes"):
        SceneFolders(tmp_path / "nowhere")
