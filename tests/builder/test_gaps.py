"""Dead pixels and lines are filled in as smoothly as the image goes on, and nothing else is."""

import numpy as np
import pytest

from xden1k.values.views import ViewGeometry, XRayView
from xden_builder.capture.gaps import without_gaps


def seen(image, valid):
    geometry = ViewGeometry(
        beam="cone",
        source_cm=np.array([0.0, -100.0, 0.0]),
        pixel00_cm=np.array([-5.0, 20.0, 5.0]),
        column_step_cm=np.array([0.1, 0.0, 0.0]),
        row_step_cm=np.array([0.0, 0.0, -0.1]),
        shape=image.shape,
    )
    pixels = np.where(valid, image, np.nan).astype(np.float32)
    return XRayView("pa", pixels, valid, geometry)


def slanted():
    rows, columns = np.indices((24, 32))
    return 0.4 + 0.01 * rows + 0.005 * columns


def dead(*places):
    valid = np.ones((24, 32), dtype=np.bool_)
    for place in places:
        valid[place] = False
    return valid


@pytest.mark.parametrize(
    "valid",
    [
        dead((5, 7)),
        dead((slice(None), 9)),
        dead((slice(None), slice(9, 11)), (12, slice(None))),
        dead((slice(0, 2), slice(3, 5)), (23, 31)),
        dead((slice(None), slice(9, 12)), (slice(14, 17), slice(None))),
        dead(tuple(np.random.default_rng(0).integers((24, 32), size=(30, 2)).T)),
    ],
    ids=["pixel", "column", "crossing lines", "at the rims", "wide lines", "many"],
)
def test_what_is_dead_goes_on_as_its_neighbours_do(valid):
    filled = without_gaps(seen(slanted(), valid))
    inner = (slice(3, -3), slice(3, -3))
    assert filled[inner] == pytest.approx(slanted()[inner], abs=1e-3)
    assert filled == pytest.approx(slanted(), abs=0.02)
    assert (filled[valid] == slanted().astype(np.float32)[valid]).all()


def test_what_a_mask_leaves_out_is_not_filled_in_not_even_at_its_corners():
    valid = dead((slice(8, 20), slice(10, 24)), (5, 7))
    filled = without_gaps(seen(slanted(), valid))
    assert np.isnan(filled[8:20, 10:24]).all()
    assert filled[5, 7] == pytest.approx(slanted()[5, 7], abs=1e-3)


def test_a_line_that_runs_into_a_mask_goes_on_as_what_is_beside_it():
    valid = dead((slice(8, 20), slice(10, 24)), (14, slice(None)))
    filled = without_gaps(seen(np.full((24, 32), 1.4), valid))
    assert filled[14, 1:10] == pytest.approx(1.4, abs=1e-6)


def test_an_image_without_gaps_or_with_far_too_many_stays_as_it_is(monkeypatch):
    whole = dead()
    assert (without_gaps(seen(slanted(), whole)) == slanted().astype(np.float32)).all()
    monkeypatch.setattr("xden_builder.capture.gaps.MOST", 3)
    valid = dead((slice(None), 9))
    assert np.isnan(without_gaps(seen(slanted(), valid))[:, 9]).all()
