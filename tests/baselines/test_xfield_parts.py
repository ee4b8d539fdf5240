"""What regions become of clusters of points."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy import ndimage

from xden1k.rays import CubeGrid
from xden_baselines.xfield.parts import Regions, regions_of, skin_voxels


def ball(radius: float, size: int = 21) -> np.ndarray:
    places = np.indices((size,) * 3) - size // 2
    return np.asarray((places**2).sum(axis=0) < radius**2)


def regions(inside: np.ndarray, clusters: np.ndarray, densities: list[float]) -> Regions:
    chosen = clusters[inside].astype(np.uint8)
    skin = inside & ~ndimage.binary_erosion(inside)
    return regions_of(inside, skin, chosen, np.array(densities, dtype=np.float32)[chosen])


def test_an_enclosed_cluster_without_density_is_void_and_numbered_last() -> None:
    found = regions(ball(9), ball(4).astype(int), [2.0, 0.05])
    assert found.void == 2
    assert np.array_equal(found.labels == 2, ball(4))
    assert found.density_g_cm3 == pytest.approx((2.0, 0.05))


def test_void_never_reaches_the_surface() -> None:
    inside = ball(9)
    half = np.broadcast_to(np.arange(21)[:, None, None] > 10, inside.shape)
    found = regions(inside, half.astype(int), [2.0, 0.0])
    assert found.void == 2
    assert not ndimage.binary_dilation(found.labels == 2)[~inside].any()


def test_a_gap_thinner_than_a_voxel_has_a_skin_on_either_side() -> None:
    left, right = trimesh.creation.box((1, 1, 1)), trimesh.creation.box((1, 1, 1))
    outer = trimesh.util.concatenate([left, right.apply_translation((1.001, 0, 0))])
    grid = CubeGrid(np.array([-1.0, -1.55, -1.55]), voxel_size_cm=0.1, size=32)
    skin = skin_voxels(outer, np.ones((32, 32, 32), dtype=bool), grid)
    assert skin[[14, 15, 16], 16, 16].all()
    assert not skin[[10, 20], 16, 16].any()


def test_an_object_that_is_light_all_over_is_not_void_as_a_whole() -> None:
    found = regions(ball(9), ball(4).astype(int), [0.05, 0.02])
    assert (found.void, set(np.unique(found.labels))) == (2, {0, 1, 2})


def test_a_fragment_goes_to_its_neighbour() -> None:
    inside, clusters = ball(9), np.zeros((21, 21, 21), dtype=int)
    clusters[12, 12, 12] = 1
    found = regions(inside, clusters, [1.0, 8.0])
    assert (found.void, set(np.unique(found.labels[inside]))) == (None, {1})
