"""From stored values to transmission: identities, dead and saturated pixels, wrong calibrations."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from xden1k.errors import DataError
from xden1k.values.views import ViewGeometry
from xden_builder.capture.calibration import CalibratedView, calibrate
from xden_builder.capture.saturation import BRIGHTEST, gain_bounds
from xden_builder.capture.scanner import Polarity, ViewFile
from xden_builder.physics.source import Detector

SHAPE = (10, 12)
LARGE = (60, 60)
GEOMETRY = ViewGeometry.from_dict(
    {
        "beam": "parallel",
        "direction": [0, 1, 0],
        "pixel00_cm": [0, 5, 0],
        "column_step_cm": [1, 0, 0],
        "row_step_cm": [0, 0, -1],
        "shape": SHAPE,
    }
)
rng = np.random.default_rng(0)
TRUTH = np.linspace(0.02, 1.0, SHAPE[0] * SHAPE[1]).reshape(SHAPE)
DARK = 100.0 + rng.uniform(0, 5, SHAPE)
FLAT = 30000.0 + rng.uniform(0, 3000, SHAPE)
COUNTS = DARK + TRUTH * (FLAT - DARK)


def from_counts(
    folder: Path,
    counts: np.ndarray,
    flat: np.ndarray | float = FLAT,
    dark: np.ndarray | float | None = DARK,
    polarity: Polarity = "linear",
    bits: int | None = None,
    shape: tuple[int, int] = SHAPE,
) -> CalibratedView:
    np.save(folder / "pa.npy", counts)
    names: dict[str, str | float | None] = {"flat": None, "dark": None}
    for name, level in (("flat", flat), ("dark", dark)):
        names[name] = level if isinstance(level, float) else None
        if isinstance(level, np.ndarray):
            np.save(folder / f"{name}.npy", level)
            names[name] = f"{name}.npy"
    stored = ViewFile("pa.npy", "counts", replace(GEOMETRY, shape=shape), polarity, **names)
    return calibrate("pa", stored, folder, folder, Detector(bits=bits))


@pytest.mark.parametrize("lit", [36, 48, 56])
def test_behind_a_collimator_is_nothing_and_noise_is_that_of_the_lit_field(
    tmp_path: Path, lit: int
) -> None:
    light = np.full(LARGE, 80.0)
    light[:, : int(0.6 * lit)] = 40_000.0
    draw = np.random.default_rng(1)
    dark, flat, counts = (100 + part * light + draw.normal(0, 3, LARGE) for part in (0, 1, 0.9))
    seen = from_counts(tmp_path, counts, flat, dark, shape=LARGE)
    assert seen.flags == ("pa:dead_pixels",)
    np.testing.assert_array_equal(seen.view.valid, light > 1000)
    assert seen.noise_sd < 5 * 3 / 40_000


@pytest.mark.parametrize("mean", [-3.0, 0.0, 1.0])
def test_a_flat_that_was_never_exposed_is_no_open_field(tmp_path: Path, mean: float) -> None:
    draw = np.random.default_rng(2)
    dark, flat, counts = (100 + draw.normal(each, 3, LARGE) for each in (0, mean, 20_000))
    with pytest.raises(DataError, match=r"open field \(flat\) is no brighter than the dark"):
        from_counts(tmp_path, counts, flat, dark, shape=LARGE)


def test_counts_become_the_transmission_they_were_made_from(tmp_path: Path) -> None:
    read = from_counts(tmp_path, COUNTS)
    np.testing.assert_allclose(read.view.transmission, TRUTH, rtol=1e-6)
    assert read.view.valid.all()
    assert read.flags == ()


@given(
    truth=arrays("f8", SHAPE, elements=st.floats(-0.05, 1.3)),
    dark=st.floats(0, 1000),
    light=st.floats(100, 60000),
)
def test_counts_with_single_values_become_transmission(
    tmp_path_factory: pytest.TempPathFactory, truth: np.ndarray, dark: float, light: float
) -> None:
    truth[0], truth[1] = 1.0, 0.5  # some air, some object
    folder = tmp_path_factory.mktemp("counts")
    view = from_counts(folder, dark + truth * light, flat=dark + light, dark=dark).view
    np.testing.assert_allclose(view.transmission[view.valid], truth[view.valid], atol=1e-6)
    assert (truth[~view.valid] > BRIGHTEST).all()


@pytest.mark.parametrize("dark", [DARK, 100.0, None])
def test_turning_all_images_over_changes_nothing(
    tmp_path: Path, dark: np.ndarray | float | None
) -> None:
    level = 0.0 if dark is None else dark
    counts = np.rint(level + TRUTH * (FLAT - level))
    linear = from_counts(tmp_path, counts, FLAT, dark, "linear", bits=16)
    top = 65535.0
    turned = None if dark is None else top - dark
    inverted = from_counts(tmp_path, top - counts, top - FLAT, turned, "inverted", bits=16)
    np.testing.assert_allclose(inverted.view.transmission, linear.view.transmission, rtol=1e-6)
    np.testing.assert_array_equal(inverted.view.valid, linear.view.valid)


@pytest.mark.parametrize("dtype", ["u1", "u2", "f4"])
def test_the_stored_type_does_not_matter(tmp_path: Path, dtype: str) -> None:
    counts = np.arange(120).reshape(SHAPE).astype(dtype)
    read = from_counts(tmp_path, counts, flat=200.0, dark=20.0)
    np.testing.assert_allclose(read.view.transmission, (np.arange(120).reshape(SHAPE) - 20) / 180)


def test_transmission_and_attenuation_say_the_same(tmp_path: Path) -> None:
    noisy = TRUTH + 0.05
    np.save(tmp_path / "t.npy", noisy)
    np.save(tmp_path / "p.npy", -np.log(noisy))
    views = [
        calibrate("pa", ViewFile(image, quantity, GEOMETRY), tmp_path, tmp_path, Detector()).view
        for image, quantity in (("t.npy", "transmission"), ("p.npy", "attenuation"))
    ]
    np.testing.assert_allclose(views[0].transmission, noisy, rtol=1e-6)
    np.testing.assert_allclose(views[1].transmission, noisy, rtol=1e-6)


def test_noise_around_air_and_dark_is_no_error(tmp_path: Path) -> None:
    counts = COUNTS.copy()
    counts[0, :3] = DARK[0, :3] - 5
    counts[1, :3] = FLAT[1, :3] * 1.05
    view = from_counts(tmp_path, counts).view
    assert (view.transmission[0, :3] < 0).all()
    assert (view.transmission[1, :3] > 1).all()
    assert view.valid.all()


def test_pixels_without_open_field_are_not_valid(tmp_path: Path) -> None:
    flat = FLAT.copy()
    flat[2, 3] = DARK[2, 3]  # dead
    flat[4, 5] = DARK[4, 5] - 7  # drifting
    flat[6, 7] = DARK[6, 7] + 30  # behind a collimator
    read = from_counts(tmp_path, COUNTS, flat)
    expected = np.ones(SHAPE, dtype=bool)
    expected[[2, 4, 6], [3, 5, 7]] = False
    np.testing.assert_array_equal(read.view.valid, expected)
    assert np.isnan(read.view.transmission[~expected]).all()
    assert read.flags == ("pa:dead_pixels",)


def test_a_single_dead_pixel_is_masked_without_a_flag(tmp_path: Path) -> None:
    flat = FLAT.copy()
    flat[2, 3] = DARK[2, 3]
    read = from_counts(tmp_path, COUNTS, flat)
    assert not read.view.valid[2, 3]
    assert read.flags == ()


@pytest.mark.parametrize("polarity", ["linear", "inverted"])
def test_saturated_pixels_are_known_from_below_and_flagged(
    tmp_path: Path, polarity: Polarity
) -> None:
    top = 4095.0
    counts = np.full(SHAPE, 2000.0) + np.arange(12)
    counts[0, :4] = top
    flat = np.full(SHAPE, 3600.0)
    flat[5, 5] = top
    dark = np.full(SHAPE, 100.0)
    if polarity == "inverted":
        counts, flat, dark = top - counts, top - flat, top - dark
    read = from_counts(tmp_path, counts, flat, dark, polarity, bits=12)
    assert read.flags == ("pa:saturated", "pa:saturated_flat")
    expected = np.zeros(SHAPE, dtype=bool)
    expected[0, :4] = True
    np.testing.assert_array_equal(~read.view.valid, expected)
    assert read.at_least is not None
    np.testing.assert_allclose(read.at_least[expected], (top - 100) / 3500, rtol=1e-6)
    assert np.isnan(read.at_least[~expected]).all()
    assert from_counts(tmp_path, counts, flat, dark, polarity).view.valid.all()


def test_hot_pixels_and_letters_drawn_into_an_image_are_left_out_as_dead_ones_are(
    tmp_path: Path,
) -> None:
    counts = np.full(LARGE, 30000.0) + np.arange(60)
    counts[20:40, 20:40] = 8000.0
    letter = np.zeros(LARGE, dtype=bool)
    letter[2:8, 2:5] = letter[30, 30] = True
    counts[letter] = 65535.0
    read = from_counts(tmp_path, counts, np.full(LARGE, 31000.0), 0.0, bits=16, shape=LARGE)
    assert read.flags == ()
    assert read.at_least is None
    np.testing.assert_array_equal(~read.view.valid, letter)


def test_a_few_saturated_pixels_do_not_say_that_air_is_saturated(tmp_path: Path) -> None:
    counts = np.full(LARGE, 40000.0) + np.arange(60)
    counts[3, 3:6] = 65535.0
    read = from_counts(tmp_path, counts, np.full(LARGE, 56000.0), 0.0, bits=16, shape=LARGE)
    assert read.at_least is not None
    assert gain_bounds(read.view, read.at_least) is None


def test_air_that_is_saturated_beside_a_large_thin_sheet_is_not_taken_for_faults(
    tmp_path: Path,
) -> None:
    counts = np.full(LARGE, 42000.0) + np.arange(60)
    counts[:, :20] = 65535.0
    read = from_counts(tmp_path, counts, np.full(LARGE, 50000.0), 0.0, bits=16, shape=LARGE)
    assert read.at_least is not None
    assert np.isfinite(read.at_least[:, :20]).all()
    bounds = gain_bounds(read.view, read.at_least)
    assert bounds is not None
    assert bounds[0] == pytest.approx(65535 / 50000)


@pytest.mark.parametrize("bits", [None, 16])
@pytest.mark.parametrize("up", [1, 16])
def test_a_converter_that_ends_below_what_is_told_is_seen_by_what_piles_up(
    tmp_path: Path, bits: int | None, up: int
) -> None:
    """A panel of 12 bits in files of 16, air overexposed: not one pixel reaches 65535."""
    noise = np.random.default_rng(3).normal(0, 60, LARGE)
    light = np.linspace(3000, 5000, 60) + noise
    counts = (up * np.minimum(np.rint(light), 4095)).astype("u2")
    flat = np.full(LARGE, up * 4000.0)
    clipped = from_counts(tmp_path, counts, flat, 0.0, bits=bits, shape=LARGE)
    assert clipped.flags == ("pa:saturated",)
    np.testing.assert_array_equal(~clipped.view.valid, light >= 4094.5)
    below = from_counts(tmp_path, counts - np.uint16(5 * up), flat, 0.0, bits=bits, shape=LARGE)
    assert below.view.valid.all()


def test_air_that_reaches_where_a_converter_would_end_is_not_saturated(tmp_path: Path) -> None:
    """As many pixels hold the values beside it: noise, which piles nothing up."""
    light = np.rint(np.random.default_rng(3).normal(4095, 2, (100, 100)))
    light[light > 4095] = 4090
    assert (light == 4095).sum() > 1000
    read = from_counts(
        tmp_path, light.astype("u2"), np.full((100, 100), 4000.0), 0.0, shape=(100, 100)
    )
    assert read.view.valid.all()


def test_a_flat_that_is_a_number_is_not_called_saturated(tmp_path: Path) -> None:
    counts = np.random.default_rng(3).normal(3000, 60, LARGE)
    assert from_counts(tmp_path, counts, 4095.0, 0.0, shape=LARGE).flags == ()


@pytest.mark.parametrize("frames", [1, 64])
def test_a_dark_image_brighter_than_what_lies_behind_lead_is_told(
    tmp_path: Path, frames: int
) -> None:
    """However little noise the dark has: a mean of frames has less than the object's image."""
    rng = np.random.default_rng(4)
    counts, flat = np.full(LARGE, 20000.0), np.full(LARGE, 30000.0)
    dark = 300.0 + rng.normal(0, 80 / np.sqrt(frames), LARGE)
    counts[20:40, 20:40] = 300.0 + rng.normal(0, 80, (20, 20))
    assert from_counts(tmp_path, counts, flat, dark, shape=LARGE).flags == ()
    told = from_counts(tmp_path, counts, flat, dark + 500, shape=LARGE)
    assert told.flags == ("pa:dark_too_bright",)
    few = np.where(np.arange(LARGE[1]) == 3, 0.0, 20000.0) * np.ones(LARGE)
    assert from_counts(tmp_path, few, flat, dark + 500, shape=LARGE).flags == ()


