"""The vote in 3D: majorities, ties, weights, visibility, hidden parts."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from tests.baselines.painted import camera_at, sphere_pictures
from xden_baselines.gaussian_property.library import ClosedList
from xden_baselines.gaussian_property.lifting import (
    Judged,
    chosen_views,
    vote_of_parts,
    vote_of_points,
    with_hidden,
)
from xden_baselines.gaussian_property.voters import Answer
from xden_baselines.gaussian_property.voting import (
    UNIT,
    cast,
    expected_density_g_cm3,
    new_ballots,
    winners,
)
from xden_baselines.views.pictures import Pictures

STEEL, OAK, ABS = range(3)
MATERIALS = ClosedList(("steel", "wood_oak", "abs"), (1, 1, 2))
FRONT, BACK, LEFT, RIGHT = (0, -5, 0.1), (0, 5, 0.1), (-5, 0, 0.1), (5, 0, 0.1)
VIEWS = sphere_pictures([camera_at(place) for place in (FRONT, BACK, LEFT, RIGHT)])
SOUTH = np.array([[0.0, -1.0, 0.0]])
SOUTH_WEST = np.array([[-1.0, -1.0, 0.0]]) / np.sqrt(2)


def judged(*materials: int, confidence: float = 1.0) -> list[Judged]:
    """One answer for each view, whose one region is all of the object."""
    return [
        Judged(view, np.where(mask, 1, -1).astype(np.int32), (Answer(material, confidence),))
        for view, (mask, material) in enumerate(zip(VIEWS.masks, materials, strict=False))
    ]


def points_votes(points: np.ndarray, views: list[Judged], **options: bool) -> np.ndarray:
    return vote_of_points(points, VIEWS, views, MATERIALS, tolerance_cm=0.05, **options) / UNIT


def test_a_view_that_does_not_see_a_point_has_no_vote() -> None:
    assert points_votes(SOUTH, judged(STEEL, OAK))[0].tolist() == [1, 0, 0]
    assert points_votes(-SOUTH, judged(STEEL, OAK))[0].tolist() == [0, 1, 0]


def test_views_that_see_a_point_each_have_a_vote() -> None:
    assert points_votes(SOUTH_WEST, judged(STEEL, OAK, ABS, OAK))[0].tolist() == [1, 0, 1]


def test_pixels_in_no_kept_region_have_no_vote() -> None:
    views = judged(STEEL)
    nothing = Judged(0, np.where(VIEWS.masks[0], 0, -1).astype(np.int32), ())
    assert points_votes(SOUTH, views).sum() == 1
    assert points_votes(SOUTH, [nothing]).sum() == 0


def test_each_region_votes_for_its_own_material() -> None:
    left = np.arange(128)[None, :] < 64
    cut = np.where(VIEWS.masks[0], np.where(left, 1, 2), -1).astype(np.int32)
    view = Judged(0, cut, (Answer(STEEL, 1.0), Answer(OAK, 1.0)))
    points = np.array([[-0.5, -0.86, 0.0], [0.5, -0.86, 0.0]])
    assert points_votes(points, [view]).tolist() == [[1, 0, 0], [0, 1, 0]]


@given(st.integers(2, 9), st.integers(0, 2))
def test_a_majority_survives_one_wrong_view(right: int, wrong: int) -> None:
    ballots = new_ballots(1, MATERIALS)
    votes = np.array([wrong, *[OAK] * right])
    cast(ballots, np.zeros(len(votes), dtype=np.int64), votes, np.ones(len(votes)))
    assert winners(ballots).tolist() == [OAK]


@given(st.permutations([STEEL, STEEL, OAK, OAK, ABS]))
def test_ties_go_to_the_first_of_the_list_in_any_order_of_the_votes(votes: list[int]) -> None:
    ballots = new_ballots(1, MATERIALS)
    cast(ballots, np.zeros(5, dtype=np.int64), np.array(votes), np.ones(5))
    assert winners(ballots).tolist() == [STEEL]


def test_without_a_vote_nobody_wins() -> None:
    assert winners(new_ballots(2, MATERIALS)).tolist() == [-1, -1]


@given(
    st.lists(st.tuples(st.integers(0, 2), st.floats(0, 1)), max_size=12).flatmap(
        lambda votes: st.tuples(st.just(votes), st.permutations(votes))
    )
)
def test_weighted_votes_add_up_alike_in_any_order(both: tuple) -> None:
    totals = []
    for votes in both:
        ballots = new_ballots(1, MATERIALS)
        for material, weight in votes:
            cast(ballots, np.array([0]), np.array([material]), np.array([weight]))
        totals.append(expected_density_g_cm3(ballots, MATERIALS))
    np.testing.assert_array_equal(*totals)


def test_a_weighted_vote_counts_by_its_confidence() -> None:
    views = judged(STEEL, confidence=0.25)
    assert points_votes(SOUTH, views, weighted=True)[0].tolist() == [0.25, 0, 0]
    assert points_votes(SOUTH, views, weighted=False)[0].tolist() == [1, 0, 0]


def test_the_expected_density_is_that_of_dirichlet_counts() -> None:
    ballots = UNIT * np.array([[3, 0, 0], [0, 0, 0]])
    mean, sd = expected_density_g_cm3(ballots, MATERIALS)
    # one prior vote in shares 1/4, 1/4, 1/2; middles of steel, oak and ABS: 7.825, 0.75, 1.05
    shares = [[3.25 / 4, 0.25 / 4, 0.5 / 4], [0.25, 0.25, 0.5]]
    draws = np.random.default_rng(0)
    for share, one, deviation in zip(shares, mean, sd, strict=True):
        assert one == pytest.approx(np.dot(share, [7.825, 0.75, 1.05]))
        chosen = draws.choice(3, size=200_000, p=share)
        low, high = MATERIALS.ranges_g_cm3[chosen].T
        assert deviation == pytest.approx(draws.uniform(low, high).std(), rel=0.01)


def test_more_votes_make_it_surer() -> None:
    ballots = UNIT * np.array([[1, 0, 0], [9, 0, 0]])
    mean, sd = expected_density_g_cm3(ballots, MATERIALS)
    assert mean[0] < mean[1] < 7.825
    assert sd[1] < sd[0]


def test_a_part_collects_the_answers_of_the_views_that_show_it() -> None:
    cut = np.ones((2, 2), dtype=np.int32)
    views = [
        Judged(0, cut, (Answer(STEEL, 0.1), Answer(OAK, 0.9))),
        Judged(1, cut, (Answer(STEEL, 0.1),)),
    ]
    votes = vote_of_parts(3, [np.array([2, 0]), np.array([2])], views, MATERIALS) / UNIT
    assert votes.tolist() == [[0, 1, 0], [0, 0, 0], [2, 0, 0]]


def test_a_hidden_part_takes_the_material_of_what_is_nearest_to_it() -> None:
    places = [(0, 0, 0), (10, 0, 0), (9, 0, 0)]
    meshes = [trimesh.creation.box((1, 1, 1)).apply_translation(place) for place in places]
    ballots = UNIT * np.array([[1, 0, 0], [0, 0, 1], [0, 0, 0]])
    filled = with_hidden(ballots, meshes)
    assert winners(filled).tolist() == [STEEL, ABS, ABS]
    np.testing.assert_array_equal(filled[:2], ballots[:2])
    turned = with_hidden(ballots[[2, 1, 0]], [meshes[2], meshes[1], meshes[0]])
    assert winners(turned).tolist() == [ABS, ABS, STEEL]


@given(st.permutations(range(4)))
def test_the_choice_of_views_does_not_depend_on_their_order(order: list[int]) -> None:
    one, other = chosen_views(VIEWS), chosen_views(VIEWS.take(order))
    np.testing.assert_array_equal(one.colors, other.colors)
    np.testing.assert_array_equal(one.distance_cm, other.distance_cm)


def test_ten_views_are_taken_of_many_and_both_ends_among_them() -> None:
    ring = [camera_at((5 * np.cos(a), 5 * np.sin(a), 1.0)) for a in np.linspace(0, 6, 13)]
    blank = np.ones((13, 96, 128), dtype=bool)
    colors = np.zeros((13, 96, 128, 3), dtype=np.uint8)
    pictures = Pictures(colors, blank, blank.astype(np.float32), tuple(ring))
    chosen = chosen_views(pictures)
    assert len(chosen) == 10
    assert len({tuple(camera.position_cm) for camera in chosen.cameras}) == 10
