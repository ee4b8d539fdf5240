"""Part densities as grids."""

from __future__ import annotations

import numpy as np
import pytest

from xden_bench.expand import grid_of_parts
from xden_bench.reference import Reference


def loop_reference(
    part_density: np.ndarray, labels: np.ndarray, occupancy: np.ndarray
) -> np.ndarray:
    field = np.zeros(occupancy.shape)
    for i, j, k in np.ndindex(*occupancy.shape):
        block = labels[2 * i : 2 * i + 2, 2 * j : 2 * j + 2, 2 * k : 2 * k + 2].ravel()
        found = [part_density[label] for label in block if label]
        field[i, j, k] = occupancy[i, j, k] * sum(found) / len(found) if found else 0.0
    return field


def test_it_agrees_with_a_loop() -> None:
    rng = np.random.default_rng(0)
    labels = rng.integers(0, 4, (8, 6, 10)).astype(np.uint8)
    occupancy = rng.random((4, 3, 5))
    occupancy[labels.reshape(4, 2, 3, 2, 5, 2).max(axis=(1, 3, 5)) == 0] = 0
    densities = np.array([0.0, 1.0, 7.8, 2.5])
    expected = loop_reference(densities, labels, occupancy)
    np.testing.assert_allclose(grid_of_parts(densities, labels, occupancy), expected, rtol=1e-6)


def test_matter_without_a_label_takes_the_nearest_part() -> None:
    labels = np.zeros((6, 2, 2), np.uint8)
    labels[4:] = 2
    occupancy = np.array([[[0.0]], [[0.1]], [[1.0]]])
    field = grid_of_parts(np.array([0.0, 1.0, 8.0]), labels, occupancy)
    np.testing.assert_allclose(field.ravel(), [0.0, 0.8, 8.0], rtol=1e-6)


@pytest.mark.parametrize("object_id", ["cube-0003", "hollow-0002"])
def test_an_object_of_one_part_is_exact(reference: Reference, object_id: str) -> None:
    truth = reference.truth(object_id)
    density = {"cube-0003": 2.0, "hollow-0002": 1.5}[object_id]
    field = grid_of_parts(np.array([0.0, density]), *reference.layout(object_id))
    np.testing.assert_allclose(field, truth.density_g_cm3, atol=density / 255)


def test_two_parts_are_good_to_an_eighth_of_the_voxels_they_share(reference: Reference) -> None:
    truth = reference.truth("bar-0002")
    field = grid_of_parts(np.array([0.0, 1.0, 8.0]), *reference.layout("bar-0002"))
    off = np.abs(field - truth.density_g_cm3)
    assert (off > 0.05).mean() < 0.02
    assert field.sum() == pytest.approx(truth.density_g_cm3.sum(), rel=0.01)
