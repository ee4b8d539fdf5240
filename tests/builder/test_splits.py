"""Splits: even within each category, and an object stays where it is."""

from __future__ import annotations

import errno
import os
from collections import Counter
from functools import partial
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from xden1k.errors import DataError
from xden1k.values.types import SPLITS
from xden_builder.capture import ObjectRow
from xden_builder.pipeline import splits
from xden_builder.pipeline.splits import SPLITS_NAME, draw_splits, with_splits

SHARES = {"train": 0.7, "val": 0.1, "test": 0.2}


def categories_of(counts: dict[str, int]) -> dict[str, str]:
    return {f"{name}-{n:04}": name for name, count in counts.items() for n in range(count)}


counts = st.dictionaries(st.sampled_from("abcd"), st.integers(1, 60), min_size=1)


@given(counts)
def test_each_category_is_split_as_evenly_as_whole_objects_allow(drawn: dict[str, int]) -> None:
    categories = categories_of(drawn)
    splits = draw_splits(categories, {})
    for category, total in drawn.items():
        found = Counter(splits[name] for name, each in categories.items() if each == category)
        for split, share in SHARES.items():
            assert abs(found[split] - share * total) < 1.5, (category, split)


@given(counts, counts)
def test_new_objects_move_no_old_one(before: dict[str, int], more: dict[str, int]) -> None:
    old = categories_of(before)
    first = draw_splits(old, {})
    new = {f"new-{name}": category for name, category in categories_of(more).items()}
    second = draw_splits(old | new, first)
    assert {name: second[name] for name in old} == first
    assert second.keys() == (old | new).keys()


@given(counts, st.randoms())
def test_the_order_of_the_table_chooses_nothing(drawn: dict[str, int], random) -> None:
    categories = categories_of(drawn)
    shuffled = list(categories.items())
    random.shuffle(shuffled)
    assert draw_splits(dict(shuffled), {}) == draw_splits(categories, {})


def test_a_new_object_goes_where_its_category_lacks_most() -> None:
    known = {f"mug-{n}": "train" for n in range(7)} | {"mug-7": "val"}
    categories = dict.fromkeys([*known, "mug-8", "mug-9"], "mug")
    drawn = draw_splits(categories, known)
    assert [drawn["mug-8"], drawn["mug-9"]] == ["test", "test"]


def rows(*names: str, **stated: str) -> dict[str, ObjectRow]:
    return {name: ObjectRow(name, "mug", split=stated.get(name)) for name in names}


def test_a_new_object_of_an_unseen_category_is_unseen() -> None:
    categories = {"mug-1": "mug", "mug-2": "mug", "pot-1": "pot"}
    splits = draw_splits(categories, {"mug-1": "unseen"})
    assert splits == {"mug-1": "unseen", "mug-2": "unseen", "pot-1": splits["pot-1"]}
    assert splits["pot-1"] != "unseen"


def test_the_first_build_writes_the_splits_and_the_next_keeps_them(tmp_path: Path) -> None:
    first = with_splits(tmp_path, rows("a", "b", "c"))
    assert {row.split for row in first.values()} <= set(SPLITS)
    written = (tmp_path / SPLITS_NAME).read_text()
    assert written.splitlines()[0] == "object_id,split"
    assert with_splits(tmp_path, rows("c", "b", "a")) == first
    assert (tmp_path / SPLITS_NAME).read_text() == written
    more = with_splits(tmp_path, rows("a", "b", "c", "d"))
    assert {name: more[name] for name in first} == first


@pytest.mark.parametrize("kind", [errno.EROFS, errno.EACCES])
def test_captures_that_cannot_be_written_to_are_built_by_splits_of_the_moment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, kind: int
) -> None:
    expected = with_splits(tmp_path, rows("a", "b"))
    (tmp_path / SPLITS_NAME).unlink()

    def refused(number: int, *_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(splits, "write_bytes", partial(refused, kind))
    assert with_splits(tmp_path, rows("a", "b")) == expected
    assert "cannot be written" in caplog.text
    monkeypatch.setattr(splits, "write_bytes", partial(refused, errno.ENOSPC))
    with pytest.raises(OSError, match="No space"):
        with_splits(tmp_path, rows("a", "b"))


def test_an_object_that_is_gone_for_a_while_comes_back_to_its_split(tmp_path: Path) -> None:
    first = with_splits(tmp_path, rows("a", "b", "c"))
    with_splits(tmp_path, rows("a", "d", "e"))
    assert with_splits(tmp_path, rows("b"))["b"] == first["b"]


def test_what_objects_csv_states_holds_and_nothing_is_written_where_all_is_stated(
    tmp_path: Path,
) -> None:
    stated = with_splits(tmp_path, rows("a", "b", a="val", b="test"))
    assert [row.split for row in stated.values()] == ["val", "test"]
    assert not (tmp_path / SPLITS_NAME).exists()
    (tmp_path / SPLITS_NAME).write_text("object_id,split\na,train\n")
    assert with_splits(tmp_path, rows("a", "b", a="val"))["a"].split == "val"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("object_id,part\n", r"columns must be object_id, split, got object_id, part"),
        ("", "expected a table with the columns"),
        (
            "object_id,split\na,dev\n",
            r"row 2: expected an object id .* train, val, test, unseen, got 'a,dev'",
        ),
        ("object_id,split\na,val\na,val\n", r"row 3: expected an object id of its own"),
        ("object_id,split\na\n", r"row 2: .* got 'a'"),
    ],
)
def test_a_spoilt_table_is_named_with_its_row(tmp_path: Path, content: str, message: str) -> None:
    (tmp_path / SPLITS_NAME).write_text(content)
    with pytest.raises(DataError, match=rf"{SPLITS_NAME}: .*{message}"):
        with_splits(tmp_path, rows("a", "b"))
