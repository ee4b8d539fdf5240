"""The simulated scanner against formulas: attenuation, quantum statistics, calibration."""

from __future__ import annotations

from dataclasses import replace
from math import exp

import numpy as np
import pytest
import trimesh

from xden1k.errors import DataError
from xden_builder.phantoms import Phantom, PhantomPart, Plan, Scanner, make_phantom
from xden_builder.phantoms.scanner import VIEWS, scanner_file
from xden_builder.physics.attenuation import mac_cm2_g

WATER = (("H2O", 1.0),)


def water_box(*size_cm: float) -> Phantom:
    part = PhantomPart(
        "block", "body", trimesh.creation.box(size_cm), "water", 1.0, (0.5, 0.5, 0.5)
    )
    return Phantom(Plan(0, 0, 0), (part,))


def test_views_look_along_y_and_x_with_z_up() -> None:
    scanner = Scanner(size_px=64)
    pa, lat = (scanner.geometry(view) for view in VIEWS)
    assert pa.source_cm.tolist() == [0.0, -100.0, 0.0]
    assert lat.source_cm.tolist() == [-100.0, 0.0, 0.0]
    for geometry in (pa, lat):
        (centre,) = geometry.project(np.zeros((1, 3)))
        np.testing.assert_allclose(centre[:2], 31.5)  # the axis meets the panel's middle
        (high,) = geometry.project(np.array([[0.0, 0.0, 1.0]]))
        np.testing.assert_allclose(high[1] - 31.5, -1.2 * 64 / 43)  # up is up, 1.2 times as large
    assert pa.project(np.array([[1.0, 0.0, 0.0]]))[0, 0] > 31.5
    assert lat.project(np.array([[0.0, 1.0, 0.0]]))[0, 0] < 31.5
    np.testing.assert_allclose(pa.pixel_centres_cm(np.array([31.5]), np.array([31.5]))[0, 1], 20.0)


def test_no_zero_has_a_sign_in_the_scanner_file() -> None:
    for view in scanner_file(Scanner()).views.values():
        for key in ("source_cm", "pixel00_cm", "column_step_cm", "row_step_cm"):
            vector = getattr(view.geometry, key)
            assert not np.signbit(vector[vector == 0]).any()


def test_ideal_image_of_a_block_is_the_analytic_transmission() -> None:
    scanner = Scanner(size_px=65, subrays=1).ideal()
    phantom = water_box(8.0, 5.0, 6.0)
    image = scanner.radiograph(phantom, "pa")
    mac = float(mac_cm2_g(WATER, 100.0))
    geometry = scanner.geometry("pa")
    for row, column in ((32, 32), (28, 37), (36, 27)):  # rays through front and back face
        (ray,) = geometry.pixel_centres_cm(np.array([float(row)]), np.array([float(column)]))
        ray = ray - geometry.source_cm
        assert image[row, column] == pytest.approx(exp(-mac * 5.0 * np.linalg.norm(ray) / ray[1]))
    assert image[0, 0] == 1.0


def test_pixel_averages_intensity_over_its_area() -> None:
    scanner = Scanner(size_px=32).ideal()
    phantom = water_box(6.0, 6.0, 6.0)
    coarse = scanner.radiograph(phantom, "lat")
    fine = replace(scanner, size_px=32 * 6, subrays=1).radiograph(phantom, "lat")
    np.testing.assert_allclose(
        coarse, fine.reshape(32, 6, 32, 6).mean(axis=(1, 3)), rtol=1e-6, atol=1e-7
    )


def test_ideal_scanner_has_no_error_and_needs_no_calibration() -> None:
    scanner = Scanner(size_px=48).ideal()
    phantom = make_phantom(Plan.of(0, "mug-0000"))
    image = scanner.radiograph(phantom, "pa")
    assert image.dtype == np.float32
    assert scanner.calibration(0, "pa") is None
    np.testing.assert_array_equal(image, scanner.transmission(phantom, "pa"))
    np.testing.assert_array_equal(image, scanner.corrected(phantom, "pa").transmission)


