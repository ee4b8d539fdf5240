"""Overlap of clusters and regions: by hand, by all permutations, and what must hold of any."""

from __future__ import annotations

from itertools import permutations
from math import isnan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from xden1k.segmentation import CLUSTER_COUNTS, Segmentation
from xden_bench.scoring.overlap import iou_matrix, many_to_one, one_to_one, score_segments

POINTS = 30
ids = npst.arrays(np.uint8, POINTS, elements=st.integers(0, 4))
labels = npst.arrays(np.uint8, (len(CLUSTER_COUNTS), POINTS), elements=st.integers(0, 1))


def of_all(clusters: np.ndarray) -> Segmentation:
    """The same clusters for every k, in which k is no less than they are."""
    few = np.minimum(clusters, np.array(CLUSTER_COUNTS)[:, None] - 1)
    return Segmentation(few.astype(np.uint8), clusters.astype(np.uint8))


def by_loops(regions: np.ndarray, clusters: np.ndarray) -> np.ndarray:
    """The definition, point by point."""
    found = []
    for region in sorted(set(regions.tolist())):
        found.append([])
        for cluster in sorted(set(clusters.tolist())):
            pairs = list(zip(regions, clusters, strict=True))
            both = sum(r == region and c == cluster for r, c in pairs)
            either = sum(r == region or c == cluster for r, c in pairs)
            found[-1].append(both / either)
    return np.array(found)


def by_permutations(iou: np.ndarray) -> float:
    """The best of all ways to give each region a cluster of its own, or none."""
    regions, clusters = iou.shape
    none = max(0, regions - clusters)  # where there are enough, having none is never better
    padded = np.hstack([iou, np.zeros((regions, none))])
    ways = permutations(range(clusters + none), regions)
    return max(sum(padded[row, column] for row, column in enumerate(way)) for way in ways)


@given(ids, ids)
def test_overlap_agrees_with_loops(regions: np.ndarray, clusters: np.ndarray) -> None:
    np.testing.assert_allclose(iou_matrix(regions, clusters), by_loops(regions, clusters))


@given(
    npst.arrays(
        np.float64,
        st.just((5, 5)) | st.tuples(st.integers(1, 5), st.integers(1, 5)),
        elements=st.floats(0, 1),
    )
)
def test_the_assignment_is_the_best_of_all_permutations(iou: np.ndarray) -> None:
    assert one_to_one(iou) == pytest.approx(by_permutations(iou))
    assert one_to_one(iou.T) == pytest.approx(one_to_one(iou))


@given(ids, st.permutations(range(5)))
def test_the_truth_scores_100_whatever_its_regions_are_called(
    regions: np.ndarray, names: list[int]
) -> None:
    regions[:2] = 0, 1
    truth = of_all(np.unique(regions, return_inverse=True)[1])
    called = np.array(names, np.uint8)
    renamed = Segmentation(called[truth.labels % 5], called[truth.free])
    found = score_segments(called[regions], regions, renamed)
    assert found == pytest.approx(dict.fromkeys(found, 100.0))


@given(ids, ids, st.permutations(range(5)))
def test_names_of_clusters_and_regions_mean_nothing(
    regions: np.ndarray, clusters: np.ndarray, names: list[int]
) -> None:
    iou, called = iou_matrix(regions, clusters), np.array(names)
    renamed = iou_matrix(called[regions], called[clusters])
    assert one_to_one(renamed) == pytest.approx(one_to_one(iou))
    assert many_to_one(renamed) == pytest.approx(many_to_one(iou))


@given(ids, labels, ids)
def test_one_to_one_is_never_above_many_to_one(
    regions: np.ndarray, rows: np.ndarray, free: np.ndarray
) -> None:
    regions[:2] = 0, 1
    found = score_segments(regions, regions, Segmentation(rows, free))
    assert 0 < found["iou_a"] <= found["iou_b_material"] + 1e-9
    assert 0 < found["iou_c"] <= 100


