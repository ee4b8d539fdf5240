"""What an error about an object names, and how often."""

from __future__ import annotations

import re

import pytest

from xden1k.errors import DataError, ObjectError, about, of_dataset


@pytest.mark.parametrize(
    ("found", "told"),
    [
        ("part 0 is not closed", "mug: mug-0001: part 0 is not closed"),
        ("mug-0001: part 0 is not closed", "mug: mug-0001: part 0 is not closed"),
        ("mug-0001 has no radiographs", "mug: mug-0001 has no radiographs"),
        ("mug/data/test.parquet: cannot read mug-0001", None),
        ("runs/mug-0001/a.ply: not closed", "mug: mug-0001: runs/mug-0001/a.ply: not closed"),
        ("mug-00012 is not here", "mug: mug-0001: mug-00012 is not here"),
    ],
)
def test_dataset_and_object_are_named_once_whatever_names_them_already(
    found: str, told: str | None
) -> None:
    with (
        pytest.raises(ObjectError, match=f"^{re.escape(told or found)}$"),
        of_dataset("mug"),
        of_dataset("mug"),
        about("mug-0001"),
        about("mug-0001"),
    ):
        raise DataError(found)


def test_what_is_wrong_of_no_object_is_left_as_it_is() -> None:
    with pytest.raises(DataError, match="a budget") as error, of_dataset("mug"):
        raise DataError("a budget must be positive")
    assert not isinstance(error.value, ObjectError)
    assert str(error.value) == "a budget must be positive"
