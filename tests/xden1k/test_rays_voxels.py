"""Voxel fractions and labels against volumes, centres of mass and point tests."""

import numpy as np
import pytest
import trimesh
from hypothesis import example, given, settings
from hypothesis import strategies as st

from xden1k.errors import DataError
from xden1k.rays import (
    CubeGrid,
    column_samples,
    density_grid,
    disjoint_regions,
    fill_grid,
    object_cube,
    object_grids,
    outer_surface,
    ownership_order,
    part_fractions,
    voxel_labels,
)
from xden1k.values.mass import mass_of_grid, mass_of_meshes

seeds = st.integers(0, 2**32 - 1)
SHAPES = {
    "box": trimesh.creation.box((3.0, 2.0, 5.0)),
    "polygonal cylinder": trimesh.creation.cylinder(1.7, 4.0, sections=24),
    "faceted sphere": trimesh.creation.icosphere(2, 2.5),
    "torus": trimesh.creation.torus(2.5, 0.8, major_sections=24, minor_sections=12),
}


def turned(mesh, seed, shift=1.0):
    rng = np.random.default_rng(seed)
    pose = trimesh.transformations.random_rotation_matrix(rng.random(3))
    pose[:3, 3] = shift * rng.uniform(-1, 1, 3)
    return mesh.copy().apply_transform(pose)


def overlapping(seed):
    scales = (1.0, 0.8, 0.5, 0.7)
    return [
        turned(shape.copy().apply_scale(scale), seed + part)
        for part, (shape, scale) in enumerate(zip(SHAPES.values(), scales, strict=True))
    ]


def volume_of(fill, grid):
    return float(fill.share.sum(dtype=float)) * grid.voxel_size_cm**3


@pytest.mark.parametrize("name", SHAPES)
@settings(max_examples=10, deadline=None)
@given(seed=seeds)
def test_filled_grids_have_the_mass_and_centre_of_the_mesh(name, seed):
    mesh = turned(SHAPES[name], seed)
    grid, _ = object_cube([mesh])
    exact = mass_of_meshes([mesh], [2.0])
    filled = density_grid(part_fractions([mesh], [0], grid), [2.0], grid)
    found = mass_of_grid(filled, grid.origin_cm, grid.voxel_size_cm)
    assert found.mass_g == pytest.approx(exact.mass_g, rel=1e-3)
    np.testing.assert_allclose(found.com_cm, exact.com_cm, atol=0.02 * grid.voxel_size_cm)
    np.testing.assert_allclose(
        found.inertia_g_cm2, exact.inertia_g_cm2, atol=3e-3 * exact.inertia_g_cm2.max()
    )


@pytest.mark.parametrize("axis", [0, 1, 2])
@settings(max_examples=20, deadline=None)
@given(seed=seeds)
def test_faces_along_the_axes_are_placed_to_a_65th_of_a_voxel(axis, seed):
    bounds = np.array([[1.5] * 3, [9.5] * 3])  # voxels 2 to 9, filled exactly
    bounds[:, axis] = np.sort(np.random.default_rng(seed).uniform(-0.5, 15.5, 2))
    share = fill_grid([trimesh.creation.box(bounds=bounds)], CubeGrid(np.zeros(3), 1.0, 16))
    tolerance = 1 / 65 if axis < 2 else 1e-6
    assert share.sum() / 64 == pytest.approx(np.ptp(bounds[:, axis]), abs=tolerance)


def test_voxels_well_inside_are_exactly_full_and_those_outside_exactly_empty():
    ball = trimesh.creation.icosphere(4, 2.0)
    grid, _ = object_cube([ball])
    share = fill_grid([ball], grid)
    axis = grid.origin_cm[0] + grid.voxel_size_cm * np.arange(grid.size)
    radius = np.sqrt(sum(np.square(a) for a in np.meshgrid(axis, axis, axis, indexing="ij")))
    assert (share[radius < 2.0 - 2 * grid.voxel_size_cm] == 1).all()
    assert (share[radius > 2.0 + grid.voxel_size_cm] == 0).all()


@pytest.mark.parametrize("subsamples", [1, 2, 3, 8])
def test_an_even_or_odd_number_of_rays_is_centred_on_the_voxel(subsamples):
    grid = CubeGrid(np.full(3, -7.5), 1.0, 16)
    ball = trimesh.creation.icosphere(3, 6.0)
    filled = density_grid(part_fractions([ball], [0], grid, subsamples), [1.0], grid)
    found = mass_of_grid(filled, grid.origin_cm, grid.voxel_size_cm)
    np.testing.assert_allclose(found.com_cm, 0, atol=0.01)
    assert found.mass_g == pytest.approx(ball.volume, rel=3e-3)


