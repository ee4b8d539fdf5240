"""Regions, tiles, looks and answers: what is shown, and how it is read."""

from __future__ import annotations

import dataclasses
import io

import numpy as np
import PIL.Image
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.baselines.chat_stub import Parrot
from xden1k.errors import DataError
from xden_baselines.gaussian_property.appearance import Centroids, looks
from xden_baselines.gaussian_property.library import ClosedList, published_list
from xden_baselines.gaussian_property.regions import color_regions, kept_regions
from xden_baselines.gaussian_property.tiles import TILE_PX, three_tiles
from xden_baselines.gaussian_property.voters import Answer, ChatVoter, LooksVoter, parse_answer
from xden_baselines.materials import density_range_g_cm3

ORANGE, GREY, RED = (200, 110, 30), (150, 150, 160), (180, 20, 20)
MATERIALS = ClosedList(("steel", "wood_oak", "abs"), (3, 2, 1))


def painted(*boxes: tuple[tuple[slice, slice], tuple[int, int, int]]) -> tuple:
    picture = np.full((80, 100, 3), 255, dtype=np.uint8)
    mask = np.zeros((80, 100), dtype=bool)
    for place, color in boxes:
        picture[place], mask[place] = color, True
    return picture, mask


TWO = painted((np.s_[10:40, 10:50], ORANGE), (np.s_[40:60, 10:50], GREY))


def test_regions_are_what_is_painted_alike_largest_first() -> None:
    regions = color_regions(*TWO)
    assert (regions[10:40, 10:50] == 1).all()
    assert (regions[40:60, 10:50] == 2).all()
    assert (regions[~TWO[1]] == -1).all()


def test_smooth_shading_does_not_cut_a_region() -> None:
    picture, mask = painted((np.s_[10:60, 10:90], ORANGE))
    light = np.linspace(0.5, 1, 80)[None, :, None]
    picture[10:60, 10:90] = np.rint(picture[10:60, 10:90] * light)
    assert (color_regions(picture, mask)[mask] == 1).all()


def test_what_does_not_touch_is_two_regions() -> None:
    picture, mask = painted((np.s_[10:20, 10:30], ORANGE), (np.s_[10:20, 40:61], ORANGE))
    regions = color_regions(picture, mask)
    assert (regions[10:20, 40:61] == 1).all()
    assert (regions[10:20, 10:30] == 2).all()


def test_a_speck_is_object_but_no_region() -> None:
    picture, mask = painted((np.s_[10:40, 10:50], ORANGE), (np.s_[50, 50], GREY))
    regions = color_regions(picture, mask)
    assert regions[50, 50] == 0
    assert regions.max() == 1


def test_the_largest_region_stays_however_small() -> None:
    picture, mask = painted((np.s_[50, 50], GREY))
    assert color_regions(picture, mask)[50, 50] == 1


def test_an_empty_view_has_no_region() -> None:
    picture, mask = painted()
    regions = color_regions(picture, mask)
    assert (regions == -1).all()
    assert looks(picture, regions).shape == (0, 6)


@given(st.permutations(range(1, 5)))
def test_numbers_of_parts_do_not_matter_to_the_regions(numbers: list[int]) -> None:
    plain = np.repeat(np.repeat(np.array([[1, 2], [3, 4]]), 10, axis=0), 10, axis=1)
    mask = np.ones_like(plain, dtype=bool)
    renamed = np.array([0, *numbers])[plain]
    one, kept = kept_regions(plain, mask)
    other, kept_renamed = kept_regions(renamed, mask)
    np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(np.array([0, *numbers])[kept], kept_renamed)


