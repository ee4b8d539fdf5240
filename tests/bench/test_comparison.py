"""Two methods on the same objects."""

from __future__ import annotations

import dataclasses
from math import comb

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from xden1k.errors import DataError
from xden_bench.scoring.comparison import Scored, compare
from xden_bench.scoring.protocol import load_protocol

RULES = load_protocol()
SAME = {"protocol": "v2", "metric version": 1, "manifest": "0" * 64, "split": "test"}
SAME |= {"target": "density"}


def scored(name: str, **columns: list[float]) -> Scored:
    count = len(next(iter(columns.values())))
    ids = [f"mug-{i:04}" for i in range(count)]
    kinds = [f"kind-{i // 2}" for i in range(count)]
    return Scored(name, SAME, {"object_id": ids, "category": kinds, **columns})


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
    assert found.difference.interval is None  # of seven objects
    kinds = [pairs[i : i + 2] for i in range(0, 7, 2)]
    worse = sum(sum(a - b for a, b in kind) > 0 for kind in kinds)
    tail = sum(comb(4, k) for k in range(min(worse, 4 - worse) + 1)) / 2**4
    assert found.p_equal == pytest.approx(min(2 * tail, 1.0))
    apart = sorted((abs(a - b) for a, b in pairs), reverse=True)
    assert [abs(one.a - one.b) for one in found.largest] == pytest.approx(apart[:5])


def test_it_is_paired_a_small_difference_on_every_object_is_sure() -> None:
    values = np.random.default_rng(0).lognormal(size=300)
    a = scored("a", density_mae_g_cm3=values.tolist())
    b = scored("b", density_mae_g_cm3=(values + 0.05).tolist())
    found = compare(a, b, RULES)["density_mae_g_cm3"]
    assert found.difference.interval == pytest.approx((-0.05, -0.05))
    assert (found.a_better, found.b_better) == (300, 0)
    assert found.p_equal == pytest.approx(2 / 2**150)


def test_a_heavy_tail_and_an_older_protocol_have_no_interval() -> None:
    a, b = (scored(name, mass_mape=[0.1] * 300, density_mae_g_cm3=[0.2] * 300) for name in "ab")
    assert compare(a, b, RULES)["mass_mape"].difference.interval is None
    assert compare(a, b, RULES)["density_mae_g_cm3"].difference.interval == (0.0, 0.0)
    old = compare(a, b, load_protocol("v1"))
    assert old["density_mae_g_cm3"].difference.interval is None


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
    assert (found.a_better, found.b_better) == (2, 0)


@given(st.lists(st.tuples(st.floats(0, 9), st.floats(0, 9)), min_size=1, max_size=9))
@settings(deadline=None)
def test_turned_round_it_says_the_same(pairs: list[tuple[float, float]]) -> None:
    a, b = (scored(name, mass_mape=[one[i] for one in pairs]) for i, name in enumerate("ab"))
    there, back = (compare(*two, RULES)["mass_mape"] for two in ((a, b), (b, a)))
    assert there.difference.mean == pytest.approx(-back.difference.mean)
    assert there.p_equal == pytest.approx(back.p_equal)
    assert (there.a_better, there.b_better) == (back.b_better, back.a_better)


def test_what_only_rounding_tells_apart_is_equal() -> None:
    a = scored("a", com_l1_cm=[0.25, 0.5])
    b = scored("b", com_l1_cm=[0.25 + 1e-8, 0.5 + 1e-8])
    found = compare(a, b, RULES)["com_l1_cm"]
    assert (found.p_equal, found.a_better, found.b_better, found.largest) == (1.0, 0, 0, ())


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
