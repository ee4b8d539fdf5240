"""NeRF2Physics style: the surface cloud, the kernel, both volume rules."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from xden_baselines.chat.candidates import Candidate
from xden_baselines.nerf2physics.kernel import TEMPERATURE, mixture
from xden_baselines.nerf2physics.surface import CELL, SurfaceCloud, surface_cloud
from xden_baselines.nerf2physics.volume import (
    MASS_FACTOR,
    carved_mass_g,
    density_field,
    shell_mass_g,
)

RADIUS_CM = 2.0
STEEL = Candidate("steel", density_g_cm3=(7.5, 8.1), thickness_cm=(0.04, 0.06))
WOOD = Candidate("wood", density_g_cm3=(0.5, 0.7), thickness_cm=(1.0, 2.0))
AREA_CM2 = 4 * np.pi * RADIUS_CM**2
VOLUME_CM3 = AREA_CM2 * RADIUS_CM / 3


@pytest.fixture(scope="module")
def sphere() -> SurfaceCloud:
    return surface_cloud(trimesh.creation.icosphere(subdivisions=5, radius=RADIUS_CM), seed=0)


def ball(size: int = 64) -> tuple[np.ndarray, np.ndarray, float]:
    """Envelope, origin and voxel size of the sphere, by eight points a voxel and axis."""
    voxel = 2.12 * RADIUS_CM / size
    fine = (np.arange(8 * size) + 0.5) * voxel / 8 - 1.06 * RADIUS_CM
    squares = fine**2
    inside = squares[:, None, None] + squares[:, None] + squares <= RADIUS_CM**2
    envelope = inside.reshape(size, 8, size, 8, size, 8).mean(axis=(1, 3, 5), dtype=np.float32)
    return envelope, np.full(3, voxel / 2 - 1.06 * RADIUS_CM), voxel


BALL = ball(32)


def field(cloud: SurfaceCloud, shares: np.ndarray, rule: str, *what: Candidate) -> np.ndarray:
    envelope, origin, voxel = BALL
    return density_field(
        cloud, shares, what, rule=rule, envelope=envelope, origin_cm=origin, voxel_size_cm=voxel
    )


def only(cloud: SurfaceCloud) -> np.ndarray:
    return np.ones((len(cloud), 1))


def test_the_cloud_lies_on_the_surface_and_stands_for_all_of_it(sphere: SurfaceCloud) -> None:
    radii = np.linalg.norm(sphere.points_cm, axis=1)
    np.testing.assert_allclose(radii, RADIUS_CM, rtol=1e-3)
    np.testing.assert_allclose(sphere.normals, sphere.points_cm / RADIUS_CM, atol=0.03)
    assert sphere.areas_cm2.sum() == pytest.approx(AREA_CM2, rel=2e-3)
    assert sphere.cell_cm == pytest.approx(CELL * 2 * RADIUS_CM)


def test_no_cell_keeps_two_points(sphere: SurfaceCloud) -> None:
    low = -RADIUS_CM
    cells = np.floor((sphere.points_cm - low) / sphere.cell_cm)
    assert len(np.unique(cells, axis=0)) == len(sphere)
    # a sphere crosses 1.5 cells for each squared edge of its area: fewer than were drawn
    assert 20_000 < len(sphere) < 1.55 * AREA_CM2 / sphere.cell_cm**2


def test_areas_weigh_all_directions_alike(sphere: SurfaceCloud) -> None:
    """A cell count would weigh the slanted faces of a sphere more than the level ones."""
    tilt = np.abs(sphere.normals).max(axis=1)
    share = sphere.areas_cm2[tilt > 0.9].sum() / sphere.areas_cm2.sum()
    assert share == pytest.approx(6 * (1 - 0.9) / 2, rel=0.03)  # six caps of height 0.1


def test_leaving_points_out_keeps_the_area(sphere: SurfaceCloud) -> None:
    half = sphere.take(sphere.points_cm[:, 0] > 0)
    assert len(half) < 0.6 * len(sphere)
    assert half.areas_cm2.sum() == pytest.approx(sphere.areas_cm2.sum())


@given(
    one=st.floats(-1, 1),
    other=st.floats(-1, 1),
    temperature=st.floats(0.02, 2),
    by=st.floats(-1, 1),
)
def test_two_materials_mix_in_closed_form(
    one: float, other: float, temperature: float, by: float
) -> None:
    found = mixture(np.array([[one, other], [one + by, other + by]], np.float32), temperature)
    expected = 1 / (1 + np.exp((np.float32(other) - np.float32(one)) / temperature))
    np.testing.assert_allclose(found[0], [expected, 1 - expected], atol=1e-6)
    np.testing.assert_allclose(found[1], found[0], atol=1e-4)


def test_a_cold_kernel_takes_the_most_similar_alone() -> None:
    similarity = np.random.default_rng(0).uniform(-1, 1, (50, 5)).astype(np.float32)
    found = mixture(similarity, 1e-6)
    np.testing.assert_allclose(found.max(axis=1), 1)
    np.testing.assert_array_equal(found.argmax(axis=1), similarity.argmax(axis=1))
    assert TEMPERATURE == 0.1


def test_a_solid_is_its_mixture_everywhere(sphere: SurfaceCloud) -> None:
    shares = np.tile([0.25, 0.75], (len(sphere), 1))
    found = field(sphere, shares, "solid", STEEL, WOOD)
    np.testing.assert_allclose(found, (0.25 * 7.8 + 0.75 * 0.6) * BALL[0], rtol=1e-5)
    mass = found.sum() * BALL[2] ** 3
    assert carved_mass_g(found, BALL[2]) == pytest.approx(MASS_FACTOR * mass, rel=1e-5)


def test_a_voxel_takes_its_nearest_point(sphere: SurfaceCloud) -> None:
    right = sphere.points_cm[:, 0] > 0
    shares = np.stack([right, ~right], axis=1).astype(np.float64)
    found = field(sphere, shares, "solid", STEEL, WOOD)
    inside = BALL[0] == 1
    np.testing.assert_allclose(found[16:][inside[16:]], 7.8, rtol=1e-5)
    np.testing.assert_allclose(found[:16][inside[:16]], 0.6, rtol=1e-5)


@pytest.mark.parametrize(
    "thickness", [0.05, *(pytest.param(one, marks=pytest.mark.slow) for one in (0.2, 0.7))]
)
def test_a_shell_is_filled_to_its_thickness_whatever_the_voxels(
    sphere: SurfaceCloud, thickness: float
) -> None:
    """From less than half a voxel, of 0.13 cm, to five."""
    glass = Candidate("glass", density_g_cm3=(2.5, 2.5), thickness_cm=(thickness, thickness))
    found = field(sphere, only(sphere), "thickness", glass)
    exact = 2.5 * 4 / 3 * np.pi * (RADIUS_CM**3 - (RADIUS_CM - thickness) ** 3)
    assert found.sum(dtype=np.float64) * BALL[2] ** 3 == pytest.approx(exact, rel=0.04)
    assert found[16, 16, 16] == 0
    assert (found <= 2.5 * BALL[0] + 1e-6).all()


def test_a_shell_thicker_than_the_object_fills_it(sphere: SurfaceCloud) -> None:
    clay = Candidate("clay", density_g_cm3=(2.0, 2.0), thickness_cm=(9.0, 9.0))
    shell = field(sphere, only(sphere), "thickness", clay)
    deep = BALL[0] == 1
    np.testing.assert_allclose(shell[deep], 2.0)
    assert shell.sum() == pytest.approx(2.0 * BALL[0].sum(), rel=0.02)


def test_the_native_mass_of_a_thin_sphere_is_area_times_thickness(sphere: SurfaceCloud) -> None:
    found = shell_mass_g(sphere, only(sphere), [STEEL], volume_cm3=VOLUME_CM3)
    # low with low and high with high: (7.5 * 0.04 + 8.1 * 0.06) / 2
    exact = 4 * np.pi * RADIUS_CM**2 * 0.393 * 0.6
    assert found == pytest.approx(exact, rel=0.02)


def test_the_native_mass_is_capped_by_the_volume(sphere: SurfaceCloud) -> None:
    thick = Candidate("thick", density_g_cm3=(3.0, 3.0), thickness_cm=(5.0, 5.0))
    found = shell_mass_g(sphere, only(sphere), [thick], volume_cm3=VOLUME_CM3)
    assert found == pytest.approx(0.6 * 3.0 * VOLUME_CM3)
    # the upper end, 1 cm thick, is twice the volume: the lower one shrinks by the same half
    area = float(sphere.areas_cm2.sum())
    wide = Candidate("wide", density_g_cm3=(1.0, 1.0), thickness_cm=(0.2, 1.0))
    found = shell_mass_g(sphere, only(sphere), [wide], volume_cm3=area / 2)
    assert found == pytest.approx(0.6 * area / 2 * (0.2 + 1.0) / 2)
