"""Trivial methods are told by their values, whatever they are called."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from xden1k.errors import DataError
from xden_bench.methods.baseline import find_predictor, run_predictor
from xden_bench.methods.trivial import check_trivial, score_told
from xden_bench.scoring.names import skeleton
from xden_bench.scoring.protocol import load_protocol
from xden_bench.scoring.reference import Reference

RULES = load_protocol()
Submit = Callable[..., Path]


def disguised(reference: Reference, name: str, folder: Path, submission: Submit) -> Path:
    """A trivial method's values under another name, a little larger, with noise."""
    own = folder / "own.npz"
    run_predictor(find_predictor(name), reference.folder, reference.split, own)
    with np.load(own) as arrays:
        grids = {one: arrays[f"density/{one}"] for one in reference.ids}
    noise = np.random.default_rng(0)

    def change(object_id: str, _: np.ndarray) -> np.ndarray:
        grid = 1.005 * grids[object_id]
        return (grid * noise.uniform(0.9, 1.1, grid.shape)).astype(np.float32)

    return submission(change, method="my net")


@pytest.mark.parametrize("name", ["zero", "water", "train-median", "category-median"])
def test_a_renamed_trivial_method_is_told_by_its_values(
    name: str, reference: Reference, tmp_path: Path, submission: Submit
) -> None:
    path = disguised(reference, name, tmp_path, submission)
    told = [str(one) for one in score_told(path, reference, RULES).warnings]
    assert f"W505: the values of a trivial method, {name}" in told


def test_an_honest_even_filling_is_no_trivial_method(
    reference: Reference, submission: Submit
) -> None:
    def change(object_id: str, _: np.ndarray) -> np.ndarray:
        return np.float32(3.7) * reference.truth(object_id).envelope

    codes = [one.code for one in score_told(submission(change), reference, RULES).warnings]
    assert codes == ["W502"]


@pytest.mark.parametrize("name", ["water", "Water", "W.a.t.e.r", "vvater"])
def test_no_spelling_of_a_trivial_methods_name_is_free(
    name: str, reference: Reference, submission: Submit
) -> None:
    path = submission(lambda _, grid: 1.1 * grid, method=name)
    with pytest.raises(DataError, match="the name 'water' is that of a trivial method"):
        check_trivial(path, reference, RULES)


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("PIXIE", "pixie", True),
        ("Pixie", "p1xie", True),
        ("mynet", "rnynet", True),
        ("pixie", "pix-ie!", True),
        ("NeRF2Physics", "NeRF3Physics", False),
    ],
)
def test_names_that_look_alike_have_one_skeleton(one: str, other: str, same: bool) -> None:
    assert (skeleton(one) == skeleton(other)) is same