@given(ids, ids, npst.arrays(np.bool_, POINTS))
def test_an_added_mask_never_lowers_many_to_one(
    regions: np.ndarray, clusters: np.ndarray, mask: np.ndarray
) -> None:
    iou, added = iou_matrix(regions, clusters), iou_matrix(regions, mask.astype(np.uint8))[:, -1:]
    assert many_to_one(np.hstack([iou, added])) >= many_to_one(iou)


@given(ids, ids, labels, labels)
def test_masks_of_another_number_of_clusters_never_lower_b(
    materials: np.ndarray, parts: np.ndarray, rows: np.ndarray, others: np.ndarray
) -> None:
    materials[:2] = parts[:2] = 0, 1
    few = np.broadcast_to(rows[0], rows.shape).copy()
    more = np.vstack([few[:1], others[1:]])
    found, least = (
        score_segments(materials, parts, Segmentation(one, rows[0])) for one in (more, few)
    )
    for name in ("iou_b_material", "iou_b_part"):
        assert found[name] >= least[name]


def test_three_regions_by_hand() -> None:
    """The worked example of the manual: body 6, rod 3, cavity 1 of ten points."""
    regions = np.array([0, 0, 0, 0, 0, 0, 1, 1, 1, 2])
    three = np.array([0, 0, 0, 0, 1, 1, 1, 1, 2, 2])  # overlaps 4/6, 2/5, 1/2
    two = np.array([0, 0, 0, 0, 0, 0, 1, 1, 1, 1])  # overlaps 1, 3/4; the cavity 1/4, at best
    rows = np.zeros((len(CLUSTER_COUNTS), 10), np.uint8)
    rows[CLUSTER_COUNTS.index(2)], rows[CLUSTER_COUNTS.index(3)] = two, three
    found = score_segments(regions, regions, Segmentation(rows, two.astype(np.uint8)))
    assert found["iou_a"] == pytest.approx(100 * (4 / 6 + 2 / 5 + 1 / 2) / 3)
    assert found["iou_b_material"] == pytest.approx(100 * (1 + 3 / 4 + 1 / 4) / 3)
    assert found["iou_c"] == pytest.approx(100 * (1 + 3 / 4) / 3)


def test_a_cluster_too_many_costs_where_the_number_is_free_and_only_there() -> None:
    regions = np.array([0] * 50 + [1] * 50)
    free = np.array([0] * 50 + [1] * 49 + [2], np.uint8)
    found = score_segments(regions, regions, Segmentation(of_all(regions).labels, free))
    assert found["iou_a"] == found["iou_b_material"] == 100
    assert found["iou_c"] == pytest.approx(100 * (1 + 49 / 50) / 3)


def test_an_object_of_one_region_has_neither_a_nor_b_but_c() -> None:
    parts = np.array([1, 2] * 5)
    found = score_segments(np.zeros(10, int), parts, of_all(parts))
    assert isnan(found["iou_a"])
    assert isnan(found["iou_b_material"])
    assert found["iou_b_part"] == 100
    assert found["iou_c"] == pytest.approx(100 * 0.5 / 2)


def test_a_region_of_one_voxel_counts_as_much_as_the_others() -> None:
    regions = np.array([0] * 99 + [1])
    found = score_segments(regions, regions, of_all(np.zeros(100, int)))
    assert found["iou_a"] == pytest.approx(99 / 2)


def test_fewer_clusters_than_k_leave_regions_that_count_nothing() -> None:
    regions = np.array([0, 1, 2, 3])
    found = score_segments(regions, regions, of_all(np.array([0, 1, 1, 1])))
    assert found["iou_a"] == pytest.approx(100 * (1 + 1 / 3) / 4)


def test_more_regions_than_the_largest_k_are_all_counted() -> None:
    regions = np.arange(25)
    found = score_segments(regions, regions, of_all(np.minimum(regions, 18)))
    assert found["iou_a"] == pytest.approx(100 * (18 + 1 / 7) / 25)