@settings(max_examples=10, deadline=None)
@given(seed=seeds)
def test_moving_by_whole_voxels_moves_the_grid_and_by_parts_moves_the_centre(seed):
    rng = np.random.default_rng(seed)
    mesh, grid = turned(SHAPES["torus"], seed, shift=0.3), CubeGrid(np.full(3, -8.0), 0.5, 33)
    whole, part = rng.integers(-3, 4, 3), rng.uniform(-1, 1, 3)
    rest = fill_grid([mesh], grid)
    moved = fill_grid([mesh.copy().apply_translation(0.5 * whole)], grid)
    np.testing.assert_allclose(moved, np.roll(rest, whole, (0, 1, 2)), atol=0.05)
    assert np.abs(moved - np.roll(rest, whole, (0, 1, 2))).mean() < 1e-6
    shifted = fill_grid([mesh.copy().apply_translation(part)], grid)
    before, after = (mass_of_grid(each, grid.origin_cm, 0.5).com_cm for each in (rest, shifted))
    np.testing.assert_allclose(after - before, part, atol=0.005)


TWO_COLUMNS = 2 / 16**2
"""Of the columns through a voxel."""


@example(seed=40073, order=[3, 1, 2, 0])
@settings(max_examples=4)
@given(seed=seeds, order=st.permutations(range(4)))
def test_shares_of_overlapping_parts_are_those_of_the_cut_parts(seed, order):
    meshes = overlapping(seed)
    grid, _ = object_cube(meshes)
    fills = part_fractions(meshes, order, grid)
    cut = part_fractions(disjoint_regions(meshes, order), range(4), grid)
    whole, pieces = (density_grid(each, [1.0, 2.0, 4.0, 8.0], grid) for each in (fills, cut))
    off = np.abs(whole - pieces)
    assert np.count_nonzero(off > 1e-3) < 1e-4 * off.size
    assert off.max() < TWO_COLUMNS * 8.0  # rounding decides where a column grazes an edge
    occupancy = density_grid(fills, [1.0] * 4, grid)
    assert occupancy.max() <= 1 + 1e-6
    np.testing.assert_allclose(occupancy, fill_grid(meshes, grid), atol=1e-6)
    assert volume_of(fills[order[0]], grid) == pytest.approx(meshes[order[0]].volume, rel=2e-3)


def test_an_objects_mass_on_the_grid_is_that_of_its_meshes():
    overlaps = overlapping(seed=5)
    order = ownership_order(overlaps)
    meshes, densities = disjoint_regions(overlaps, order), [1.0, 2.7, 7.8, 0.4]
    grid, _ = object_cube(meshes)
    exact = mass_of_meshes(meshes, densities)
    filled = density_grid(part_fractions(overlaps, order, grid), densities, grid)
    found = mass_of_grid(filled, grid.origin_cm, grid.voxel_size_cm)
    assert found.mass_g == pytest.approx(exact.mass_g, rel=1e-3)
    np.testing.assert_allclose(found.com_cm, exact.com_cm, atol=0.02 * grid.voxel_size_cm)


def test_labels_name_the_strongest_part_that_contains_the_voxels_centre():
    meshes, order = overlapping(seed=3), [2, 0, 3, 1]
    _, grid = object_cube(meshes)
    labels = voxel_labels(meshes, order, grid)
    assert set(np.unique(labels)) == {0, 1, 2, 3, 4}
    index = np.random.default_rng(0).integers(0, grid.size, (4000, 3))
    points = grid.origin_cm + grid.voxel_size_cm * index
    wanted = np.zeros(len(points), dtype=np.uint8)
    for part in order[::-1]:
        wanted[meshes[part].contains(points)] = part + 1
    np.testing.assert_array_equal(labels[tuple(index.T)], wanted)


def test_the_cube_leaves_the_margin_and_both_grids_fill_it():
    mesh = trimesh.creation.box(bounds=[[1.0, 2.0, -3.0], [3.0, 2.5, 5.0]])
    field, labels = object_cube([mesh, trimesh.Trimesh()])
    assert (field.size, labels.size) == (64, 128)
    assert field.voxel_size_cm == pytest.approx(2 * labels.voxel_size_cm)
    np.testing.assert_allclose(labels.origin_cm, field.origin_cm - field.voxel_size_cm / 4)
    corner = field.origin_cm - field.voxel_size_cm / 2
    np.testing.assert_allclose(corner, mesh.bounds.mean(axis=0) - 8 * 1.06 / 2)
    assert field.size * field.voxel_size_cm == pytest.approx(8 * 1.06)


