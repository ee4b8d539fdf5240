import json

import h5py
import pytest
from hypothesis import given
from hypothesis import strategies as st

from xden_builder.pipeline.work import load_row, save_row

LIGHT = st.one_of(
    st.none(), st.text(max_size=20), st.floats(allow_nan=False), st.lists(st.floats(0, 1))
)
ROWS = st.dictionaries(st.from_regex(r"[a-z_]{1,12}", fullmatch=True), LIGHT | st.binary())


@given(row=ROWS)
def test_a_row_comes_back_as_it_was_kept(tmp_path_factory, row):
    work = tmp_path_factory.mktemp("work")
    save_row(work, "mug-0001", "digest", row)
    kept = load_row(work, "mug-0001", "digest")
    assert kept == row
    assert list(kept) == list(row)


def test_another_digest_means_work_to_do(tmp_path):
    save_row(tmp_path, "a", "old", {"x": b"1"})
    assert load_row(tmp_path, "a", "new") is None


def test_no_file_means_work_to_do(tmp_path):
    assert load_row(tmp_path, "a", "d") is None


@pytest.mark.parametrize("keep", [0, 1, 100, 0.5, 0.99])
def test_a_truncated_work_file_means_work_to_do(tmp_path, keep):
    path = tmp_path / "a.h5"
    save_row(tmp_path, "a", "d", {"x": b"1" * 5000, "y": json.dumps([1, 2])})
    whole = path.read_bytes()
    path.write_bytes(whole[: int(keep if keep >= 1 else keep * len(whole))])
    assert load_row(path.parent, "a", "d") is None


def test_a_foreign_hdf5_file_means_work_to_do(tmp_path):
    save_row(tmp_path, "a", "d", {"x": b"1"})
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.attrs["complete"] = True
    assert load_row(tmp_path, "a", "d") is None


def test_a_file_without_its_seal_means_work_to_do(tmp_path):
    save_row(tmp_path, "a", "d", {"x": b"1"})
    (tmp_path / "a.seal").unlink()
    assert load_row(tmp_path, "a", "d") is None


def test_writing_twice_gives_the_same_bytes(tmp_path):
    for name in "ab":
        save_row(tmp_path, name, "d", {"x": b"1" * 5000, "y": [1.5, 2]})
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.h5", "a.seal", "b.h5", "b.seal"]
    assert (tmp_path / "a.seal").read_bytes() == (tmp_path / "b.seal").read_bytes()


@given(place=st.integers(0, 10**6), flip=st.integers(1, 255))
def test_a_damaged_work_file_means_work_to_do(tmp_path_factory, place, flip):
    path = tmp_path_factory.mktemp("work") / "a.h5"
    row = {"x": bytes(range(256)) * 4, "y": [1.5, 2], "z": "text"}
    save_row(path.parent, "a", "d", row)
    data = bytearray(path.read_bytes())
    data[place % len(data)] ^= flip
    path.write_bytes(data)
    assert load_row(path.parent, "a", "d") is None


def test_a_url_keeps_rows_as_a_path_does(tmp_path):
    row = {"x": b"1" * 5000, "y": [1.5, 2]}
    save_row("memory://work", "a", "d", row)
    assert load_row("memory://work", "a", "d") == row
    assert load_row("memory://work", "a", "other") is None
    assert load_row("memory://work", "b", "d") is None
