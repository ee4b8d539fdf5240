"""Predictions whose axes are wrong are told; those that are merely bad are not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, shift

from xden1k.access.hub import SAMPLE
from xden1k.folder import open_folder
from xden1k.predictions import write_predictions
from xden1k.values.arrays import Grid
from xden_bench.methods.template import write_template
from xden_bench.scoring.axes import OUTSIDE, TURNS, AxesWatch, Turn
from xden_bench.scoring.protocol import load_protocol
from xden_bench.scoring.reference import Reference, Truth
from xden_bench.scoring.submission import validate

REFERENCE = Reference(open_folder(SAMPLE), "test")


@cache
def truths() -> tuple[Truth, ...]:
    """The test objects of the packaged sample: things of everyday shapes."""
    return tuple(map(REFERENCE.truth, REFERENCE.ids))


def finding(predict: Callable[[Truth], Grid]) -> str | None:
    watch = AxesWatch()
    for truth in truths():
        watch.look(predict(truth), truth.envelope)
    return watch.finding()


def outside(turn: Turn, truth: Truth) -> float:
    turned = turn(truth.density_g_cm3)
    return 1 - float(turned[truth.envelope > 0].sum() / turned.sum())


def test_there_are_48_ways_of_taking_the_axes_and_the_first_is_as_they_are() -> None:
    grid = np.arange(27, dtype=np.float32).reshape(3, 3, 3)
    assert len({turn(grid).tobytes() for turn in TURNS}) == len(TURNS) == 48
    assert (TURNS[0](grid) == grid).all()
    assert str(TURNS[0]) == "(x, y, z)"


@pytest.mark.parametrize(
    "turn",
    [*TURNS[1:3], *(pytest.param(turn, marks=pytest.mark.slow) for turn in TURNS[3:])],
    ids=str,
)
def test_the_truth_with_other_axes_is_told_wherever_outlines_can_tell(turn: Turn) -> None:
    shows = [outside(turn, truth) > OUTSIDE for truth in truths()]
    told = finding(lambda truth: turn(truth.density_g_cm3))
    assert told is not None or 2 * sum(shows) <= len(shows)


NOISE = np.random.default_rng(0).random((64, 64, 64)).astype(np.float32)


@pytest.mark.parametrize(
    "predict",
    [
        lambda truth: truth.density_g_cm3,
        lambda truth: 2 * truth.envelope,
        lambda truth: gaussian_filter(truth.density_g_cm3, 2.0),
        lambda truth: gaussian_filter(truth.density_g_cm3, 5.0),
        lambda truth: shift(truth.density_g_cm3, (6, -4, 5), order=0),
        lambda truth: np.ones((64, 64, 64), np.float32),
        lambda _: NOISE,
        lambda truth: np.broadcast_to(truth.density_g_cm3.max(0), (64, 64, 64)),
        lambda truth: truths()[0].density_g_cm3,
        lambda truth: np.zeros((64, 64, 64), np.float32),
    ],
    ids=[
        "truth",
        "envelope",
        "blurred",
        "smeared",
        "shifted",
        "full",
        "noise",
        "extruded",
        "another",
        "zero",
    ],
)
def test_a_prediction_that_is_merely_bad_is_not_told(predict: Callable[[Truth], Grid]) -> None:
    assert finding(predict) is None


def test_a_submission_with_other_axes_gets_the_warning_w505(tmp_path: Path) -> None:
    path, rules = tmp_path / "preds.npz", load_protocol()
    meta = replace(write_template(path, REFERENCE, rules, "geometry"), method="turned")
    turned = ((one.object_id, TURNS[1](one.envelope)) for one in truths())
    write_predictions(path, meta, turned)
    found = {one.code: str(one) for one in validate(path, REFERENCE, rules)}
    assert found["W506"].endswith("with the axes taken as (x, y, -z)")
