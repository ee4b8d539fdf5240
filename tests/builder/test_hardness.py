"""One extra filter for a folder: what its labelled parts and masses say of the beam."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.special import erfinv

from tests.builder.poly_scenes import TUBE, Solid, box, captured, cylinder
from xden_builder.capture.space import divide
from xden_builder.poly.hardness import SURVEY_SD_MM, Hardness, join, pilots
from xden_builder.poly.settings import PolySettings
from xden_builder.poly.survey import FILTERS_MM_CU, Clue, survey


def clue(
    filter_mm,
    *,
    off=0.0,
    sd=0.03,
    own_sd=0.005,
    composition_sd=0.0,
    slope=2.0,
    name="aluminium",
):
    """What a part says that lies off by so much behind the right filter."""
    apart = tuple(slope * (mm - filter_mm) + off for mm in FILTERS_MM_CU)
    return Clue(name, apart, sd, own_sd, composition_sd)


def folder(*clues):
    return {f"object-{number}": (each,) for number, each in enumerate(clues)}


def test_clues_of_one_filter_give_that_filter():
    found = join(folder(*[clue(0.12) for _ in range(8)]))
    assert found.filter_mm_cu == pytest.approx(0.12, abs=0.003)
    assert found.contradicts
    assert (found.clues, found.objects, found.two_tubes_mm_cu) == (8, 8, None)


def scattered(filter_mm, count, times=1.0):
    """Clues that err by so many times as much as they say."""
    offs = times * 0.03 * np.sqrt(2) * erfinv(np.linspace(-1, 1, count + 2)[1:-1])
    return folder(*[clue(filter_mm, off=off) for off in offs])


def test_its_deviation_falls_with_the_root_of_the_number_of_clues_down_to_what_they_share():
    few, many, most = (join(scattered(0.2, count)).sd_mm_cu for count in (12, 48, 1200))
    few, many = (np.sqrt(sd**2 - SURVEY_SD_MM**2) for sd in (few, many))
    assert few / many == pytest.approx(2.0, rel=0.15)
    assert most == pytest.approx(SURVEY_SD_MM, rel=0.1)


def test_its_deviation_goes_by_how_far_the_clues_are_apart():
    near, far = (join(scattered(0.2, 12, times)).sd_mm_cu for times in (0.3, 1.0))
    assert near < 0.6 * far


def test_clues_of_a_narrow_range_tell_more_of_it_where_errors_are_small():
    sure = scattered(0.1, 30, 0.2)
    wide = [clue(0.08, sd=0.031, own_sd=0.03, name="abs") for _ in range(30)]
    found = join(sure | {f"more-{number}": (each,) for number, each in enumerate(wide)})
    assert found.filter_mm_cu == pytest.approx(0.1, abs=0.003)


def test_a_filter_that_rests_on_one_label_is_told_with_that_label():
    glass = [clue(0.2, name="glass_soda_lime") for _ in range(4)]
    vague = clue(0.0, sd=2.0, name="water")
    found = join(folder(*glass, vague))
    assert found.contradicts
    assert found.rests_on == ("glass_soda_lime",)
    more = join(folder(*glass, vague, *[clue(0.2, name="steel") for _ in range(4)]))
    assert more.contradicts
    assert more.rests_on == ()
    assert join(folder(*[clue(0.0) for _ in range(4)])).rests_on == ()


def test_a_filter_told_right_stays_as_it_is():
    found = join(folder(*[clue(0.0) for _ in range(8)]))
    assert abs(found.filter_mm_cu) < 0.002
    assert not found.contradicts


def test_labels_that_err_move_the_filter_by_less_than_its_deviation():
    right = [clue(0.1) for _ in range(9)]
    found = join(folder(*right, clue(0.1, off=0.6), clue(0.1, off=-0.9), clue(0.1, off=1.2)))
    assert abs(found.filter_mm_cu - 0.1) < found.sd_mm_cu


def test_without_a_clue_the_told_filter_is_believed():
    found = join({"object": ()})
    assert (found.filter_mm_cu, found.clues, found.contradicts) == (0.0, 0, False)


def test_no_clue_makes_no_surer_of_the_filter_than_one_that_says_nothing():
    vague = join(folder(clue(0.0, sd=5.0, slope=0.01)))
    nothing = join({"object": ()})
    assert nothing.sd_mm_cu == pytest.approx(np.hypot(vague.sd_mm_cu, vague.filter_mm_cu), rel=0.05)
    assert join({"object": ()}, calibrated=True).sd_mm_cu < 0.2 * nothing.sd_mm_cu


def test_a_filter_that_was_measured_is_left_by_clues_that_clearly_tell_another_only():
    few, many = ([clue(0.2, sd=0.08)] * count for count in (2, 200))
    assert join(folder(*few)).filter_mm_cu > 0.1
    assert join(folder(*few), calibrated=True).filter_mm_cu < 0.03
    assert join(folder(*many), calibrated=True).filter_mm_cu > 0.1


def test_two_tubes_in_one_folder_are_told():
    found = join(folder(*[clue(0.0)] * 6, *[clue(0.2)] * 6))
    assert found.two_tubes_mm_cu == pytest.approx((0.0, 0.2), abs=0.02)


def test_objects_without_a_clue_are_no_voices_for_a_second_tube():
    alone = folder(*[clue(0.2)] * 8, clue(0.0))
    assert join(alone).two_tubes_mm_cu is None
    assert join(alone | {"plain": (), "bare": ()}).two_tubes_mm_cu is None


def test_ten_objects_of_forty_eight_of_another_tube_are_told():
    noise = np.random.default_rng(8).normal(0, 0.015, (2, 48))
    other = np.arange(48) < 10
    pairs = [
        (clue(0.3 * each, off=one), clue(0.3 * each, off=two))
        for each, one, two in zip(other.tolist(), *noise, strict=True)
    ]
    found = join({f"object-{number}": both for number, both in enumerate(pairs)})
    assert found.two_tubes_mm_cu == pytest.approx((0.0, 0.3), abs=0.05)


@pytest.mark.parametrize("seed", range(3))
def test_many_objects_of_one_tube_are_never_two(seed):
    offs = np.random.default_rng(seed).normal(0, 0.03, 200)
    assert join(folder(*[clue(0.0, off=off) for off in offs])).two_tubes_mm_cu is None


def test_a_label_that_is_wrong_by_a_factor_invents_no_second_tube():
    """Lead glass for soda-lime glass: a thicker filter would explain a tenth of it."""
    rest = [clue(0.0) for _ in range(12)]
    for slope in (-1.3, 1.3):
        wrong = [clue(0.0, off=-3.7, sd=0.05, slope=slope), clue(0.0, off=-1.8, slope=slope)]
        unsure = clue(0.2, sd=0.2, slope=0.2)
        found = join(folder(*rest, *wrong, unsure))
        assert found.two_tubes_mm_cu is None
        assert abs(found.filter_mm_cu) < found.sd_mm_cu


def test_a_filter_is_not_called_missing_within_three_deviations():
    assert not Hardness(0.05, 0.02, 4, 4, None, 1.0, 1.0).contradicts
    assert Hardness(0.07, 0.02, 4, 4, None, 1.0, 1.0).contradicts
    assert not Hardness(0.015, 0.001, 40, 20, None, 1.0, 1.0).contradicts


SLOPES = {"steel": 0.7, "aluminium": 0.7, "water": 0.4, "glass_soda_lime": 0.9}
"""By how much, as logarithms, a millimetre of copper more makes them denser, to 0.5 mm."""


def test_parts_that_no_filter_explains_are_told_apart_from_a_harder_beam():
    """Images through a square root halve whatever they show."""
    halved = [clue(0, off=np.log(0.5), slope=slope, name=name) for name, slope in SLOPES.items()]
    assert join(folder(*halved)).no_filter_explains
    assert not join(folder(*halved[:2])).no_filter_explains, "two objects say nothing"
    harder = [clue(0.3, slope=slope, name=name) for name, slope in SLOPES.items()]
    assert not join(folder(*harder)).no_filter_explains


def test_pores_and_masses_in_another_unit_are_no_images_that_are_not_linear():
    sound = [clue(0.0) for _ in range(3)]
    printed = [clue(0.0, off=np.log(share), name="abs") for share in (0.45, 0.5, 0.6, 0.5)]
    ounces = [clue(0.0, off=np.log(28.35), name="mass") for _ in range(6)]
    for others in (printed, ounces):
        found = join(folder(*sound, *others))
        assert found.label_ratio == pytest.approx(1.0, abs=0.05)
        assert not found.no_filter_explains


@pytest.mark.parametrize(("share", "told"), [(0.43, True), (0.75, True), (0.9, False)])
def test_plastics_tell_images_that_are_not_linear_where_nothing_else_can(share, told):
    """Decimal logarithms show 0.43 of what natural ones do, a power of 0.75 so much."""
    plastics = [clue(0.0, off=np.log(share), slope=0.25, name=name) for name in ("abs", "pp", "pc")]
    foamed = clue(0.0, off=np.log(0.5), slope=0.25, name="ps")
    assert join(folder(*plastics, foamed)).plastics_are_light == told
    assert not join(folder(*plastics[:2])).plastics_are_light, "two clues say nothing"
    sound = [clue(0.0, slope=slope, name=name) for name, slope in SLOPES.items()]
    assert not join(folder(*plastics, *sound)).plastics_are_light, "metals are as they should be"


@cache
def clues_of(copper_mm, *, weighed=False, off=(1.0, 1.0, 1.0)):
    """Clues of an aluminium tool with a plastic grip whose tube has more copper than told.

    What parts attenuate may be off by some factors.
    """
    solids = (
        Solid("blade", box((0.9, 0.5, 6.0), (0.3, 0.2, 2.5)), "aluminium", 2.70 * off[0]),
        Solid("grip", box((2.6, 2.2, 4.0), (0.0, 0.0, -2.6)), "pom", 1.41 * off[1]),
        Solid("level", cylinder(0.9, 3.0, (2.6, 0.7, -1.5)), "water", 1.0 * off[2]),
    )
    capture = captured(solids, size=96, tube=TUBE.behind("Cu", copper_mm / 10))
    space = divide(capture.parts)
    mass_g = float(space.volumes_cm3 @ [solid.density_g_cm3 for solid in solids])
    told = replace(capture, tube=TUBE, weighed_mass_g=mass_g if weighed else None)
    return survey(told, space, PolySettings(pose=False))


@pytest.mark.parametrize("copper_mm", [pytest.param(0.0, marks=pytest.mark.slow), 0.1])
def test_the_copper_that_was_not_told_is_found_in_the_images(copper_mm):
    found = join({"tool": clues_of(copper_mm)})
    assert {each.name for each in clues_of(copper_mm)} == {"aluminium", "pom", "water"}
    assert found.filter_mm_cu == pytest.approx(copper_mm, abs=2 * found.sd_mm_cu)
    assert found.sd_mm_cu < 0.03


def test_images_of_the_librarys_materials_make_errors_small_whatever_the_filter():
    found = join({f"tool-{number}": clues_of(0.1) for number in range(8)})
    assert found.image_scale < 0.5
    assert found.composition_scale < 0.5


def test_images_of_other_compositions_leave_errors_as_they_are():
    clues = clues_of(0.1, off=(0.95, 1.22, 1.07))
    found = join({f"tool-{number}": clues for number in range(8)})
    assert max(found.image_scale, found.composition_scale) > 1


def test_a_mass_on_the_scale_is_a_clue_too():
    *_, mass = clues_of(0.1, weighed=True)
    right = np.interp(0.1, FILTERS_MM_CU, mass.log_ratio)
    assert mass.name == "mass"
    assert abs(right) < mass.sd
    assert mass.log_ratio[FILTERS_MM_CU.index(0.0)] < -0.05


def parts_of(images, count, *, compositions=None, seed=0, filter_mm=0.0, astray=0):
    """Clues of metals and plastics that err by multiples of what is assumed, some far astray.

    Compositions as images where nothing else is said.
    """
    rng = np.random.default_rng(seed)
    found = []
    for number in range(count):
        metal = number % 2 == 0
        image_sd, composition_sd, own_sd = (0.024, 0.02, 0.006) if metal else (0.014, 0.03, 0.012)
        multiples = images, images if compositions is None else compositions
        errors = np.hypot(*np.multiply(multiples, (image_sd, composition_sd)))
        off = rng.normal(0, np.hypot(own_sd, errors))
        if number < astray:
            off = rng.choice([-1, 1]) * rng.uniform(0.3, 1.5)
        sd = float(np.linalg.norm([own_sd, image_sd, composition_sd]))
        sds = {"sd": sd, "own_sd": own_sd, "composition_sd": composition_sd}
        found.append(clue(filter_mm, off=off, slope=2.0 if metal else 0.6, **sds))
    return folder(*found)


def larger_scale(found):
    return max(found.image_scale, found.composition_scale)


@pytest.mark.parametrize("filter_mm", [0.0, 0.15])
def test_parts_nearer_to_their_materials_than_assumed_make_errors_small(filter_mm):
    found = [join(parts_of(0.2, 30, seed=seed, filter_mm=filter_mm)) for seed in range(5)]
    assert all(0.1 < each.image_scale < 0.5 for each in found)
    assert all(0.1 < each.composition_scale < 0.5 for each in found)
    settings = found[0].applied(PolySettings())
    assert settings.composition == found[0].composition_scale
    assert settings.clear_floor == pytest.approx(found[0].image_scale * PolySettings().floor)
    assert settings.floor == PolySettings().floor
    assert settings.edge_error_cm == PolySettings().edge_error_cm


def test_parts_as_far_off_as_assumed_leave_errors_near_what_they_are():
    found = [join(parts_of(1.0, 30, seed=seed)) for seed in range(8)]
    for scales in zip(*((each.image_scale, each.composition_scale) for each in found), strict=True):
        assert np.mean(scales) == pytest.approx(0.95, abs=0.1)
        assert min(scales) > 0.5


def test_compositions_that_err_are_told_from_images_that_do():
    for seed in range(5):
        things = join(parts_of(0.1, 80, compositions=1.0, seed=seed))
        images = join(parts_of(1.0, 80, compositions=0.1, seed=seed))
        assert things.composition_scale > 1.5 * images.composition_scale
        assert images.image_scale > 1.2 * things.image_scale
        usual, settings = PolySettings(), things.applied(PolySettings())
        assert settings.composition == things.composition_scale
        assert settings.model_share == pytest.approx(things.image_scale * usual.model_share)
        times = min(things.composition_scale**-2, 1 / usual.mixture_share)
        assert settings.mixture_share == pytest.approx(times * usual.mixture_share)


def test_clues_of_one_kind_tell_what_compositions_and_images_make_together():
    """And hardly which: metals alone."""
    for seed in range(4):
        metals = dict([*parts_of(0.1, 120, compositions=1.0, seed=seed).items()][::2])
        found = join(metals)
        together = np.hypot(0.024 * found.image_scale, 0.02 * found.composition_scale)
        assert together == pytest.approx(np.hypot(0.024 * 0.1, 0.02), rel=0.25)


def test_parts_farther_off_than_assumed_are_told_and_leave_errors_as_they_are():
    for seed in range(5):
        found = join(parts_of(2.0, 40, seed=seed))
        assert larger_scale(found) > 1.1
        settings = found.applied(PolySettings())
        assert settings.composition == 1
        assert settings.mixture_share == PolySettings().mixture_share


@pytest.mark.parametrize(
    ("image_scale", "times"), [(0.1, 10), (0.5, 4), (0.9, 1 / 0.81), (1.0, 1), (2.0, 1)]
)
def test_small_errors_let_images_move_mixtures_and_never_by_more_than_they_say(image_scale, times):
    settings = Hardness(0.0, 0.01, 30, 10, None, image_scale, image_scale).applied(PolySettings())
    assert settings.mixture_share == pytest.approx(times * PolySettings().mixture_share)
    assert settings.mixture_share <= 1


def test_few_parts_hardly_move_the_errors():
    assert join(parts_of(0.2, 1)).image_scale > 0.95
    assert join(parts_of(0.2, 2)).image_scale > 0.75
    assert join(parts_of(0.2, 2)).composition_scale > 0.75


def test_labels_that_err_do_not_widen_the_errors():
    right, astray = (larger_scale(join(parts_of(0.2, 36, astray=count))) for count in (0, 8))
    assert astray == pytest.approx(right, abs=0.1)


def test_a_range_of_densities_is_no_error():
    """Parts of one label that scatter as its densities do say that nothing else errs."""
    rng = np.random.default_rng(3)
    wide = [clue(0.0, off=rng.normal(0, 0.1), sd=0.13, own_sd=0.1, slope=0.6) for _ in range(40)]
    assert join(folder(*wide)).image_scale < 0.75


def test_masses_on_a_scale_say_nothing_of_how_far_labels_err():
    masses = folder(*[clue(0.0, sd=0.05, own_sd=0.05, name="mass") for _ in range(20)])
    assert join(masses).applied(PolySettings()).composition == 1


def test_clues_of_images_say_what_of_them_is_the_materials_own():
    for each in clues_of(0.1):
        assert np.hypot(each.own_sd, each.composition_sd) < each.sd
        assert min(each.own_sd, each.composition_sd) > 0
    *_, mass = clues_of(0.1, weighed=True)
    assert mass.own_sd == mass.sd


def test_the_order_of_objects_changes_nothing():
    clues = parts_of(0.3, 20)
    assert pilots(clues) == pilots(reversed(list(clues)))
    assert join(clues) == join(dict(sorted(clues.items())))


def test_a_label_that_no_part_bears_is_no_clue():
    assert not {"steel", "mass"} & {each.name for each in clues_of(0.1)}
