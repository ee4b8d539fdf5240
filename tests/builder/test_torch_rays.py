"""The projector in torch finds what the compiled one finds, on every device there is."""

import numpy as np
import pytest
import torch
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.builder.fit_scenes import cone
from xden1k.errors import DataError
from xden1k.rays import path_lengths
from xden1k.values.views import ViewGeometry
from xden_builder.speed import torch_rays

DEVICES = ["cpu", *(["cuda"] if torch.cuda.is_available() else [])]
on_each_device = pytest.mark.parametrize("device", DEVICES)
SIZE = 40
SOLIDS = {
    "sphere": trimesh.creation.icosphere(2, 2.5),
    "box": trimesh.creation.box((3.0, 2.0, 5.0)),
    "thin plate": trimesh.creation.box((6.0, 0.01, 6.0)),
    "torus": trimesh.creation.torus(2.0, 0.7, major_sections=20, minor_sections=12),
}


def view(beam="cone", *, tilt=0.0, seed=0, flip_rows=False, mirror=False):
    """A panel 30 cm behind the object, source 100 cm before it; tilted panels have skewed steps."""
    rng = np.random.default_rng(seed)
    column = np.array([-0.4 if mirror else 0.4, 0.0, 0.0]) + tilt * rng.normal(size=3)
    row = np.array([0.0, 0.0, 0.4 if flip_rows else -0.4]) + tilt * rng.normal(size=3)
    middle = np.array([0.1, 30.0, -0.2])
    emitter = (
        {"source_cm": np.array([0.3, -100.0, 0.7])}
        if beam == "cone"
        else {"direction": np.array([0.02, 1.0, -0.05])}
    )
    return ViewGeometry(
        beam=beam,
        pixel00_cm=middle - (SIZE - 1) / 2 * (column + row),
        column_step_cm=column,
        row_step_cm=row,
        shape=(SIZE, SIZE + 3),
        **emitter,
    )


def posed(name, seed, scale=1.0):
    rng = np.random.default_rng(seed)
    pose = trimesh.transformations.random_rotation_matrix(rng.random(3))
    pose[:3, 3] = rng.uniform(-1, 1, 3)
    return SOLIDS[name].copy().apply_scale(scale).apply_transform(pose)


def assert_same(meshes, order, geometry, subrays=1, device="cpu"):
    ours = path_lengths(meshes, order, geometry, subrays)
    other = torch_rays.path_lengths(meshes, order, geometry, subrays, device)
    np.testing.assert_array_equal(other.pixels, ours.pixels)
    np.testing.assert_array_equal(other.broken, ours.broken)
    np.testing.assert_allclose(other.lengths_cm, ours.lengths_cm, atol=1e-5, rtol=0)
    np.testing.assert_allclose(other.shared_cm, ours.shared_cm, atol=1e-5, rtol=0)
    assert other.shape == ours.shape
    return other


@on_each_device
@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    beam=st.sampled_from(["cone", "parallel"]),
    flip_rows=st.booleans(),
    mirror=st.booleans(),
    tilted=st.booleans(),
    subrays=st.integers(1, 3),
    order=st.permutations(range(5)),
)
def test_nested_and_overlapping_parts_are_seen_alike_in_any_geometry(
    device, seed, beam, flip_rows, mirror, tilted, subrays, order
):
    geometry = view(beam, tilt=0.1 * tilted, seed=seed, flip_rows=flip_rows, mirror=mirror)
    parts = [posed(name, seed + number) for number, name in enumerate(SOLIDS)]
    parts.append(posed("sphere", seed, scale=0.3))
    lengths = assert_same(parts, order, geometry, subrays, device)
    assert lengths.shared_cm.any()
    assert not lengths.broken.any()


@on_each_device
@pytest.mark.parametrize("beam", ["cone", "parallel"])
def test_each_solid_alone_is_seen_alike(device, beam):
    for name in SOLIDS:
        assert len(assert_same([posed(name, 3)], [0], view(beam), 2, device).pixels)


@on_each_device
def test_a_ball_has_the_chords_of_a_sphere(device):
    radius, centre = 2.0, np.array([0.3, 0.2, -0.1])
    ball = trimesh.creation.icosphere(5, radius).apply_translation(centre)
    geometry = cone(90.0, 64, 12.0)
    lengths = torch_rays.path_lengths([ball], [0], geometry, device=device)
    rows, columns = (index.astype(float) for index in np.divmod(lengths.pixels, 64))
    ways = geometry.pixel_centres_cm(rows, columns) - geometry.source_cm
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    distance = np.linalg.norm(np.cross(centre - geometry.source_cm, ways), axis=1)
    chords = 2 * np.sqrt(np.clip(radius**2 - distance**2, 0, None))
    inner = distance < 0.9 * radius
    assert inner.sum() > 200
    short = chords[inner] - lengths.lengths_cm[inner, 0, 0]  # facets lie within the sphere
    assert 0 < short.min() < short.max() < 3e-3


