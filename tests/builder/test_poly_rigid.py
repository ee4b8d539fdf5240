"""Uncertainty of mass, centre of mass and inertia against draws of densities and sizes."""

from __future__ import annotations

import numpy as np
import pytest

from tests.builder.poly_scenes import box, cylinder
from xden1k.values.mass import mass_of_meshes
from xden_builder.poly.posterior.problem import Mass
from xden_builder.poly.scale import COMMON_SHARE, compare
from xden_builder.reconstruct.rigid import SURFACE_SD_CM, Weighed, rigid_sd

MESHES = [box((2, 3, 4), (-3, 0, 0)), box((1, 1, 5), (2, 1, 0)), cylinder(0.8, 3, (0, -3, 1))]
DENSITY = np.array([0.9, 7.8, 1.2])
SHARE = np.array([0.05, 0.01, 0.08])
TOGETHER = np.array([[1.0, -0.6, 0.2], [-0.6, 1.0, 0.0], [0.2, 0.0, 1.0]])
COVARIANCE = np.outer(SHARE * DENSITY, SHARE * DENSITY) * TOGETHER


def by_size(size_sd, density=DENSITY):
    """How densities that X-rays tell go with the size."""
    return -size_sd * density


def drawn(covariance, scale_sd, count=300):
    """Masses, centres and inertias of bodies whose densities and sizes err."""
    rng = np.random.default_rng(5)
    densities = rng.multivariate_normal(DENSITY, covariance, count)
    bodies = []
    for density, size in zip(densities, rng.normal(1, scale_sd, count), strict=True):
        # what X-rays see is density times length: a mesh too large makes densities too small
        larger = [mesh.copy().apply_scale(size) for mesh in MESHES]
        bodies.append(mass_of_meshes(larger, (density / size).tolist()))
    return bodies


@pytest.mark.parametrize("scale_sd", [0.0, 0.02])
def test_deviations_are_those_of_random_draws(scale_sd):
    bodies = drawn(COVARIANCE, scale_sd)
    together = by_size(scale_sd)
    covariance = COVARIANCE + np.outer(together, together)
    found = rigid_sd(MESHES, DENSITY, covariance, together, scale_sd)
    assert found.mass_g == pytest.approx(np.std([each.mass_g for each in bodies]), rel=0.12)
    inertia = np.std([each.inertia_g_cm2 for each in bodies], axis=0)
    np.testing.assert_allclose(found.inertia_g_cm2.diagonal(), inertia.diagonal(), rtol=0.12)
    if not scale_sd:  # where the frame's origin is, a scale moves the centre: not an error
        com = np.std([each.com_cm for each in bodies], axis=0)
        np.testing.assert_allclose(found.com_cm, np.hypot(com, SURFACE_SD_CM), rtol=0.12)
        np.testing.assert_allclose(found.inertia_g_cm2, inertia, rtol=0.12)


@pytest.mark.parametrize("told_by_images", [True, False])
def test_a_mass_beside_the_scales_is_as_unsure_as_the_bodys(told_by_images):
    together = by_size(0.03, DENSITY * told_by_images)
    covariance = COVARIANCE + np.outer(together, together)
    body = rigid_sd(MESHES, DENSITY, covariance, together, 0.03)
    mass = Mass(100.0, np.array([mesh.volume for mesh in MESHES]))
    beside = compare(mass, DENSITY, covariance, together, 0.03)
    common_g = COMMON_SHARE * beside.by_images_g
    assert beside.by_images_sd_g == pytest.approx(np.hypot(body.mass_g, common_g), rel=1e-6)


def test_densities_that_err_together_move_the_mass_but_not_the_centre():
    together = np.outer(DENSITY, DENSITY) * 0.03**2
    found = rigid_sd(MESHES, DENSITY, together, by_size(0.0), 0.0)
    body = mass_of_meshes(MESHES, DENSITY.tolist())
    assert found.mass_g == pytest.approx(0.03 * body.mass_g)
    np.testing.assert_allclose(found.com_cm, SURFACE_SD_CM)
    np.testing.assert_allclose(found.inertia_g_cm2, 0.03 * np.abs(body.inertia_g_cm2))


def test_one_part_has_a_centre_that_no_density_moves():
    found = rigid_sd(MESHES[:1], DENSITY[:1], COVARIANCE[:1, :1], np.zeros(1), 0.01)
    np.testing.assert_allclose(found.com_cm, SURFACE_SD_CM)
    assert found.mass_g > 0.05 * 0.9 * 24


def test_where_a_body_lies_does_not_matter():
    away = [mesh.copy().apply_translation((30, -20, 10)) for mesh in MESHES]
    here, there = (
        rigid_sd(meshes, DENSITY, COVARIANCE, by_size(0.0), 0.0) for meshes in (MESHES, away)
    )
    assert there.mass_g == pytest.approx(here.mass_g)
    np.testing.assert_allclose(there.com_cm, here.com_cm, rtol=1e-6)
    np.testing.assert_allclose(there.inertia_g_cm2, here.inertia_g_cm2, rtol=1e-6)


def test_a_weighed_mass_bounds_the_deviation_of_the_mass_but_not_of_each_density():
    boxes = [box((1, 1, 1), (0, 0, 0)), box((1, 1, 1), (3, 0, 0))]
    density, covariance = np.array([1.0, 1.0]), np.diag([0.25, 0.25])
    together = by_size(0.005, density)
    covariance += np.outer(together, together)
    free = rigid_sd(boxes, density, covariance, together, 0.005)
    on_scale = Weighed(0.01, np.zeros((2, 2)))
    weighed = rigid_sd(boxes, density, covariance, together, 0.005, on_scale)
    assert free.mass_g > 0.7
    assert weighed.mass_g == pytest.approx(0.01, rel=0.01)
    # what one box has too much the other lacks: the centre is as free as before
    assert weighed.com_cm[0] == pytest.approx(free.com_cm[0], rel=0.01)


def test_what_a_scale_has_narrowed_already_it_does_not_narrow_again():
    boxes = [box((1, 1, 1), (0, 0, 0)), box((1, 1, 1), (3, 0, 0))]
    density, volumes, sd_g = np.array([1.0, 1.0]), np.ones(2), 0.02
    prior = np.diag([0.02**2, 0.03**2])
    fitted = np.linalg.inv(np.linalg.inv(prior) + np.outer(volumes, volumes) / sd_g**2)
    found = rigid_sd(boxes, density, fitted, np.zeros(2), 0.0, Weighed(sd_g, fitted))
    assert found.mass_g == pytest.approx(np.sqrt(volumes @ fitted @ volumes))


def test_a_size_moves_the_mass_thrice_where_labels_tell_densities_and_twice_where_x_rays_do():
    nothing = np.zeros((3, 3))
    mass_g = mass_of_meshes(MESHES, DENSITY.tolist()).mass_g
    by_labels = rigid_sd(MESHES, DENSITY, nothing, np.zeros(3), 0.01)
    together = by_size(0.01)
    by_images = rigid_sd(MESHES, DENSITY, np.outer(together, together), together, 0.01)
    assert by_labels.mass_g == pytest.approx(0.03 * mass_g)
    assert by_images.mass_g == pytest.approx(0.02 * mass_g)