def test_an_image_is_read_however_much_of_it_is_saturated_but_not_all(tmp_path: Path) -> None:
    counts = np.full(SHAPE, 65535.0)
    counts[4:6, 4:6] = 20000.0
    read = from_counts(tmp_path, counts, 2 * FLAT, bits=16)
    assert read.view.valid.sum() == 4
    dead = 2 * FLAT
    dead[4:6, 4:6] = DARK[4:6, 4:6]
    with pytest.raises(DataError, match=r"pa\.npy: the image is saturated: 97% of its pixels"):
        from_counts(tmp_path, counts, dead, bits=16)


def test_noise_is_the_spread_of_the_dark_over_the_open_field(tmp_path: Path) -> None:
    shading = np.linspace(0, 50, SHAPE[1])
    dark = 100 + shading + np.random.default_rng(5).normal(0, 20, SHAPE)
    read = from_counts(tmp_path, COUNTS, dark=dark)
    assert read.noise_sd == pytest.approx(20 / 31500, rel=0.3)


def test_noise_of_a_constant_dark_is_the_rounding_of_integers(tmp_path: Path) -> None:
    counts, dark = COUNTS.astype("u2"), np.full(SHAPE, 100.0)
    open_field = np.median(FLAT - 100)
    noise_sd = from_counts(tmp_path, counts, dark=dark).noise_sd
    assert noise_sd == pytest.approx(12**-0.5 / open_field, rel=1e-6)