@on_each_device
def test_parts_within_parts_give_up_exactly_the_space_of_the_stronger(device):
    outer, inner = trimesh.creation.box((4.0, 3.0, 4.0)), trimesh.creation.box((1.0, 1.0, 1.0))
    pixel = ViewGeometry(
        beam="parallel",
        pixel00_cm=np.array([0.1, 9.0, 0.1]),
        column_step_cm=np.array([9.0, 0.0, 0.0]),
        row_step_cm=np.array([0.0, 0.0, -9.0]),
        shape=(1, 1),
        direction=np.array([0.0, 1.0, 0.0]),
    )
    for order, wanted in (([1, 0], [2.0, 1.0]), ([0, 1], [3.0, 0.0])):
        lengths = torch_rays.path_lengths([outer, inner], order, pixel, device=device)
        np.testing.assert_allclose(lengths.lengths_cm.ravel(), wanted, atol=1e-6)
        np.testing.assert_allclose(lengths.shared_cm, 1.0, atol=1e-6)


@on_each_device
@pytest.mark.parametrize("beam", ["cone", "parallel"])
def test_open_meshes_break_the_same_pixels(device, beam):
    meshes = [posed("sphere", 1), posed("torus", 2)]
    holes = [np.delete(mesh.faces, slice(0, None, 40), axis=0) for mesh in meshes]
    torn = [
        trimesh.Trimesh(mesh.vertices, faces, process=False)
        for mesh, faces in zip(meshes, holes, strict=True)
    ]
    for subrays in (1, 2):
        assert assert_same(torn, [1, 0], view(beam), subrays, device).broken.sum() > 3


@on_each_device
def test_rays_along_edges_and_through_vertices_leave_closed_meshes_closed(device):
    box = trimesh.creation.box((4.0, 2.0, 6.0))
    geometry = ViewGeometry(
        beam="cone",
        pixel00_cm=np.array([-8.0, 1.0, 8.0]),
        column_step_cm=np.array([1.0, 0.0, 0.0]),
        row_step_cm=np.array([0.0, 0.0, -1.0]),
        shape=(17, 17),
        source_cm=np.array([2.0, -50.0, 3.0]),
    )
    assert not assert_same([box], [0], geometry, device=device).broken.any()


@on_each_device
def test_cutting_the_work_into_bands_changes_nothing(monkeypatch, device):
    meshes = [posed("box", 1), posed("torus", 2)]
    monkeypatch.setattr(torch_rays, "CROSSINGS_AT_ONCE", 500)
    assert_same(meshes, [1, 0], view(), 2, device)


@on_each_device
def test_nothing_in_view_gives_no_pixels(device):
    away = SOLIDS["box"].copy().apply_translation([90.0, 0, 0])
    for meshes in ([], [trimesh.Trimesh()], [away]):
        lengths = assert_same(meshes, range(len(meshes)), view(), 3, device)
        assert lengths.lengths_cm.shape == (0, 9, len(meshes))


@on_each_device
def test_what_leaves_the_detector_is_cut_off_and_empty_meshes_are_met_by_no_ray(device):
    corner = SOLIDS["box"].copy().apply_translation([6.0, 0, -6.0])
    lengths = assert_same([trimesh.Trimesh(), corner], [0, 1], view(), 2, device)
    assert len(lengths.pixels)
    assert not lengths.lengths_cm[..., 0].any()


def test_tensors_are_made_on_the_device_asked_for_alone():
    # any that is made without saying where would land on the device without data
    with torch.device("meta"):
        assert_same([posed("box", 1), posed("torus", 2)], [1, 0], view(), 2)


def test_bad_input_is_refused_as_by_the_compiled_projector():
    box = SOLIDS["box"]
    behind = box.copy().apply_translation([0.0, -100.0, 0.0])
    lost = trimesh.Trimesh(
        np.where(box.vertices > 2, np.inf, box.vertices), box.faces, process=False
    )
    for meshes, order, geometry, subrays in (
        ([box, behind], [1, 0], view(), 1),
        ([box, lost], [0, 1], view("parallel"), 1),
        ([box, box], [0, 0], view(), 1),
        ([box], [0], view(), 0),
    ):
        with pytest.raises(DataError) as wanted:
            path_lengths(meshes, order, geometry, subrays)
        with pytest.raises(DataError) as refused:
            torch_rays.path_lengths(meshes, order, geometry, subrays)
        assert str(refused.value) == str(wanted.value)


def test_devices_that_are_not_there_or_lack_float64_are_refused():
    with pytest.raises(DataError, match=r"device cuda:99: torch finds \d+ CUDA GPUs"):
        torch_rays.path_lengths([SOLIDS["box"]], [0], view(), device="cuda:99")
    with pytest.raises(DataError, match=r"must be a CPU or a CUDA GPU, got meta"):
        torch_rays.path_lengths([SOLIDS["box"]], [0], view(), device="meta")