def test_what_lies_outside_the_grid_is_left_out():
    grid = CubeGrid(np.zeros(3), 1.0, 8)
    box = trimesh.creation.box(bounds=[[-9.0, 2.0, 3.0], [4.5, 30.0, 30.0]])
    share = fill_grid([box], grid)
    assert share.sum() == pytest.approx(5.0 * 5.5 * 4.5, rel=1e-2)
    assert (voxel_labels([box], [0], grid) == 1).sum() == 5 * 6 * 5
    corner = trimesh.creation.box(bounds=[[-1e4] * 3, [1e4] * 3])  # every voxel is reached
    assert (fill_grid([corner], grid) == 1).all()
    assert (voxel_labels([corner], [0], grid) == 1).all()
    far = box.copy().apply_translation([100.0, 0, 0])
    assert not fill_grid([far], grid).any()
    assert not voxel_labels([far, trimesh.Trimesh()], [0, 1], grid).any()


def test_the_envelope_of_a_hollow_ball_is_full_and_of_an_open_cup_is_the_cup():
    ball = trimesh.creation.icosphere(3, 2.0)
    hole = trimesh.creation.icosphere(3, 1.0)
    hole.invert()
    hollow = trimesh.util.concatenate([ball, hole])
    outside = trimesh.creation.cylinder(2, 5, sections=48)
    inside = trimesh.creation.cylinder(1.8, 5, sections=48).apply_translation([0, 0, 0.3])
    cup = trimesh.boolean.difference([outside, inside], engine="manifold")
    for mesh, volume in ((hollow, ball.volume), (cup, cup.volume)):
        grid, _ = object_cube([mesh])
        share = fill_grid([outer_surface([mesh])], grid)
        assert share.sum() * grid.voxel_size_cm**3 == pytest.approx(volume, rel=1e-3)


@pytest.mark.parametrize("yaw_deg", [0, 8, 30, 45, 71])
def test_ruler_on_end_weighs_what_its_mesh_weighs(yaw_deg):
    ruler = trimesh.creation.box((3.1, 0.11, 31.0))
    ruler.apply_transform(trimesh.transformations.rotation_matrix(np.radians(yaw_deg), (0, 0, 1)))
    density = object_grids([ruler], [0]).density([1.2])
    assert density.mass_g == pytest.approx(1.2 * float(ruler.volume), rel=2e-3)


def test_columns_are_denser_on_a_small_base_and_never_more_in_all():
    counts = []
    for side in (30.0, 16.0, 10.0, 5.0, 1.0):
        post = trimesh.creation.box((side, side, 30.0))
        field, _ = object_cube([trimesh.Trimesh(), post])
        density = column_samples([trimesh.Trimesh(), post], field)
        counts.append(density**2 * (side / field.voxel_size_cm + 1) ** 2)
        assert 16 <= density <= 64
    assert max(counts[1:]) < 1.1 * 0.5 * (16 * 64) ** 2  # of half the base, rounded up
    assert column_samples([post], field, least=8) == 32


def test_bad_input_is_refused():
    box, grid = trimesh.creation.box(), CubeGrid(np.zeros(3), 0.1, 8)
    lidless = trimesh.Trimesh(box.vertices, box.faces[box.face_normals[:, 2] < 0.5])
    for act in (part_fractions, voxel_labels):
        with pytest.raises(DataError, match=r"rays along z leave a part they never entered"):
            act([lidless], [0], CubeGrid(np.full(3, -1.03), 0.1, 21))
        with pytest.raises(DataError, match=r"each of 0 to 0 once, got \[1\]"):
            act([box], [1], grid)
    with pytest.raises(DataError, match=r"subsamples must be at least 1, got 0"):
        part_fractions([box], [0], grid, subsamples=0)
    with pytest.raises(DataError, match=r"labels tell 255 parts apart, got 256"):
        voxel_labels([box] * 256, range(256), grid)
    with pytest.raises(DataError, match=r"1 parts need as many densities, got 2"):
        density_grid(part_fractions([box], [0], grid), [1.0, 2.0], grid)
    with pytest.raises(DataError, match=r"none of 1 parts has a face"):
        object_cube([trimesh.Trimesh()])
    with pytest.raises(DataError, match=r"all parts are one point"):
        object_cube([trimesh.Trimesh(np.ones((3, 3)), [[0, 1, 2]], process=False)])
