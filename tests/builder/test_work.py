import json

import h5py
import pytest
from hypothesis import given
from hypothesis import strategies as st

from xden_builder.work import load_row, save_row

LIGHT = st.one_of(
    st.none(), st.text(max_size=20), st.floats(allow_nan=False), st.lists(st.floats(0, 1))
)
ROWS = st.dictionaries(st.from_regex(r"[a-z_]{1,12}", fullmatch=True), LIGHT | st.binary())


@given(row=ROWS)
def test_a_row_comes_back_as_it_was_kept(tmp_path_factory, row):
    path = tmp_path_factory.mktemp("work") / "mug-0001.h5"
    save_row(path, "digest", row)
    kept = load_row(path, "digest")
    assert kept == row
    assert list(kept) == list(row)


def test_another_digest_means_work_to_do(tmp_path):
    save_row(tmp_path / "a.h5", "old", {"x": b"1"})
    assert load_row(tmp_path / "a.h5", "new") is None


def test_no_file_means_work_to_do(tmp_path):
    assert load_row(tmp_path / "a.h5", "d") is None


@pytest.mark.parametrize("keep", [0, 1, 100, 0.5, 0.99])
def test_a_truncated_work_file_means_work_to_do(tmp_path, keep):
    path = tmp_path / "a.h5"
    save_row(path, "d", {"x": b"1" * 5000, "y": json.dumps([1, 2])})
    whole = path.read_bytes()
    path.write_bytes(whole[: int(keep if keep >= 1 else keep * len(whole))])
    assert load_row(path, "d") is None


def test_a_foreign_hdf5_file_means_work_to_do(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.attrs["complete"] = True
    assert load_row(tmp_path / "a.h5", "d") is None


def test_writing_twice_gives_the_same_bytes(tmp_path):
    for name in "ab":
        save_row(tmp_path / name, "d", {"x": b"1" * 5000, "y": [1.5, 2]})
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a", "b"]