def test_without_a_dark_image_the_noise_is_not_known(tmp_path: Path) -> None:
    assert from_counts(tmp_path, COUNTS, dark=100.0).noise_sd is None
    assert from_counts(tmp_path, COUNTS, dark=None).noise_sd is None


nan_flat = np.where(np.arange(SHAPE[1]) == 3, np.nan, FLAT)


@pytest.mark.parametrize(
    ("counts", "changes", "message"),
    [
        (np.zeros(SHAPE), {}, r"pa\.npy: the image is empty or saturated: every pixel holds 0$"),
        (DARK + 1e-9 * COUNTS, {}, r"pa\.npy: the image is empty: its brightest transmission is"),
        (
            1e-4 * COUNTS / COUNTS.max(),
            {},
            r"pa\.npy: expected counts like those of the flat, .*quantity as transmission",
        ),
        (COUNTS, {"bits": 12}, r"pa\.npy: 12 bits hold 0 to 4095, but the pixels are"),
        (
            COUNTS[:9],
            {},
            r"pa\.npy: expected 10 x 12 pixels \(shape in scanner\.toml\), got 9 x 12",
        ),
        (COUNTS, {"flat": FLAT.T}, r"flat\.npy: expected 10 x 12 pixels .*, got 12 x 10"),
        (COUNTS, {"flat": nan_flat}, r"flat\.npy: 10 pixels are not finite, first at \(0, 3\)"),
        (
            COUNTS,
            {"flat": 50.0},
            r"polarity is linear, but most of the open field .* no bright",
        ),
        (
            COUNTS,
            {"polarity": "inverted"},
            r"polarity is inverted, but most of the open field",
        ),
        (
            COUNTS,
            {"polarity": "inverted", "dark": None},
            r"inverted counts need dark, dark_value or",
        ),
        (COUNTS, {"flat": 800.0}, r"the median transmission is 23.*, but air is about 1: expected"),
    ],
)
def test_what_is_no_radiograph_is_refused(
    tmp_path: Path, counts: np.ndarray, changes: dict[str, object], message: str
) -> None:
    with pytest.raises(DataError, match=message):
        from_counts(tmp_path, counts, **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("quantity", "pixels", "message"),
    [
        (
            "transmission",
            COUNTS.astype("u2"),
            "transmission needs floating-point pixels, got uint1",
        ),
        ("attenuation", COUNTS.astype("u2"), "attenuation needs floating-point pixels, got uint16"),
        ("transmission", COUNTS, "median transmission is .* views.pa"),
        ("attenuation", -COUNTS, "median transmission is inf"),
        ("attenuation", COUNTS, "the image is empty: its brightest transmission is"),
        ("transmission", np.ones(SHAPE), "every pixel holds 1"),
    ],
)
def test_counts_are_not_taken_for_another_quantity(
    tmp_path: Path, quantity: str, pixels: np.ndarray, message: str
) -> None:
    np.save(tmp_path / "pa.npy", pixels)
    stored = ViewFile("pa.npy", quantity, GEOMETRY)  # type: ignore[arg-type]
    with pytest.raises(DataError, match=message):
        calibrate("pa", stored, tmp_path, tmp_path, Detector())


def test_a_missing_flat_is_named(tmp_path: Path) -> None:
    np.save(tmp_path / "pa.npy", COUNTS)
    stored = ViewFile("pa.npy", "counts", GEOMETRY, "linear", flat="open.tif")
    with pytest.raises(DataError, match=r"open\.tif: no such image"):
        calibrate("pa", stored, tmp_path, tmp_path, Detector())
