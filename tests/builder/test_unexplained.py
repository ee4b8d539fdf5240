"""Content and shadow that the parts do not account for are seen, placed and weighed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from xden1k.values.views import ViewGeometry, XRayView
from xden_builder.audit.unexplained import WATER_CM2_G, Unexplained, unexplained

SHAPE = (80, 80)
PIXEL_CM = 0.1
NEAR_SOURCE = ViewGeometry.from_dict(
    {
        "beam": "cone",
        "source_cm": [0, -100, 0],
        "pixel00_cm": [-4, 100, 4],  # the object stands half way: twice as large in the image
        "column_step_cm": [PIXEL_CM, 0, 0],
        "row_step_cm": [0, 0, -PIXEL_CM],
        "shape": list(SHAPE),
    }
)
FAR_SOURCE = ViewGeometry.from_dict(
    {
        "beam": "parallel",
        "direction": [0, 1, 0],
        "pixel00_cm": [-4, 10, 4],
        "column_step_cm": [PIXEL_CM, 0, 0],
        "row_step_cm": [0, 0, -PIXEL_CM],
        "shape": list(SHAPE),
    }
)
PART = np.zeros(SHAPE, dtype=np.bool_)
PART[20:60, 10:50] = True
MODEL = np.where(PART, 0.5, 1.0).astype(np.float32)


def looked_at(
    box: tuple[slice, slice], factor: float, geometry: ViewGeometry = FAR_SOURCE, noise: float = 0.0
) -> Unexplained:
    """A model image whose measured one is darker by a factor in a box."""
    measured = MODEL + np.random.default_rng(0).normal(0, noise, SHAPE).astype(np.float32)
    measured[box] *= factor
    view = XRayView("pa", measured.clip(1e-3), np.ones(SHAPE, dtype=np.bool_), geometry)
    return unexplained(view, PART, ~PART, MODEL, 1.0, noise)


NOWHERE = (slice(0, 0), slice(0, 0))
INSIDE = (slice(30, 46), slice(20, 36))
BESIDE = (slice(10, 22), slice(60, 72))


def test_without_an_object_nothing_is_content() -> None:
    nothing = np.zeros(SHAPE, dtype=np.bool_)
    view = XRayView("pa", np.ones_like(MODEL), ~nothing, FAR_SOURCE)
    left = unexplained(view, nothing, ~nothing, np.ones_like(MODEL), 1.0, 0.0)
    assert left == Unexplained(0.0, 0.0, None, 0.0, 0.0, None, 0.0)


def test_content_is_the_same_however_much_air_there_is_around_it() -> None:
    """Only what is near the object is looked at."""
    rng = np.random.default_rng(0)
    measured = (MODEL * rng.normal(1, 0.1, SHAPE)).clip(1e-3).astype(np.float32)
    found = []
    for cut in (np.s_[:, :], np.s_[12:68, 2:58]):
        geometry = replace(FAR_SOURCE, shape=PART[cut].shape)
        view = XRayView("pa", measured[cut], np.ones_like(PART[cut]), geometry)
        found.append(unexplained(view, PART[cut], ~PART[cut], MODEL[cut], 1.0, 0.0))
    assert found[0].content_share == found[1].content_share > 0
    assert found[0].content_g == pytest.approx(found[1].content_g)


def test_an_image_as_the_model_says_leaves_nothing_whatever_the_noise() -> None:
    for noise in (0.0, 0.01, 0.05):
        left = looked_at(NOWHERE, 1.0, noise=noise)
        assert not left.content
        assert not left.shadow
    assert looked_at(NOWHERE, 1.0) == Unexplained(0.0, 0.0, None, 0.0, 0.0, None, 0.0)


@pytest.mark.parametrize(("geometry", "magnified"), [(FAR_SOURCE, 1.0), (NEAR_SOURCE, 2.0)])
def test_a_core_nobody_annotated_is_weighed_as_water_where_the_object_is(
    geometry: ViewGeometry, magnified: float
) -> None:
    left = looked_at(INSIDE, np.exp(-WATER_CM2_G), geometry)  # a centimetre of water
    assert left.content
    assert not left.shadow
    assert left.content_g == pytest.approx((16 * PIXEL_CM / magnified) ** 2, rel=0.1)
    assert np.abs(np.subtract(left.content_box, (30, 20, 45, 35))).max() <= 2


@pytest.mark.parametrize(("factor", "told"), [(0.04, True), (0.2, False), (2.0, False)])
def test_a_weight_of_few_pixels_is_content_where_it_takes_much_of_the_light(
    factor: float, told: bool
) -> None:
    left = looked_at((slice(30, 34), slice(20, 25)), factor)
    assert 0 < left.content_share < 0.05
    share = -np.log(factor) * 20 / (np.log(2) * PART.sum())
    assert left.content_darkening == pytest.approx(share, rel=0.15)
    assert left.content == told


def test_metal_that_lets_hardly_any_light_through_is_no_content_by_stray_light() -> None:
    model, measured = MODEL.copy(), MODEL.copy()
    model[30:36, 20:26], measured[30:36, 20:26] = 0.02, 0.005
    view = XRayView("pa", measured, np.ones(SHAPE, dtype=np.bool_), FAR_SOURCE)
    left = unexplained(view, PART, ~PART, model, 1.0, 0.0)
    assert left.content_darkening == 0


def test_a_rim_of_few_pixels_is_a_mesh_that_is_off_and_no_content() -> None:
    left = looked_at((slice(30, 50), slice(49, 50)), 0.01)
    assert left.content_share < 0.05
    assert not left.content


def test_a_hollow_drawn_full_is_content_of_negative_mass() -> None:
    left = looked_at(INSIDE, 1.5)
    assert left.content
    assert left.content_g < 0


def test_a_part_nobody_drew_is_a_shadow_of_its_mass() -> None:
    left = looked_at(BESIDE, np.exp(-WATER_CM2_G))
    assert left.shadow
    assert not left.content
    assert left.shadow_g == pytest.approx((12 * PIXEL_CM) ** 2, rel=0.1)
    assert np.abs(np.subtract(left.shadow_box, (10, 60, 21, 71))).max() <= 1


def test_a_band_along_the_outline_is_a_pose_that_is_off_and_no_part() -> None:
    assert not looked_at((slice(20, 60), slice(50, 52)), 0.7).shadow


def test_pixels_that_were_not_measured_tell_nothing() -> None:
    measured, valid = MODEL.copy(), np.ones(SHAPE, dtype=np.bool_)
    for box in (INSIDE, BESIDE):
        measured[box], valid[box] = np.nan, False
    left = unexplained(
        XRayView("pa", measured, valid, FAR_SOURCE), PART & valid, ~PART & valid, MODEL, 1.0, 0.0
    )
    assert left == Unexplained(0.0, 0.0, None, 0.0, 0.0, None, 0.0)
