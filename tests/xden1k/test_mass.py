"""Mass properties against cubes summed one by one, for meshes and for grids alike."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from xden1k.errors import DataError
from xden1k.values.mass import MassProperties, mass_of_grid, mass_of_meshes

ORIGIN = np.array([-1.0, 2.0, 30.0])
VOXEL = 0.5


def cube(centre: np.ndarray | tuple[float, ...], edge: float = VOXEL) -> trimesh.Trimesh:
    return trimesh.creation.box((edge,) * 3).apply_translation(centre)


def cubes_summed(masses: list[float], centres: list[np.ndarray]) -> MassProperties:
    """Cubes of one size, each with the inertia of its own and that of its arm."""
    total = sum(masses)
    com = sum(mass * centre for mass, centre in zip(masses, centres, strict=True)) / total
    tensor = np.zeros((3, 3))
    for mass, centre in zip(masses, centres, strict=True):
        x, y, z = centre - com
        tensor += mass * VOXEL**2 / 6 * np.eye(3)
        tensor += mass * np.array(
            [[y * y + z * z, -x * y, -x * z], [-x * y, x * x + z * z, -y * z], [-x * z, -y * z, 0]]
        )
        tensor[2, 2] += mass * (x * x + y * y)
    return MassProperties(total, com, tensor)


def assert_close(found: MassProperties, wanted: MassProperties) -> None:
    assert found.mass_g == pytest.approx(wanted.mass_g, rel=1e-12)
    np.testing.assert_allclose(found.com_cm, wanted.com_cm, rtol=1e-12)
    np.testing.assert_allclose(found.inertia_g_cm2, wanted.inertia_g_cm2, rtol=1e-9, atol=1e-9)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_grid_and_meshes_of_its_voxels_are_the_sum_of_cubes(seed: int) -> None:
    density = np.random.default_rng(seed).choice([0.0, 0.5, 2.0, 7.0], (2, 3, 4))
    density[1, 0, 2] = 3.0
    places = np.argwhere(density)
    centres = [ORIGIN + VOXEL * place for place in places]
    densities = [float(density[tuple(place)]) for place in places]
    wanted = cubes_summed([each * VOXEL**3 for each in densities], centres)
    assert_close(mass_of_grid(density, ORIGIN, VOXEL), wanted)
    assert_close(mass_of_meshes([cube(centre) for centre in centres], densities), wanted)


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
def test_grids_are_summed_in_double_whatever_they_are_stored_in(dtype: type) -> None:
    few, many = np.full((1, 1, 1), 0.1, dtype), np.full((50, 60, 70), 0.1, dtype)
    whole, one = (mass_of_grid(grid, np.zeros(3), 1.0) for grid in (many, few))
    assert whole.mass_g == pytest.approx(210_000 * one.mass_g, rel=1e-12)
    np.testing.assert_allclose(whole.com_cm, [24.5, 29.5, 34.5], rtol=1e-12)
    sides = np.array([50.0, 60.0, 70.0]) ** 2
    wanted = np.diag(whole.mass_g / 12 * (sides.sum() - sides))
    np.testing.assert_allclose(whole.inertia_g_cm2, wanted, rtol=1e-9, atol=1e-4)


def test_a_mesh_that_integrates_with_a_density_of_its_own_weighs_the_same() -> None:
    plain, heavy = cube((1, 2, 3)), cube((1, 2, 3))
    heavy.density = 5.0
    assert_close(mass_of_meshes([heavy], [2.0]), mass_of_meshes([plain], [2.0]))


def test_a_mesh_wound_inwards_is_a_hole_and_not_left_out() -> None:
    outer, hole = cube((0, 0, 0), 4.0), cube((0.5, 0, 0), 1.0)
    hole.invert()
    found = mass_of_meshes([outer, hole], [3.0, 3.0])
    wanted = mass_of_meshes([trimesh.util.concatenate([outer, hole])], [3.0])
    assert wanted.mass_g == pytest.approx(189)
    assert_close(found, wanted)


def test_meshes_without_volume_weigh_nothing_and_do_not_count() -> None:
    flat = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2], [2, 1, 0]], process=False)
    inwards = cube((5, 0, 0))
    inwards.invert()
    balanced = trimesh.util.concatenate([cube((0, 0, 0)), inwards])
    found = mass_of_meshes([trimesh.Trimesh(), cube((1, 2, 3)), flat, balanced], [9.0] * 4)
    assert_close(found, cubes_summed([9 * VOXEL**3], [np.array([1.0, 2.0, 3.0])]))


@pytest.mark.parametrize(
    "weigh",
    [
        lambda: mass_of_meshes([], []),
        lambda: mass_of_meshes([trimesh.Trimesh()], [9.0]),
        lambda: mass_of_meshes([cube((1, 2, 3))], [0.0]),
        lambda: mass_of_grid(np.zeros((2, 3, 4)), ORIGIN, VOXEL),
    ],
)
def test_nothing_has_no_centre_and_no_inertia(weigh: Callable[[], MassProperties]) -> None:
    nothing = weigh()
    assert nothing.mass_g == 0.0
    assert np.isnan(nothing.com_cm).tolist() == [True] * 3
    np.testing.assert_array_equal(nothing.inertia_g_cm2, np.zeros((3, 3)))


@pytest.mark.parametrize(
    "weigh",
    [
        lambda density: mass_of_meshes([cube((1, 2, 3))], [density]),
        lambda density: mass_of_grid(np.full((2, 3, 4), density), ORIGIN, VOXEL),
    ],
)
def test_a_negative_mass_is_told_not_hidden(weigh: Callable[[float], MassProperties]) -> None:
    plus, minus = weigh(2.0), weigh(-2.0)
    assert minus.mass_g == -plus.mass_g < 0
    np.testing.assert_allclose(minus.com_cm, plus.com_cm)
    np.testing.assert_allclose(minus.inertia_g_cm2, -plus.inertia_g_cm2)


@pytest.mark.parametrize(("meshes", "densities"), [(1, 2), (2, 1)])
def test_as_many_densities_as_meshes_are_wanted(meshes: int, densities: int) -> None:
    with pytest.raises(
        DataError, match=rf"^{meshes} meshes need as many densities, got {densities}$"
    ):
        mass_of_meshes([cube((0, 0, 0))] * meshes, [1.0] * densities)


def test_mass_properties_are_a_frozen_value_that_equals_only_itself() -> None:
    one, other = (mass_of_grid(np.ones((1, 1, 1)), ORIGIN, VOXEL) for _ in range(2))
    assert one != other  # arrays have no one truth to compare by
    assert not hasattr(one, "__dict__")
    with pytest.raises(dataclasses.FrozenInstanceError):
        one.mass_g = 2.0
