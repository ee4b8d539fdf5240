"""Solids of labels: closed, disjoint, and filling the outer surface."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from xden1k.errors import DataError
from xden1k.rays import CubeGrid, disjoint_regions, label_solids, outer_surface
from xden1k.rays.manifolds import solid_of
from xden1k.values.arrays import Labels, Points
from xden1k.values.closed import EdgeFaults, edge_faults

CLOSED = EdgeFaults(open=0, twisted=0)


def around(mesh: trimesh.Trimesh, size: int) -> CubeGrid:
    edge = 1.06 * float(mesh.extents.max())
    return CubeGrid(mesh.bounds.mean(axis=0) - edge / 2 * (1 - 1 / size), edge / size, size)


def centres(grid: CubeGrid) -> Points:
    return grid.origin_cm + grid.voxel_size_cm * np.indices((grid.size,) * 3).reshape(3, -1).T


def labelled(grid: CubeGrid, second: np.ndarray) -> Labels:
    return np.where(second, 2, 1).astype(np.uint8).reshape((grid.size,) * 3)


def shared_cm3(one: trimesh.Trimesh, other: trimesh.Trimesh) -> float:
    return abs(float((solid_of(one) ^ solid_of(other)).volume()))


def assert_partition(outer: trimesh.Trimesh, solids: list[trimesh.Trimesh]) -> None:
    whole = float(outer.volume)
    filled = [solid for solid in solids if len(solid.faces)]
    assert sum(float(solid.volume) for solid in filled) == pytest.approx(whole, rel=0.005)
    assert [edge_faults(solid.faces) for solid in filled] == [CLOSED] * len(filled)
    assert all(shared_cm3(one, two) < 0.0005 * whole for one, two in combinations(filled, 2))


@settings(max_examples=5, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 5), smooth=st.sampled_from([0.0, 1.5]))
def test_random_labels_fill_the_surface_and_share_no_space(
    seed: int, count: int, smooth: float
) -> None:
    outer = trimesh.creation.icosphere(2, 1.3).apply_translation((5, -2, 0.5))
    grid = around(outer, 8 if smooth == 0 else 16)
    noise = np.random.default_rng(seed).normal(size=(count, *(grid.size,) * 3))
    drawn = np.stack([ndimage.gaussian_filter(one, smooth) for one in noise]).argmax(axis=0)
    assert_partition(outer, label_solids(outer, drawn.astype(np.uint8) + 1, grid))


def test_a_box_falls_into_the_two_halves_it_is_labelled_in() -> None:
    outer = trimesh.creation.box((2, 1, 1))
    grid = around(outer, 16)
    solids = label_solids(outer, labelled(grid, centres(grid)[:, 0] > 0), grid)
    assert_partition(outer, solids)
    left, right = (solid.bounds for solid in solids)
    np.testing.assert_allclose(left, [[-1, -0.5, -0.5], [0, 0.5, 0.5]], atol=1e-6)
    np.testing.assert_allclose(right, [[0, -0.5, -0.5], [1, 0.5, 0.5]], atol=1e-6)


def test_a_hollow_in_a_ball_is_left_empty_and_has_its_volume() -> None:
    outer = trimesh.creation.icosphere(4, 1.0)
    grid = around(outer, 32)
    labels = labelled(grid, np.linalg.norm(centres(grid), axis=1) < 0.5)
    solid, nothing = label_solids(outer, labels, grid, void=2)
    assert not len(nothing.faces)
    assert float(outer.volume - solid.volume) == pytest.approx(4 / 3 * np.pi / 8, rel=0.02)
    assert edge_faults(solid.faces) == CLOSED
    assert float(outer_surface([solid]).volume) == pytest.approx(float(outer.volume))


def test_what_has_no_label_goes_to_the_nearest_that_has_one() -> None:
    outer = trimesh.creation.box((2, 1, 1))
    grid = around(outer, 16)
    full = labelled(grid, centres(grid)[:, 0] > 0)
    inside = (np.abs(centres(grid)) < [0.8, 0.3, 0.3]).all(axis=1).reshape(full.shape)
    for one, two in zip(
        label_solids(outer, full * inside, grid), label_solids(outer, full, grid), strict=True
    ):
        assert float(one.volume) == pytest.approx(float(two.volume), rel=1e-6)


def test_solids_touch_but_do_not_overlap_for_those_who_cut_parts() -> None:
    outer = trimesh.creation.icosphere(3, 2.0)
    grid = around(outer, 24)
    solids = label_solids(outer, labelled(grid, centres(grid) @ [0.3, 0.8, 0.5] > 0.2), grid)
    assert disjoint_regions(solids, [0, 1]) == solids


def test_a_label_without_a_voxel_has_no_solid() -> None:
    outer = trimesh.creation.box((1, 1, 1))
    grid = around(outer, 8)
    labels = np.full((8, 8, 8), 3, dtype=np.uint8)
    assert [len(solid.faces) > 0 for solid in label_solids(outer, labels, grid)] == [
        False,
        False,
        True,
    ]


def test_no_label_at_all_another_size_and_an_open_surface_are_refused() -> None:
    outer = trimesh.creation.box((1, 1, 1))
    grid = around(outer, 8)
    with pytest.raises(DataError, match="no voxel at the surface has one"):
        label_solids(outer, np.zeros((8, 8, 8), dtype=np.uint8), grid)
    with pytest.raises(DataError, match=r"a grid of 8 a side, got \(8, 8, 9\)"):
        label_solids(outer, np.ones((8, 8, 9), dtype=np.uint8), grid)
    outer.faces = outer.faces[1:]
    with pytest.raises(DataError, match="not a closed mesh"):
        label_solids(outer, np.ones((8, 8, 8), dtype=np.uint8), grid)
