"""Soft edges are told from edges that lie elsewhere, and from what nobody annotated."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter, shift

from xden_builder.audit.sharpness import NONE, Blur, blur_of

SHAPE = (90, 80)
PART = np.zeros(SHAPE, dtype=np.bool_)
PART[20:70, 30:50] = True
VALID = np.ones(SHAPE, dtype=np.bool_)
rows, columns = np.indices(SHAPE)
MODEL = np.where(PART, np.exp(-0.1 - 0.02 * np.abs(columns - 40)), 1.0).astype(np.float32)


def seen(measured: np.ndarray, gain: float = 1.0) -> Blur:
    return blur_of(measured.astype(np.float32), VALID, PART, gain * MODEL, gain)


@given(st.floats(0.4, 1.0), st.floats(0.4, 1.0), st.floats(0.5, 1.5))
def test_a_small_blur_is_measured_along_either_axis_at_any_exposure(
    down: float, across: float, gain: float
) -> None:
    blur = seen(gain * gaussian_filter(MODEL.astype(np.float64), (down, across)), gain)
    assert blur.rows_px == pytest.approx(down, abs=0.2)
    assert blur.columns_px == pytest.approx(across, abs=0.2)


def test_the_same_blur_harms_what_is_thin_more() -> None:
    thin = PART & (np.abs(columns - 40) < 2)
    slender = np.where(thin, 0.7, 1.0).astype(np.float32)
    of_thin = blur_of(gaussian_filter(slender, 0.7), VALID, thin, slender, 1.0)
    assert of_thin.harms
    assert of_thin.share > 1.5 * seen(gaussian_filter(MODEL, 0.7)).share


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_an_image_as_sharp_as_the_model_has_no_blur_whatever_the_noise(noise: float) -> None:
    rng = np.random.default_rng(3)
    blur = seen(MODEL + rng.normal(0, noise, SHAPE))
    assert max(blur.rows_px, blur.columns_px) < 0.3
    assert not blur.harms


@pytest.mark.parametrize("wide_px", [3, 6, 20])
@pytest.mark.parametrize("off_px", [0.25, 0.5, 1.0])
def test_an_object_beside_its_place_is_not_taken_for_a_blurred_one(
    wide_px: int, off_px: float
) -> None:
    assert not seen_beside(wide_px, shift_px=off_px).harms


@pytest.mark.parametrize("wide_px", [2, 6, 20])
@pytest.mark.parametrize("density", [0.7, 1.4])
def test_an_object_of_another_density_is_not_taken_for_a_blurred_one(
    wide_px: int, density: float
) -> None:
    assert not seen_beside(wide_px, density=density).harms


def seen_beside(wide_px: int, *, shift_px: float = 0.0, density: float = 1.0) -> Blur:
    """A rod of a fifth of the light, in noise, that is elsewhere or of another density."""
    rod = PART & (np.abs(columns - 39.5) < wide_px / 2)
    model = np.where(rod, 0.8, 1.0)
    there = shift(model**density, (0, shift_px), order=1, mode="nearest")
    noise = np.random.default_rng(1).normal(0, 0.003, SHAPE)
    return blur_of((there + noise).astype(np.float32), VALID, rod, model.astype(np.float32), 1.0)


def test_a_faint_wire_in_noise_has_no_blur() -> None:
    wire = PART & (columns > 38) & (columns < 41)
    model = np.where(wire, 0.98, 1.0).astype(np.float32)
    for seed in range(20):
        noise = np.random.default_rng(seed).normal(0, 0.01, SHAPE).astype(np.float32)
        assert not blur_of(model + noise, VALID, wire, model, 1.0).harms


def test_content_nobody_annotated_is_not_taken_for_blur() -> None:
    measured = MODEL.copy()
    measured[35:50, 34:44] *= 0.4
    assert not seen(measured).harms


def test_dead_pixels_say_nothing() -> None:
    measured, dead = MODEL.copy(), PART & (rows % 7 == 0)
    measured[dead] = np.nan
    blur = blur_of(measured, ~dead, PART & ~dead, MODEL, 1.0)
    assert blur.share == pytest.approx(0, abs=1e-3)


def test_without_an_object_or_of_one_that_takes_no_light_there_is_none() -> None:
    assert blur_of(MODEL, VALID, PART, np.ones_like(MODEL), 1.0) == NONE
    assert blur_of(MODEL, VALID, np.zeros(SHAPE, dtype=np.bool_), MODEL, 1.0) == NONE
