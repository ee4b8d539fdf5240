"""What the values can do beyond holding figures: resample, slice, convert, show themselves."""

from __future__ import annotations

from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

import xden1k
from tests import phantoms
from xden1k.errors import DataError, MissingExtraError, MissingObjectError
from xden1k.folder import write_folder
from xden1k.values.types import DensityField, DensityObject


@st.composite
def fields(draw: st.DrawFn) -> DensityField:
    noise = np.random.default_rng(draw(st.integers(0, 2**32)))
    shape = draw(st.tuples(*[st.integers(1, 9)] * 3))
    values = noise.random(shape) * (noise.random(shape) < 0.5)
    return DensityField(values, noise.normal(size=3), draw(st.floats(0.05, 3)))


@settings(deadline=None, max_examples=60)
@given(fields(), st.floats(0.3, 7))
def test_resampling_keeps_the_mass_and_the_corner(field: DensityField, ratio: float) -> None:
    size = ratio * field.voxel_size_cm
    other = field.resampled(size)
    assert other.mass_g == pytest.approx(field.mass_g, rel=1e-6, abs=1e-12)
    np.testing.assert_allclose(
        other.origin_cm - size / 2, field.origin_cm - field.voxel_size_cm / 2, atol=1e-9
    )
    covered = size * np.array(other.density_g_cm3.shape)
    assert (covered >= field.voxel_size_cm * np.array(field.density_g_cm3.shape) - 1e-6).all()
    if field.mass_g > 0:
        assert np.abs(other.com_cm - field.com_cm).max() <= size / 2 + 1e-9


@settings(deadline=None, max_examples=30)
@given(fields(), st.integers(1, 4))
def test_whole_parts_of_voxels_hold_what_the_voxel_held(field: DensityField, count: int) -> None:
    fine = field.resampled(field.voxel_size_cm / count)
    repeated = field.density_g_cm3
    for axis in range(3):
        repeated = repeated.repeat(count, axis)
    np.testing.assert_allclose(fine.density_g_cm3, repeated, atol=1e-9)
    back = fine.resampled(field.voxel_size_cm)
    np.testing.assert_allclose(back.density_g_cm3, field.density_g_cm3, atol=1e-9)


@pytest.mark.parametrize(
    ("size", "message"),
    [(0.0, "must be positive"), (float("nan"), "must be positive"), (1e-6, "more than 1024")],
)
def test_a_voxel_size_that_cannot_be_meant_is_refused(size: float, message: str) -> None:
    with pytest.raises(DataError, match=message):
        WATER.resampled(size)


def test_a_slice_holds_the_voxels_at_its_place() -> None:
    field = DensityField(np.random.default_rng(0).random((3, 4, 5)), np.array([1.0, 2, 3]), 0.5)
    np.testing.assert_array_equal(field.sliced("x", 1.6), field.density_g_cm3[1])
    np.testing.assert_array_equal(field.sliced("z", 3 + 4.49 * 0.5), field.density_g_cm3[:, :, 4])
    middle = round((field.com_cm[1] - 2) / 0.5)
    np.testing.assert_array_equal(field.sliced("y"), field.density_g_cm3[:, middle])
    with pytest.raises(DataError, match=r"x = 0\.7 cm is outside the grid, 0\.75 to 2\.25 cm"):
        field.sliced("x", 0.7)
    with pytest.raises(DataError, match="nothing has mass"):
        replace(field, density_g_cm3=np.zeros((2, 2, 2))).sliced("x")


def test_a_tensor_is_a_copy() -> None:
    tensor = WATER.to_torch()
    assert (tensor.dtype, tuple(tensor.shape)) == (torch.float32, (4, 5, 6))
    tensor += 1
    assert WATER.density_g_cm3.max() == 1


def test_a_nifti_image_is_in_millimetres(tmp_path: Path) -> None:
    nibabel = pytest.importorskip("nibabel")
    nibabel.save(WATER.to_nibabel(), tmp_path / "water.nii.gz")
    image = nibabel.load(tmp_path / "water.nii.gz")
    np.testing.assert_array_equal(image.get_fdata(), WATER.density_g_cm3)
    assert image.header.get_xyzt_units()[0] == "mm"
    assert (image.affine @ [1, 2, 3, 1]).tolist() == pytest.approx([15, 30, 45, 1])


def test_nibabel_that_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "nibabel", None)
    with pytest.raises(MissingExtraError, match=r"nibabel is needed here: pip .*\[volumes\]"):
        WATER.to_nibabel()


def test_an_object_is_opened_by_its_name(tmp_path: Path) -> None:
    write_folder(phantoms.objects()[:2], tmp_path / "mine", version="1.0.0", builder="test")
    assert xden1k.open_object("bar-0001", root=tmp_path / "mine").mass_g == pytest.approx(72)
    with pytest.raises(MissingObjectError, match="did you mean bar-0001"):
        xden1k.open_object("bar-01", root=tmp_path / "mine")


def test_values_print_on_a_line() -> None:
    bar, unknown = (phantoms.objects()[number] for number in (0, 3))
    assert repr(bar) == "DensityObject('bar-0001', 'bar', 72 g, 2 parts, phantom, train split)"
    assert "mass unknown, 1 parts" in repr(unknown)
    assert repr(WATER) == "DensityField(4 x 5 x 6 voxels of 0.5 cm, 15 g)"


class Page(HTMLParser):
    """Tags that open and close in order, and every address."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.addresses: list[str] = []
        self.tags: set[str] = set()
        self.words = ""
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list) -> None:
        self.open.append(tag)
        self.handle_startendtag(tag, attrs)

    def handle_startendtag(self, tag: str, attrs: list) -> None:
        self.tags.add(tag)
        self.addresses += [value for name, value in attrs if name in ("src", "href")]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words += data


HOSTILE = '<script>alert("x")</script>&<img src=http://x>'


def test_a_notebook_shows_pictures_and_parts_and_fetches_nothing() -> None:
    for obj, pictures in ((phantoms.objects()[0], 4), (phantoms.objects()[3], 4)):
        page = Page(obj._repr_html_())
        assert len(page.addresses) == pictures
        assert all(each.startswith("data:image/png;base64,") for each in page.addresses)
        assert all(part.name in page.words for part in obj.parts)
    withheld = replace(phantoms.objects()[0], density=None, apparent_density=None)
    assert len(Page(withheld._repr_html_()).addresses) == 2


def test_what_the_data_say_cannot_become_markup() -> None:
    bar = phantoms.objects()[0]
    part = replace(bar.parts[0], name=HOSTILE, material=HOSTILE, flags=(HOSTILE,))
    obj: DensityObject = replace(
        bar, object_id=HOSTILE, category=HOSTILE, flags=(HOSTILE,), parts=(part, *bar.parts[1:])
    )
    page = Page(obj._repr_html_())
    assert page.words.count(HOSTILE) == 6
    assert "script" not in page.tags
    assert len(page.addresses) == 4


WATER = DensityField(np.ones((4, 5, 6)), np.array([1.0, 2, 3]), 0.5)