def test_noise_has_the_moments_of_poisson_and_readout() -> None:
    scanner = Scanner(size_px=256, open_counts=4000.0, readout_sd_counts=9.0)
    phantom = water_box(20.0, 8.0, 20.0)
    raw = scanner.radiograph(phantom, "pa").astype(np.float64) - scanner.dark_counts
    share = scanner.exposure(phantom.plan, "pa") * scanner.transmission(phantom, "pa")
    photons = 4000.0 * share.astype(np.float64)
    inside, air = share < 0.3, share > 0.9
    assert inside.sum() > 8_000
    assert air.sum() > 20_000
    for where in (inside, air):
        residual = (raw - photons)[where]
        expected = photons[where] + 81.0 + 1 / 12
        scaled = residual / np.sqrt(expected)
        assert abs(scaled.mean()) < 4 / np.sqrt(where.sum())
        assert scaled.var() == pytest.approx(1.0, abs=5 * np.sqrt(2 / where.sum()))


def test_flat_averages_its_frames_and_dark_is_one() -> None:
    scanner = Scanner(size_px=256, flat_frames=25, readout_sd_counts=20.0)
    panel = scanner.calibration(3, "lat")
    assert panel is not None
    flat, dark = panel.flat.astype(np.float64), panel.dark.astype(np.float64)
    assert flat.mean() == pytest.approx(50_100.0, rel=1e-4)
    assert flat.var() == pytest.approx((50_000 + 400) / 25 + 1 / 12, rel=0.03)
    assert dark.mean() == pytest.approx(100.0, abs=0.5)
    assert dark.var() == pytest.approx(400 + 1 / 12, rel=0.03)
    other = scanner.calibration(3, "pa")
    assert other is not None
    assert (other.flat != panel.flat).any()


def test_exposure_errs_by_a_few_percent_and_can_be_switched_off() -> None:
    plans = [Plan(0, 0, number) for number in range(400)]
    gains = np.array([Scanner().exposure(plan, "pa") for plan in plans])
    assert gains.std() == pytest.approx(0.03, rel=0.15)
    assert abs(np.log(gains).mean()) < 0.006
    assert {Scanner(exposure_sd=0.0).exposure(plan, "pa") for plan in plans} == {1.0}


def test_corrected_view_is_transmission_times_exposure_within_noise() -> None:
    scanner, phantom = Scanner(size_px=128), water_box(10.0, 10.0, 10.0)
    view = scanner.corrected(phantom, "lat")
    share = scanner.exposure(phantom.plan, "lat") * scanner.transmission(phantom, "lat")
    assert view.valid.all()
    error = (view.transmission - share) / np.sqrt(share / 50_000 + 2e-8 + share**2 / 3.2e6)
    assert abs(error.mean()) < 0.05
    assert error.std() == pytest.approx(1.0, abs=0.03)


def test_saturated_pixels_are_at_the_end_of_the_range_and_not_valid() -> None:
    scanner = Scanner(size_px=64, exposure_sd=0.0, bits=12, open_counts=3990.0)
    raw = scanner.radiograph(water_box(5.0, 5.0, 5.0), "pa")
    assert raw.max() == 4095
    view = scanner.corrected(water_box(5.0, 5.0, 5.0), "pa")
    np.testing.assert_array_equal(~view.valid & (raw == 4095), raw == 4095)
    assert view.valid[32, 32]


def test_attenuation_is_density_times_coefficient_at_the_scanners_energy() -> None:
    whole = water_box(1.0, 1.0, 1.0)
    light = replace(whole, parts=(replace(whole.parts[0], density_g_cm3=0.5),))
    assert Scanner().lac_per_cm(light)[0] == pytest.approx(0.5 * 0.1707, rel=1e-3)
    assert Scanner(energy_kev=60.0).lac_per_cm(light)[0] == pytest.approx(0.5 * 0.2059, rel=2e-3)


def test_object_larger_than_the_panel_is_refused() -> None:
    with pytest.raises(DataError, match="screwdriver-0000 reaches beyond the panel of view pa"):
        Scanner(size_px=32).radiograph(water_box(40.0, 1.0, 1.0), "pa")


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ({"size_px": 0}, "at least 1 pixel a side, got 0"),
        ({"source_object_cm": 130.0}, "panel must stand behind the object"),
        ({"open_counts": 70_000.0}, "70000 counts do not fit a 16-bit converter"),
    ],
)
def test_impossible_scanner_is_refused(fault: dict[str, float], message: str) -> None:
    with pytest.raises(DataError, match=message):
        replace(Scanner(), **fault)
