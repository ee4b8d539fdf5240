"""Two methods on the same objects."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from xden1k.errors import DataError
from xden_bench.entries.ranking import better
from xden_bench.scoring.comparison import Scored, compare
from xden_bench.scoring.protocol import load_protocol

RULES = load_protocol()
SAME = {"protocol": "v1", "metric version": 1, "manifest": "0" * 64, "split": "test"}
SAME |= {"target": "density"}


def scored(name: str, **columns: list[float]) -> Scored:
    count = len(next(iter(columns.values())))
    return Scored(name, SAME, {"object_id": [f"mug-{i:04}" for i in range(count)], **columns})


def test_the_difference_agrees_with_a_loop() -> None:
    rng = np.random.default_rng(0)
    first, second = rng.random((2, 7)).tolist()
    found = compare(scored("a", mass_mape=first), scored("b", mass_mape=second), RULES)["mass_mape"]
    pairs = list(zip(first, second, strict=True))
    assert found.difference.mean == pytest.approx(sum(a - b for a, b in pairs) / 7)
    assert (found.a_better, found.b_better) == (
        sum(a < b for a, b in pairs),
        sum(a > b for a, b in pairs),
    )
    rng = np.random.default_rng(RULES.bootstrap_seed)
    means = []
    for _ in range(RULES.bootstrap_resamples // 1000):
        for drawn in rng.integers(7, size=(1000, 7)):
            means.append(sum(pairs[i][0] - pairs[i][1] for i in drawn) / 7)
    low, high = np.quantile(means, (0.025, 0.975))
    assert (found.difference.low, found.difference.high) == pytest.approx((low, high))
    assert found.a_better_share == pytest.approx(sum(one < 0 for one in means) / len(means))
    apart = sorted((abs(a - b) for a, b in pairs), reverse=True)
    assert [abs(one.a - one.b) for one in found.largest] == pytest.approx(apart[:5])


def test_it_is_paired_a_small_difference_on_every_object_is_sure() -> None:
    easy_and_hard = [0.1, 0.5, 2.0, 9.0]
    a = scored("a", mass_mape=easy_and_hard)
    b = scored("b", mass_mape=[one + 0.05 for one in easy_and_hard])
    found = compare(a, b, RULES)["mass_mape"]
    assert (found.difference.low, found.difference.high) == pytest.approx((-0.05, -0.05))
    assert (found.a_better_share, found.a_better, found.b_better) == (1.0, 4, 0)


@pytest.mark.parametrize(
    ("metric", "worse", "better_values"),
    [
        ("mass_mape", [0.3, 0.4], [0.2, 0.3]),
        ("mass_mnre", [0.2, 0.3], [0.3, 0.4]),
        ("density_within_1sd", [1.0, 0.95], [0.7, 0.66]),
        ("density_within_2sd", [0.5, 0.4], [0.95, 0.96]),
    ],
)
def test_better_is_what_the_metric_calls_better(
    metric: str, worse: list[float], better_values: list[float]
) -> None:
    a, b = scored("a", **{metric: better_values}), scored("b", **{metric: worse})
    found = compare(a, b, RULES)[metric]
    assert (found.a_better_share, found.a_better, found.b_better) == (1.0, 2, 0)


@given(st.lists(st.tuples(st.floats(0, 9), st.floats(0, 9)), min_size=1, max_size=9))
@settings(deadline=None)
def test_turned_round_it_says_the_same(pairs: list[tuple[float, float]]) -> None:
    a, b = (scored(name, mass_mape=[one[i] for one in pairs]) for i, name in enumerate("ab"))
    rules = dataclasses.replace(RULES, bootstrap_resamples=200)
    there, back = (compare(*two, rules)["mass_mape"] for two in ((a, b), (b, a)))
    assert there.difference.mean == pytest.approx(-back.difference.mean)
    assert there.a_better_share + back.a_better_share == pytest.approx(1)
    assert (there.a_better, there.b_better) == (back.b_better, back.a_better)
    assert there.difference.low == pytest.approx(-back.difference.high, abs=1e-9)


def test_what_only_rounding_tells_apart_is_equal() -> None:
    a = scored("a", com_l1_cm=[0.25, 0.5])
    b = scored("b", com_l1_cm=[0.25 + 1e-8, 0.5 + 1e-8])
    found = compare(a, b, RULES)["com_l1_cm"]
    assert (found.a_better_share, found.a_better, found.b_better, found.largest) == (0.5, 0, 0, ())
    assert not better(np.array([[0.25, 0.25 + 1e-8], [0.5, 0.5 + 1e-8]]), 100, 0).any()


def test_metrics_that_one_of_them_lacks_are_left_out() -> None:
    a = scored("a", mass_mape=[0.1], density_crps_g_cm3=[0.1])
    assert list(compare(a, scored("b", mass_mape=[0.2]), RULES)) == ["mass_mape"]


@pytest.mark.parametrize("name", list(SAME))
def test_what_was_not_scored_alike_is_refused(name: str) -> None:
    a = scored("a", mass_mape=[0.1])
    b = dataclasses.replace(a, name="b", compared={**SAME, name: "other"})
    with pytest.raises(DataError, match=f"only scores of one {name} can be compared: a has"):
        compare(a, b, RULES)


def test_other_objects_are_refused() -> None:
    with pytest.raises(DataError, match="a and b were scored on different objects"):
        compare(scored("a", mass_mape=[0.1]), scored("b", mass_mape=[0.1, 0.2]), RULES)
