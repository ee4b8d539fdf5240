"""What a part may be: probabilities that add up, labels believed as far as they deserve."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.builder.poly_scenes import TUBE, box
from xden1k.values.materials import MaterialLibrary, families, load_materials
from xden_builder.capture import CapturePart
from xden_builder.physics.groups import energy_groups
from xden_builder.physics.source import Detector
from xden_builder.poly.materials import shares
from xden_builder.poly.materials.candidates import Candidate, candidate_table, candidates
from xden_builder.poly.materials.shares import grade_shares

LIBRARY = load_materials()
FEW = 8


def mostly_slow(labels):
    """All of them; but for each eighth they are slow tests."""
    return [
        pytest.param(label, marks=[pytest.mark.slow] * (place % FEW > 0))
        for place, label in enumerate(labels)
    ]


EVERY_LABEL = mostly_slow(["", *families(), *sorted(LIBRARY)])
GROUPS = energy_groups(TUBE, Detector("CsI"))


def chance(found: tuple[Candidate, ...], **wanted: str) -> float:
    """Probability of all candidates of a material or a family."""
    return sum(
        math.exp(each.log_prior)
        for each in found
        if wanted.get("material", each.material) == each.material
        and wanted.get("family", LIBRARY[each.material].family) == LIBRARY[each.material].family
    )


@pytest.mark.parametrize("hollow", [False, True])
@pytest.mark.parametrize("label", EVERY_LABEL)
def test_probabilities_add_up_to_one_and_the_likeliest_comes_first(label, hollow):
    found = candidates(label, hollow=hollow)
    assert chance(found) == pytest.approx(1)
    priors = [each.log_prior for each in found]
    assert priors == sorted(priors, reverse=True)
    assert {each.material for each in found} >= set(LIBRARY.bases), "a label rules nothing out"


@pytest.mark.parametrize("label", mostly_slow(sorted(LIBRARY)))
def test_a_label_or_a_grade_of_it_is_the_first_candidate(label):
    assert LIBRARY[candidates(label)[0].material].called(label)
    assert LIBRARY[candidates(label, hollow=True)[0].material].called(label)


@pytest.mark.parametrize("label", ["", "polymer", "abs", "steel", "glass_lead"])
def test_grades_share_what_their_base_has_and_take_nothing_from_others(label):
    bases = MaterialLibrary(tuple(LIBRARY.bases.values()))
    found, alone = candidates(label), material_shares_of(bases, label)
    for name in LIBRARY.bases:
        grades = sum(chance(found, material=each) for each in grade_shares()[name])
        assert grades == pytest.approx(alone[name])


def material_shares_of(library: MaterialLibrary, label: str) -> dict[str, float]:
    """Shares as they are without any grade."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shares, "load_materials", lambda: library)
        patch.setattr(shares, "grade_shares", lambda: {name: {name: 1.0} for name in library})
        return dict(shares.material_shares.__wrapped__(label))


def test_every_grade_has_a_share_and_every_base_keeps_one():
    table = grade_shares()
    grades = {name for name, each in LIBRARY.items() if each.grade_of}
    assert {name for shared in table.values() for name in shared} == grades | set(LIBRARY.bases)
    for shared in table.values():
        assert sum(shared.values()) == pytest.approx(1)
        assert all(share > 0 for share in shared.values())


def test_grades_are_told_apart_within_the_labels_family_alone():
    materials = {each.material for each in candidates("abs")}
    assert {"abs_brominated", "pp_white"} <= materials
    assert not {"brass_leaded", "stoneware"} & materials
    assert {name for name, each in LIBRARY.items() if each.grade_of} <= {
        each.material for each in candidates("")
    }


def test_who_writes_a_grade_is_believed_as_who_writes_a_base():
    for grade in ("abs_brominated", "za_8", "nimh_cell"):
        assert 0.75 < chance(candidates(grade), material=grade) < 1


@pytest.mark.parametrize("label", sorted({*families()} - {"gas", "tissue"}))  # rare ones only
def test_a_familys_name_is_believed_and_chooses_no_member(label):
    found = candidates(label)
    assert LIBRARY[found[0].material].family == label
    assert chance(found, family=label) > 0.8


def test_a_wrong_label_is_likelier_within_its_family():
    found = candidates("aluminium")
    assert chance(found, material="steel") > 3 * chance(found, material="pp")


@pytest.mark.parametrize(("label", "least", "most"), [("steel", 0.85, 1.0), ("gold", 0.0, 0.5)])
def test_labels_of_rare_materials_are_not_believed_outright(label, least, most):
    assert least < chance(candidates(label), material=label) < most


def test_rare_materials_are_seldom_guessed():
    found = candidates("")
    for rare in ("gold", "tungsten", "mercury"):
        assert chance(found, material=rare) < 0.02 * chance(found, material="steel")


@pytest.mark.parametrize("label", EVERY_LABEL)
def test_bounds_hold_the_mean_and_every_deviation_is_positive(label):
    for hollow in (False, True):
        for each in candidates(label, hollow=hollow):
            assert 0 < each.low_g_cm3 < each.mean_g_cm3 < each.high_g_cm3
            assert each.sd_g_cm3 > 0


def test_hollow_parts_may_be_lighter_but_not_denser():
    for label in ("pp", "steel", "water"):
        hollow, solid = candidates(label, hollow=True)[0], candidates(label)[0]
        assert hollow.low_g_cm3 < 0.1 * solid.low_g_cm3
        assert hollow.mean_g_cm3 < solid.mean_g_cm3
        assert hollow.sd_g_cm3 > 5 * solid.sd_g_cm3
        assert hollow.high_g_cm3 <= solid.high_g_cm3


def test_mouldings_may_be_foamed_but_sheet_and_glass_not():
    assert [each.solid for each in candidates("abs") if each.material == "abs"] == [True, False]
    for dense in ("steel", "glass_soda_lime", "water"):
        assert all(each.solid for each in candidates(dense) if each.material == dense)
    for each in candidates("abs"):
        if not each.solid:
            assert each.high_g_cm3 <= LIBRARY[each.material].density_nominal_g_cm3


def test_parts_of_one_label_share_a_table_of_their_candidates():
    one, other, hollow = (
        candidate_table(CapturePart(name, box((1, 1, 1)), "abs", hollow=hollow), GROUPS)
        for name, hollow in (("a", False), ("b", False), ("c", True))
    )
    assert one is other
    assert one is not hollow
    for index in (0, 1, 40):
        each = one.candidates[index]
        mac = GROUPS.mac_cm2_g(LIBRARY[each.material].composition)
        np.testing.assert_array_equal(one.mac_cm2_g[index], mac)
        assert one.log_prior[index] == each.log_prior
        assert one.priors[index].tolist() == [
            each.mean_g_cm3,
            each.sd_g_cm3,
            each.low_g_cm3,
            each.high_g_cm3,
        ]
