"""One extra filter for a folder: what its labelled parts and masses say of the beam."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from tests.builder.poly_scenes import TUBE, Solid, box, captured, cylinder
from xden1k.rays import ownership_order
from xden_builder.poly.hardness import Hardness, join
from xden_builder.poly.settings import PolySettings
from xden_builder.poly.survey import FILTERS_MM_CU, Clue, survey


def clue(filter_mm, *, off=0.0, sd=0.03, slope=2.0, name="aluminium"):
    """What a part says that lies off by so much behind the right filter."""
    apart = tuple(slope * (mm - filter_mm) + off for mm in FILTERS_MM_CU)
    return Clue(name, apart, sd)


def folder(*clues):
    return {f"object-{number}": (each,) for number, each in enumerate(clues)}


def test_clues_of_one_filter_give_that_filter():
    found = join(folder(*[clue(0.12) for _ in range(8)]))
    assert found.filter_mm_cu == pytest.approx(0.12, abs=0.003)
    assert found.contradicts
    assert (found.clues, found.objects, found.two_tubes_mm_cu) == (8, 8, None)


def test_its_deviation_falls_with_the_root_of_the_number_of_clues():
    few, many = (join(folder(*[clue(0.2)] * count)) for count in (6, 24))
    assert few.sd_mm_cu / many.sd_mm_cu == pytest.approx(2.0, rel=0.1)


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
    assert found.sd_mm_cu > 0


def test_a_filter_that_was_measured_is_left_by_clues_that_clearly_tell_another_only():
    few, many = ([clue(0.2, sd=0.08)] * count for count in (2, 200))
    assert join(folder(*few)).filter_mm_cu > 0.1
    assert join(folder(*few), calibrated=True).filter_mm_cu < 0.03
    assert join(folder(*many), calibrated=True).filter_mm_cu > 0.1


def test_two_tubes_in_one_folder_are_told():
    found = join(folder(*[clue(0.0)] * 6, *[clue(0.2)] * 6))
    assert found.two_tubes_mm_cu == pytest.approx((0.0, 0.2), abs=0.02)


def test_a_filter_is_not_called_missing_within_three_deviations():
    assert not Hardness(0.05, 0.02, 4, 4, None).contradicts
    assert Hardness(0.07, 0.02, 4, 4, None).contradicts
    assert not Hardness(0.015, 0.001, 40, 20, None).contradicts


@cache
def clues_of(copper_mm, *, weighed=False):
    """Clues of an aluminium tool with a plastic grip whose tube has more copper than told."""
    solids = (
        Solid("blade", box((0.9, 0.5, 6.0), (0.3, 0.2, 2.5)), "aluminium", 2.70),
        Solid("grip", box((2.6, 2.2, 4.0), (0.0, 0.0, -2.6)), "pom", 1.41),
        Solid("level", cylinder(0.9, 3.0, (2.6, 0.7, -1.5)), "water", 1.0),
    )
    capture = captured(solids, size=96, tube=TUBE.behind("Cu", copper_mm / 10))
    meshes = [solid.mesh for solid in solids]
    volumes_cm3 = np.array([mesh.volume for mesh in meshes])
    mass_g = float(volumes_cm3 @ [solid.density_g_cm3 for solid in solids])
    told = replace(capture, tube=TUBE, weighed_mass_g=mass_g if weighed else None)
    return survey(told, ownership_order(meshes), volumes_cm3, PolySettings(pose=False))


@pytest.mark.parametrize("copper_mm", [pytest.param(0.0, marks=pytest.mark.slow), 0.1])
def test_the_copper_that_was_not_told_is_found_in_the_images(copper_mm):
    found = join({"tool": clues_of(copper_mm)})
    assert {each.name for each in clues_of(copper_mm)} == {"aluminium", "pom", "water"}
    assert found.filter_mm_cu == pytest.approx(copper_mm, abs=2 * found.sd_mm_cu)
    assert found.sd_mm_cu < 0.03


def test_a_mass_on_the_scale_is_a_clue_too():
    *_, mass = clues_of(0.1, weighed=True)
    right = np.interp(0.1, FILTERS_MM_CU, mass.log_ratio)
    assert mass.name == "mass"
    assert abs(right) < mass.sd
    assert mass.log_ratio[FILTERS_MM_CU.index(0.0)] < -0.05


def test_a_label_that_no_part_bears_is_no_clue():
    assert not {"steel", "mass"} & {each.name for each in clues_of(0.1)}