def test_three_tiles_show_the_whole_where_and_close_up() -> None:
    picture, mask = TWO
    region = color_regions(picture, mask) == 2
    tiles = three_tiles(picture, region)
    assert tiles.shape == (TILE_PX, 3 * TILE_PX, 3)
    whole, where, close = np.split(tiles.astype(int), 3, axis=1)
    # 100 px across on 224; 20 black px above and below make it square
    scale = TILE_PX / 100
    grey, orange = (int(60 * scale), int(30 * scale)), (int(35 * scale), int(30 * scale))
    assert whole[grey].tolist() == list(GREY)
    assert whole[orange].tolist() == where[orange].tolist() == list(ORANGE)
    np.testing.assert_allclose(
        where[grey], 0.6 * np.array(GREY) + 0.4 * np.array([255, 0, 0]), atol=1
    )
    # 40 by 20 px: as wide as the tile, black above and below
    assert close[TILE_PX // 2, 5].tolist() == list(GREY)
    assert close[5, TILE_PX // 2].tolist() == [0, 0, 0]


def test_the_close_up_is_of_the_largest_piece_and_nothing_beside_it() -> None:
    picture, mask = painted((np.s_[10:30, 10:30], GREY), (np.s_[50:53, 50:53], GREY))
    picture[10:30, 30:40], mask[10:30, 30:40] = ORANGE, True
    region = mask & (picture == GREY).all(axis=-1)
    close = np.split(three_tiles(picture, region), 3, axis=1)[2]
    assert (close == GREY).all()


def test_looks_are_means_shares_and_deviation() -> None:
    picture, mask = painted((np.s_[10:40, 10:50], (102, 51, 0)), (np.s_[60:70, 10:20], (0, 0, 0)))
    picture[10:40, 10:30] = (204, 102, 0)
    segmentation = np.where(mask, 1, -1).astype(np.int32)
    segmentation[60:70, 10:20] = 2
    first, black = looks(picture, segmentation)
    assert first == pytest.approx([0.6, 0.3, 0, 2 / 3, 1 / 3, 0.1])
    assert black == pytest.approx([0] * 6)


CENTROIDS = Centroids(
    np.array([[0.0] * 6, [3.0] * 6, [1.0] * 6]),
    np.array([0, 1, 1]),
    np.array([2, 1, 1]),
    np.full(6, 2.0),
    spread=1.0,
)


def test_likelihoods_of_a_materials_centroids_add_up() -> None:
    chosen, sure = CENTROIDS.classify(np.array([[0.0] * 6, [6.0] * 6]))
    assert chosen.tolist() == [0, 1]
    # squared distances of (0, ...) from the centroids: 0, 6 * 3² and 6 * 1²; of (3, ...): 54, 0, 24
    assert sure[0] == pytest.approx(2 / (2 + np.exp(-27) + np.exp(-3)))
    assert sure[1] == pytest.approx((1 + np.exp(-12)) / (1 + np.exp(-12) + 2 * np.exp(-27)))


def test_of_materials_that_look_alike_the_commonest_wins_then_the_first_of_the_list() -> None:
    places, one = np.zeros((2, 6)), np.ones(6)
    grey = np.zeros((1, 6))
    common = Centroids(places, np.array([0, 1]), np.array([1, 9]), one, spread=1.0)
    assert common.classify(grey)[0].tolist() == [1]
    assert common.classify(grey)[1] == pytest.approx([0.9])
    even = Centroids(places, np.array([1, 0]), np.array([5, 5]), one, spread=1.0)
    assert even.classify(grey)[0].tolist() == [0]


@pytest.mark.parametrize(
    "changed",
    [
        {"sizes": np.array([1, 0, 1])},
        {"spread": 0.0},
        {"deviation": np.zeros(6)},
    ],
)
def test_centroids_that_are_none_are_refused(changed: dict) -> None:
    with pytest.raises(DataError, match="centroids"):
        dataclasses.replace(CENTROIDS, **changed)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a handle, wood oak, 0.8", Answer(1, 0.8)),
        ("a handle, with a hole, Wood_Oak, 1", Answer(1, 1.0)),
        (" a blade, STEEL, 85% \n", Answer(0, 0.85)),
        ("a cap, abs, .5.", Answer(2, 0.5)),
        ("(a blade, steel, 0.9)", Answer(0, 0.9)),
        ("```\na blade, steel, 0.9\n```", Answer(0, 0.9)),
        ("Here is my answer:\n\n1. a blade, **Steel**, 0.9", Answer(0, 0.9)),
        ("<think>a, wood oak, 0.1</think>\na blade, steel, 0.9", Answer(0, 0.9)),
        ("a handle or wood oak, 0.1?\n</think>\na blade, steel, 0.9", Answer(0, 0.9)),
        ("Caption: a blade, Material: steel, Confidence: 0.9", Answer(0, 0.9)),
        ("a handle, Oak Wood, confidence: 90%", Answer(1, 0.9)),
        ("a handle, wood, 0.6", Answer(1, 0.6)),
        ("a blade, steel (0.9)", Answer(0, 0.9)),
        ("a blade, metal (steel), 0.9", Answer(0, 0.9)),
        ("Answer: (a blade, steel, 0.9)", Answer(0, 0.9)),
        ("a blade; steel; ~0.9", Answer(0, 0.9)),
        ("Caption: a blade\nMaterial: steel\nConfidence: 90 %", Answer(0, 0.9)),
    ],
)
def test_an_answer_is_read_from_the_right(text: str, expected: Answer) -> None:
    assert parse_answer(text, MATERIALS) == expected


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected one line 'caption, material, confidence'"),
        ("I cannot see any part.", "expected one line 'caption, material, confidence'"),
        ("steel, 0.9", "expected one line 'caption, material, confidence'"),
        ("a blade, steel, sure", "expected one line 'caption, material, confidence'"),
        ("a blade, steel, 0.9\nbecause it shines, steel, 0.9", "expected one line 'caption"),
        ("a blade, steel, 90", "expected a confidence from 0 to 1, got 90"),
        ("a blade, unobtainium, 0.9", "expected a material of .*, got 'unobtainium'"),
        ("Material: steel", "expected one line 'caption, material, confidence'"),
        ("Material: steel\nMaterial: oak\nConfidence: 0.9", "expected one line 'caption"),
        ("a blade, , 0.9", "expected a material of .*, got ''"),
        ("a blade, not steel, 0.9", "expected a material of .*, got 'not steel'"),
        ("a blade, unknown (no steel), 0.2", "expected a material of .*, got 'unknown"),
        ("<think>a blade, steel, 0.9", "ends within a thought"),
    ],
)
def test_what_is_no_answer_is_refused(text: str, message: str) -> None:
    with pytest.raises(DataError, match=message):
        parse_answer(text, MATERIALS)


