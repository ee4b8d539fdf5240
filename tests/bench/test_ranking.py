"""Ranks: in the order of the means, and no row changes what is known of others."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from scipy.stats import t as student_t

from xden_bench.entries.copies import NEAR
from xden_bench.entries.leaderboard import tables
from xden_bench.entries.merging import merged_rows, seed_spread
from xden_bench.entries.ranking import (
    critical_distance,
    dense_ranks,
    rank_labels,
    ranks,
    unranked_because,
    worse_beyond_doubt,
)
from xden_bench.scoring.clusters import category_sums
from xden_bench.scoring.protocol import load_protocol, load_segment_protocol

RULES = load_protocol()
SEGMENTS = load_segment_protocol()
METRIC = RULES.rank_by
OBJECTS, SIZE = 40, 2
CATEGORIES = [f"kind-{i // SIZE:02}" for i in range(OBJECTS)]
HARD = np.random.default_rng(0).lognormal(size=OBJECTS)


def row(name: str, losses: np.ndarray, **changes: Any) -> dict[str, Any]:
    """An entry with what ranking reads of it."""
    count = sum(map(ord, name)) + changes.get("seed", 0) * 10_000
    values = losses.tolist()
    scores = dict.fromkeys((*RULES.metrics, "extent_cm"), values)
    means = {one: {"mean": float(losses.mean()), "ci95": None} for one in RULES.metrics}
    ids = [f"mug-{i:04}" for i in range(OBJECTS)]
    scores |= {"object_id": ids, "category": CATEGORIES, "source": ["phantom"] * OBJECTS}
    return {
        "method": {
            **{"name": name, "inputs": ["mesh"], "training_data": [], "seconds_per_object": None},
            **{"seed": changes.get("seed"), "external_data": False},
        },
        "status": "self-reported",
        **{"protocol": "v2", "metric_version": 1, "warnings": [], "target": "density"},
        "dataset": {"source": "phantom", "split": "test"},
        "date": changes.get("date", "2026-01-01"),
        "submission_sha256": f"{count:064x}",
        "metrics": means,
        "object_scores": scores,
        **({"team": {"public_key": changes["team"]}} if "team" in changes else {}),
        **({"arrays_sha256": changes["arrays"]} if "arrays" in changes else {}),
    }


def honest(count: int, seed: int = 1, spread: float = 0.3) -> list[np.ndarray]:
    """Losses of methods that find the same objects hard, each a little worse than the last."""
    rng = np.random.default_rng(seed)
    return [HARD * (1 + 0.25 * i) * np.exp(spread * rng.normal(size=OBJECTS)) for i in range(count)]


def rank_of(rows: list[Any]) -> dict[str, int | None]:
    return {one["method"]["name"]: rank for one, rank in zip(rows, ranks(rows), strict=True)}


def test_two_rows_are_told_apart_where_students_paired_test_does() -> None:
    rng = np.random.default_rng(0)
    losses = rng.random((30, 2))
    losses[:, 1] += 0.15
    difference = losses[:, 1] - losses[:, 0]
    found = difference.mean() / (difference.std(ddof=1) / np.sqrt(30))
    level = 2 * student_t.sf(found, 29)  # of two methods: both orders
    sums = category_sums(losses, [f"{i}" for i in range(30)])
    assert worse_beyond_doubt(sums, level * 1.001, 2)[1, 0]
    assert not worse_beyond_doubt(sums, level * 0.999, 2)[1, 0]
    assert not worse_beyond_doubt(sums, 0.999, 2)[0, 1]


losses_of_rows = npst.arrays(
    np.float64, (8, 6), elements=st.floats(0, 4).map(lambda value: round(value, 2))
)


@given(losses_of_rows, st.floats(0.001, 0.9))
@settings(deadline=None)
def test_doubt_is_transitive(losses: np.ndarray, error: float) -> None:
    worse = worse_beyond_doubt(category_sums(losses, list("aabbccdd")), error, 3)
    for i, j, k in np.ndindex(6, 6, 6):
        assert worse[i, k] or not (worse[i, j] and worse[j, k])


@given(losses_of_rows, st.floats(0.001, 0.9))
@settings(deadline=None)
def test_a_row_more_improves_no_rank_and_worsens_none_by_more_than_one(
    losses: np.ndarray, error: float
) -> None:
    worse = worse_beyond_doubt(category_sums(losses, list("aabbccdd")), error, 3)
    means = losses.mean(axis=0)
    before = dense_ranks(means[:-1].tolist(), worse[:-1, :-1])
    after = dense_ranks(means.tolist(), worse)[:-1]
    assert all(was <= now <= was + 1 for was, now in zip(before, after, strict=True))


@given(losses_of_rows, st.permutations(range(6)), st.floats(0.001, 0.9))
@settings(deadline=None)
def test_ranks_follow_the_means_whatever_the_order_of_the_rows(
    losses: np.ndarray, order: list[int], error: float
) -> None:
    losses = losses + np.arange(6) * 1e-4  # no two means are the same
    sums = category_sums(losses, list("aabbccdd"))
    found = dense_ranks(sums.means.tolist(), worse_beyond_doubt(sums, error, 3))
    assert [found[i] for i in np.argsort(sums.means)] == sorted(found)
    assert set(found) == set(range(1, max(found) + 1))
    turned = category_sums(losses[:, order], list("aabbccdd"))
    again = dense_ranks(turned.means.tolist(), worse_beyond_doubt(turned, error, 3))
    assert again == [found[i] for i in order]


def test_the_critical_distance_knows_nothing_of_the_table() -> None:
    assert critical_distance(0.05, 30, 106) == pytest.approx(student_t.isf(0.05 / 870, 106))
    assert critical_distance(0.05, 30, 0) == np.inf


def test_three_ruined_objects_neither_hide_a_worse_method_nor_help_it() -> None:
    good, bad = honest(1)[0], 1.5 * honest(1)[0]
    assert rank_of([row("good", good), row("bad", bad)]) == {"good": 1, "bad": 2}
    bad[:3] = 25.0
    assert rank_of([row("good", good), row("bad", bad)]) == {"good": 1, "bad": 2}


def test_ten_copies_push_nobody() -> None:
    first, second = honest(2, spread=0.1)
    rng = np.random.default_rng(2)
    rows = [row("first", first), row("second", second)]
    copies = [
        row(f"copy {i}", first * (1 + 1e-3 * rng.normal(size=OBJECTS)), date="2026-01-02")
        for i in range(10)
    ]
    found = merged_rows([*copies, *rows])
    assert [one["method"]["name"] for one in found][:: len(found) - 1] == ["first", "second"]
    assert ranks(found) == [1, *[None] * 10, 2]
    assert unranked_because(found[1]) == "a copy of first, which came first"


def test_the_same_arrays_are_a_copy_whatever_was_scored_of_them() -> None:
    first, other = honest(2)
    rows = merged_rows(
        [row("a", first, arrays="f" * 64), row("b", other, arrays="f" * 64, date="2026-02-01")]
    )
    assert [one["method"]["name"] for one in rows] == ["a", "b"]
    assert rank_labels(rows) == ["1", ""]


def test_methods_that_differ_as_networks_of_one_design_do_are_no_copies() -> None:
    rng = np.random.default_rng(3)
    near = HARD * np.exp(0.15 * rng.normal(size=OBJECTS))
    assert None not in ranks(merged_rows([row("a", HARD), row("b", near)]))


def test_a_copy_of_one_seed_of_a_method_is_a_copy_though_its_mean_is_far() -> None:
    seeds = [row("net", one, seed=i) for i, one in enumerate(honest(3))]
    rng = np.random.default_rng(2)
    noised = np.array(seeds[1]["object_scores"][METRIC]) * (1 + 1e-3 * rng.normal(size=OBJECTS))
    found = merged_rows([*seeds, row("thief", noised, date="2026-01-02")])
    assert unranked_because(found[1]) == "a copy of net, which came first"


def test_networks_of_two_designs_are_no_copies_though_their_means_over_seeds_are_near() -> None:
    rng = np.random.default_rng(3)
    first, second = (
        [row(name, HARD * np.exp(0.16 * rng.normal(size=OBJECTS)), seed=i) for i in range(16)]
        for name in ("a", "b")
    )
    rows = merged_rows([*first, *second])
    means = [np.array(one["object_scores"][METRIC]) for one in rows]
    assert np.median(np.abs(means[0] / means[1] - 1)) < NEAR[METRIC]
    assert None not in ranks(rows)


def segmented(name: str, iou: np.ndarray, **changes: Any) -> dict[str, Any]:
    """An entry of the board of segments."""
    made = row(name, iou, **changes)
    scores = made["object_scores"] | dict.fromkeys(SEGMENTS.metrics, iou.tolist())
    means = {key: {"mean": float(iou.mean()), "ci95": None} for key in SEGMENTS.metrics}
    board = {"protocol": SEGMENTS.name, "target": "segments"}
    return made | board | {"object_scores": scores, "metrics": means}


def test_copies_of_segments_are_found_and_seeds_of_another_network_are_not_taken_for_them() -> None:
    rng = np.random.default_rng(4)
    iou = rng.uniform(20, 80, OBJECTS)
    sibling = iou + rng.normal(0, 3, OBJECTS)  # the nearest two of the board: 1.7 in the median
    relabelled = iou - rng.uniform(0.2, 0.9, OBJECTS)  # one point in a hundred
    first, other, copy = (
        segmented("net", iou),
        segmented("net without", sibling, date="2026-01-02"),
        segmented("thief", relabelled, date="2026-01-03"),
    )
    found = {
        one["method"]["name"]: unranked_because(one) for one in merged_rows([copy, other, first])
    }
    assert found == {"net": None, "net without": None, "thief": "a copy of net, which came first"}


def test_seeds_of_a_method_are_one_row_with_their_mean_and_spread() -> None:
    seeds = [row("net", HARD * factor, seed=i) for i, factor in enumerate((1.0, 1.1, 1.2))]
    (found,) = merged_rows(seeds)
    assert found["metrics"][METRIC]["mean"] == pytest.approx(1.1 * HARD.mean())
    assert found["object_scores"][METRIC] == pytest.approx((1.1 * HARD).tolist())
    assert seed_spread(found, METRIC) == pytest.approx(0.1 * HARD.mean())
    assert [one["method"]["seed"] for one in found["seeds"]] == [0, 1, 2]


def test_a_seed_of_other_objects_is_not_averaged_with_the_first() -> None:
    """Means of other objects would be taken, or none could be."""
    first, other, fewer = (row("net", HARD * 1.1**seed, seed=seed) for seed in range(3))
    scores = other["object_scores"]
    scores["object_id"] = scores["object_id"][::-1]
    fewer["object_scores"] = {name: values[1:] for name, values in scores.items()}
    found, *others = merged_rows([first, other, fewer])
    assert found["metrics"][METRIC]["mean"] == pytest.approx(HARD.mean())
    assert [one["merged"] for one in others] == [
        "its objects are others than those of its first seed"
    ] * 2


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"inputs": ["mesh", "truth"]}, "it declares other inputs or training data than its first"),
        ({"training_data": ["all"]}, "it declares other inputs or training data than its first"),
        ({"external_data": True}, "it declares other inputs or training data than its first seed"),
    ],
)
def test_a_seed_that_declares_otherwise_moves_no_mean(changes: dict[str, Any], reason: str) -> None:
    first, other = (row("net", HARD * 0.1**seed, seed=seed) for seed in range(2))
    other["method"] |= changes
    found, apart = merged_rows([first, other])
    assert found["metrics"][METRIC]["mean"] == pytest.approx(HARD.mean())
    assert apart["merged"].startswith(reason)


def test_a_seed_of_the_references_values_moves_no_mean() -> None:
    first, other = (row("net", HARD * 0.1**seed, seed=seed) for seed in range(2))
    other["warnings"] = ["W504: near the reference"]
    found, apart = merged_rows([first, other])
    assert found["metrics"][METRIC]["mean"] == pytest.approx(HARD.mean())
    assert apart["merged"] == "its values are those of the reference"


@pytest.mark.parametrize("seed", [0, 1])
def test_an_oracle_of_a_seed_that_is_there_takes_its_place_in_no_row(seed: int) -> None:
    """The best entry of each seed counts, of those that are seeds of the first."""
    first, other = (row("net", HARD * 1.1**one, seed=one) for one in range(2))
    oracle = row("net", HARD * 0.01, seed=seed) | {"submission_sha256": "f" * 64}
    oracle["method"] |= {"inputs": ["mesh", "truth"]}
    found, apart = merged_rows([first, other, oracle])
    assert found["metrics"][METRIC]["mean"] == pytest.approx(1.05 * HARD.mean())
    assert apart is not first
    assert "it declares other inputs" in apart["merged"]
    near = row("net", HARD * 0.001, seed=seed) | {"submission_sha256": "f" * 64}
    near["warnings"] = ["W504: near the reference"]
    found, apart = merged_rows([first, other, near])
    assert unranked_because(found) is None
    assert apart["merged"] == "its values are those of the reference"


def test_a_remade_seed_near_the_reference_leaves_the_row_its_rank() -> None:
    first, other = (row("net", HARD * 1.1**seed, seed=seed) for seed in range(2))
    scored, remade = ({"how": how, "date": "2026-01-03"} for how in ("scored", "remade"))
    first |= {"status": "recomputed", "recomputed": scored, "warnings": ["W501: high"]}
    other |= {"status": "recomputed", "recomputed": remade, "warnings": ["W504: near"]}
    (found,) = merged_rows([first, other])
    assert unranked_because(found) is None
    assert found["warnings"] == ["W501: high"]


def test_one_recomputed_seed_does_not_vouch_for_another() -> None:
    first, other = (row("net", HARD * 1.1**seed, seed=seed) for seed in range(2))
    told = {"status": "recomputed", "recomputed": {"how": "scored", "date": "2026-01-03"}}
    (row_of_one,) = merged_rows([first | told, other | {"status": "self-reported"}])
    assert row_of_one["status"] == "self-reported"
    assert not row_of_one["recomputed"]
    (row_of_both,) = merged_rows([first | told, other | told])
    assert row_of_both["status"] == "recomputed"
    assert row_of_both["recomputed"] == told["recomputed"]


def test_a_copy_of_what_came_before_in_another_track_has_no_rank() -> None:
    seen = row("xray net", HARD) | {"track": "xray"}
    blind = row("eyes only", HARD * 1.01, date="2026-01-02") | {"track": "geometry"}
    other = row("honest", HARD * 1.3, date="2026-01-02") | {"track": "geometry"}
    assert [one.get("merged") for one in merged_rows([blind, other], [seen])] == [
        "a copy of xray net, which came first in xray",
        None,
    ]
    assert "merged" not in merged_rows([seen], [blind, other])[0]
    own = row("xray net", HARD * 1.01, date="2026-01-02") | {"track": "geometry"}
    assert "merged" not in merged_rows([own], [seen])[0]
    dataset = {"dataset": seen["dataset"] | {"revision": "1", "manifest_sha256": "0" * 64}}
    boards = tables([seen | dataset, blind | dataset])
    assert [one[0].get("merged", "")[:6] for one in boards] == ["a copy", ""]


def test_deviations_that_one_seed_does_not_state_are_not_in_the_mean_of_the_seeds() -> None:
    bare, stating = (row("net", HARD * factor, seed=i) for i, factor in enumerate((1.0, 1.1)))
    stating["object_scores"] |= dict.fromkeys(RULES.sd_metrics, HARD.tolist())
    for seeds in ([bare, stating], [stating | {"date": "2025-01-01"}, bare]):
        (found,) = merged_rows(seeds)
        assert set(found["metrics"]) == set(RULES.metrics)


def test_of_a_method_and_seed_that_came_again_the_better_counts() -> None:
    better, worse = honest(2)
    rows = merged_rows([row("net", worse), row("net", better, date="2026-03-01", arrays="0" * 64)])
    assert rows[0]["metrics"][METRIC]["mean"] == pytest.approx(better.mean())


def test_teams_may_have_methods_of_one_name() -> None:
    rows = merged_rows([row("net", one, team=f"{i}") for i, one in enumerate(honest(2))])
    assert [one.get("merged") for one in rows] == [None, None]


def test_a_protocol_before_v2_ranks_nothing() -> None:
    rows = [row("a", HARD) | {"protocol": "v1"}, row("b", 2 * HARD) | {"protocol": "v1"}]
    assert ranks(rows) == [None, None]