@pytest.mark.parametrize(
    ("name", "expected"),
    [("Stainless Steel", "steel"), ("soft plastic", "plastic"), ("aluminum", "aluminium")],
)
def test_a_list_of_families_takes_a_name_that_says_more(name: str, expected: str) -> None:
    materials = published_list()
    found = parse_answer(f"a part, {name}, 0.5", materials)
    assert materials.names[found.material] == expected


def test_of_names_that_hold_one_another_the_longest_counts() -> None:
    materials = ClosedList(("steel", "stainless_steel", "glass"), (3, 2, 1))
    for name in ("brushed stainless steel", "Material: stainless steel"):
        assert parse_answer(f"a part, {name}, 0.5", materials).material == 1
    with pytest.raises(DataError, match="got 'stainless steel and glass'"):
        parse_answer("a part, stainless steel and glass, 0.5", materials)


def test_a_name_that_holds_two_of_the_list_is_refused() -> None:
    with pytest.raises(DataError, match="got 'glass filled plastic'"):
        parse_answer("a part, glass filled plastic, 0.5", published_list())


def test_the_published_list_has_the_densities_of_the_text_and_of_the_library() -> None:
    materials = published_list()
    ranges = dict(zip(materials.names, materials.ranges_g_cm3.tolist(), strict=True))
    assert len(ranges) == 12
    assert ranges["steel"] == [7.75, 8.05]
    assert ranges["leather"] == list(density_range_g_cm3("leather"))
    assert ranges["wood"] == list(density_range_g_cm3("wood_generic"))
    assert ranges["marble"] == [2.3, density_range_g_cm3("limestone")[1]]
    assert materials.shares == pytest.approx(1 / 12)
    with pytest.raises(DataError, match="a range for each of"):
        ClosedList(("steel", "tin"), (1, 1), ((7.0, 8.0),))


def test_the_chat_model_is_shown_each_region_and_the_list() -> None:
    model = Parrot(lambda request: "a thing, abs, 0.7")
    voter = ChatVoter(model, MATERIALS, LooksVoter(CENTROIDS))
    segmentation = color_regions(*TWO)
    assert voter.vote("drill-0001", TWO[0], segmentation) == (Answer(2, 0.7), Answer(2, 0.7))
    assert len({request.images for request in model.asked}) == 2
    for number, request in enumerate(model.asked, 1):
        assert "steel, wood oak, abs" in request.text
        (image,) = request.images
        shown = np.asarray(PIL.Image.open(io.BytesIO(image)))
        np.testing.assert_array_equal(shown, three_tiles(TWO[0], segmentation == number))


def test_where_the_chat_model_makes_no_sense_the_classifier_answers_and_says_so() -> None:
    model = Parrot(lambda request: "no idea")
    own = LooksVoter(CENTROIDS)
    voter = ChatVoter(model, MATERIALS, own, retries=1)
    segmentation = color_regions(*TWO)
    answers = voter.vote("drill-0001", TWO[0], segmentation)
    assert [answer.fallback for answer in answers] == [True, True]
    plain = own.vote("drill-0001", TWO[0], segmentation)
    assert [answer.material for answer in answers] == [answer.material for answer in plain]
    assert [request.seed for request in model.asked] == [100, 101] * 2
    assert voter.source.startswith("parrot; if it fails, classifier of colours")


@pytest.mark.parametrize(
    ("names", "objects", "message"),
    [
        ((), (), "must name some"),
        (("steel", "steel"), (1, 1), "each once"),
        (("steel",), (), "a count for each"),
        (("steel",), (0,), "a count for each"),
    ],
)
def test_a_list_that_is_none_is_refused(names: tuple, objects: tuple, message: str) -> None:
    with pytest.raises(DataError, match=message):
        ClosedList(names, objects)


def test_a_list_has_the_librarys_ranges_and_the_training_splits_shares() -> None:
    assert MATERIALS.ranges_g_cm3.tolist() == [[7.75, 7.9], [0.6, 0.9], [1.02, 1.08]]
    assert MATERIALS.middles_g_cm3 == pytest.approx([7.825, 0.75, 1.05])
    assert MATERIALS.shares == pytest.approx([1 / 2, 1 / 3, 1 / 6])
