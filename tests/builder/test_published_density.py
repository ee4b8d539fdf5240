"""Density from published attenuation: what the paper's fit makes of known materials, and back."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from xden1k.values.materials import load_materials
from xden_builder.physics.attenuation import mac_cm2_g
from xden_builder.physics.source import Tube
from xden_builder.physics.spectrum import tube_spectrum
from xden_builder.published import release_fit
from xden_builder.published.beam import Beam, PartRays, fitted_depth
from xden_builder.published.convention import vote
from xden_builder.published.copies import copies
from xden_builder.published.density import estimate
from xden_builder.published.hypotheses import Hypotheses, families_of, hypotheses, usual_families
from xden_builder.published.likelihood import (
    BEYOND,
    FAINT_SD,
    beside,
    log_evidence,
    log_sd,
    reached,
)
from xden_builder.published.orientation import ORIENTATIONS
from xden_builder.published.release_fit import (
    BeamFit,
    ReleaseFit,
    fit_release,
    part_rays,
    voxels_cm,
)
from xden_builder.published.survey import PartSeen, Survey

BEAM = Beam(filter_mm_al=4.0, stray=0.02, knee=2.1, spread=1.0, axes=(0, 1))
HARDER = replace(BEAM, filter_mm_al=12.0)
KNOWN = ((BEAM, 1.0),)


def slab(
    thickness_cm: float, clear: float = 1.0, volume_cm3: float = 1.0, narrow_cm: float = 3.0
) -> PartRays:
    quarters = np.full(4, 0.25)
    return PartRays(np.full(4, thickness_cm), np.full(4, clear), quarters, volume_cm3, narrow_cm)


def one(material: str) -> Hypotheses:
    nominal = load_materials()[material].density_nominal_g_cm3
    return Hypotheses((material,), np.zeros(1, dtype=np.int64), np.array([nominal]), np.zeros(1))


def lac_of(material: str, rays: PartRays) -> float:
    depth = fitted_depth(rays, one(material), BEAM.filter_mm_al, BEAM.stray)
    return float(depth[0] / rays.mean_cm)


@cache
def survey() -> Survey:
    part = PartSeen(
        *("cap", "bottle", 0.2, 1000.0, [[10.0] * 8] * 3, [[0.0] * 8] * 3),
        *([[10.0, 10.0]] * 3, [100, 100, 100]),
    )
    scores = [[0.5] * 48 for _ in range(2)]
    scores[0][0] = 0.9
    sides = (2.0, 1.0, 1.0), (100.0, 50.0, 50.0), (20.0, 10.0, 10.0), (0.8, 0.4, 0.4)
    return Survey("one", scores, *sides, (0.5, 0.5, 0.5), (part,))


@pytest.mark.parametrize("material", ["water", "aluminium", "steel"])
def test_a_slab_gives_the_coefficient_of_its_own_transmission(material):
    rays, known = slab(0.05), load_materials()[material]
    spectrum = tube_spectrum(Tube(kv=100.0, filtration_cm={"Al": 0.4}))
    path = mac_cm2_g(known.composition, spectrum.energies_kev) * known.density_nominal_g_cm3 * 0.05
    expected = -np.log(float(spectrum.transmission(path)))
    assert fitted_depth(rays, one(material), 4.0, 0.0)[0] == pytest.approx(expected, rel=0.01)


def test_stray_light_and_hardening_lower_what_is_found():
    thin, thick = (lac_of("steel", slab(cm)) for cm in (0.01, 2.0))
    assert thick < 0.3 * thin
    clean, stray = (fitted_depth(slab(1.0), one("steel"), 4.0, share)[0] for share in (0.0, 0.05))
    assert stray == pytest.approx(-np.log(0.05), abs=0.05)
    assert stray < clean


@pytest.mark.parametrize("material", ["water", "wood_oak", "pvc_rigid", "glass_soda_lime"])
def test_a_material_behind_the_known_beam_is_within_its_deviation(material):
    rays, known = slab(1.0), load_materials()[material]
    found = estimate(lac_of(material, rays), "", rays, KNOWN)
    assert abs(found.density_g_cm3 - known.density_nominal_g_cm3) < 2 * found.sd_g_cm3


def test_a_density_is_between_those_of_the_beams_that_remain_and_less_sure_than_behind_one():
    lac_per_cm, rays = lac_of("water", slab(3.0)), slab(3.0)
    soft, hard, either = (
        estimate(lac_per_cm, "water", rays, beams)
        for beams in (KNOWN, ((HARDER, 1.0),), ((BEAM, 0.5), (HARDER, 0.5)))
    )
    assert soft.density_g_cm3 < either.density_g_cm3 < hard.density_g_cm3
    assert either.sd_g_cm3 > soft.sd_g_cm3


def test_aluminium_is_told_from_steel_by_its_attenuation_and_thickness():
    rays = slab(0.5)
    light, heavy = (
        estimate(lac_of(name, rays), "bracket", rays, KNOWN) for name in ("aluminium", "steel")
    )
    assert light.density_g_cm3 < 3.2
    assert heavy.density_g_cm3 > 6.5


def test_the_fit_finds_ever_less_of_what_is_darker_but_never_less_than_of_the_lighter():
    depth = np.geomspace(0.01, 100.0, 50)
    wide, narrow = (reached(depth, narrow_cm, BEAM.knee) for narrow_cm in (1.0, 0.1))
    assert (np.diff(wide) > 0).all()
    assert (np.diff(wide / depth) < 0).all()
    assert (narrow <= wide).all()
    assert wide[-1] / wide[-2] == pytest.approx((depth[-1] / depth[-2]) ** BEYOND, rel=1e-3)


def evidence_lost(factor: float, clear: float) -> float:
    """How much less probable water's coefficient is than itself times a factor."""
    rays, tried = slab(1.0, clear), one("water")
    depth = fitted_depth(rays, tried, BEAM.filter_mm_al, BEAM.stray)
    right, wrong = (
        log_evidence(each * depth[0], rays, tried, depth, BEAM) for each in (1.0, factor)
    )
    return right - wrong


def test_a_gross_error_does_not_outweigh_all_else_that_is_known():
    assert evidence_lost(3.0, clear=0.5) < 15
    assert evidence_lost(1 / 3.0, clear=1.0) < 8


def test_nothing_adds_to_what_a_part_attenuates_where_nothing_else_is_on_the_way():
    assert evidence_lost(3.0, clear=1.0) > 1.5 * evidence_lost(3.0, clear=0.5)
    found = estimate(1.3, "", slab(10.0, volume_cm3=3700.0, narrow_cm=15.0), KNOWN)
    assert found.density_g_cm3 > 2  # heavy as it is, rather than a foam's that errs by 50


def test_what_is_heavy_by_its_kind_is_not_taken_for_light_for_being_heavy():
    rays = slab(10.0, volume_cm3=3700.0, narrow_cm=15.0)
    thing, weight = (estimate(1.3, name, rays, KNOWN) for name in ("", "kettlebell"))
    assert weight.density_g_cm3 + weight.sd_g_cm3 > 7.5
    assert weight.density_g_cm3 > thing.density_g_cm3


def test_an_error_that_adds_is_as_many_deviations_in_the_logarithm_as_in_the_depth():
    rays = PartRays(*[np.ones(1)] * 3, volume_cm3=1.0, narrow_cm=1e6)
    faint, found = np.array([1e-3]), 0.5
    off = np.log(found / faint) / log_sd(faint, found, rays, BEAM.spread)
    assert 0.5 * (found - faint) / FAINT_SD < off < (found - faint) / FAINT_SD


def test_a_blade_that_the_mesh_may_miss_says_less_than_a_plate():
    plate, blade = (estimate(0.3, "", slab(1.0, narrow_cm=cm), KNOWN) for cm in (3.0, 0.1))
    assert blade.sd_g_cm3 > 2 * plate.sd_g_cm3
    named = estimate(0.3, "blade", slab(1.0, narrow_cm=0.1), KNOWN)
    assert named.density_g_cm3 + named.sd_g_cm3 > 6


def test_a_share_of_open_light_explains_any_lower_depth_once():
    found, depth = np.geomspace(1e-6, 2.0, 4000), np.full(1, 2.0)
    density = [float(beside(value, depth)[0]) for value in found.tolist()]
    assert np.trapezoid(density, np.log(found)) == pytest.approx(1.0, abs=0.01)
    assert beside(2.1, depth)[0] == 0


def test_a_category_speaks_for_what_its_things_are_made_of():
    assert usual_families("tea_cup") == {"ceramic", "liquid"}
    assert usual_families("gadget") == frozenset()
    rays = slab(0.5)
    lac_per_cm = lac_of("porcelain", rays)
    plain, told = (estimate(lac_per_cm, "", rays, KNOWN, (), kind) for kind in ("", "mug"))
    assert told.density_g_cm3 <= plain.density_g_cm3


def test_a_coefficient_behind_a_wall_says_little():
    seen, hidden = (estimate(0.25, "", slab(1.0, clear), KNOWN) for clear in (1.0, 0.02))
    assert hidden.sd_g_cm3 > 3 * seen.sd_g_cm3
    assert hidden.source == "prior"


def test_a_large_body_that_lets_nothing_through_is_not_taken_for_tons_of_metal():
    small, large = (
        estimate(0.2, "", slab(15.0, 0.2, volume_cm3), KNOWN) for volume_cm3 in (1.0, 3000.0)
    )
    assert large.density_g_cm3 < small.density_g_cm3
    assert large.density_g_cm3 + large.sd_g_cm3 < 2.5


def test_what_copies_show_counts_for_each_of_them():
    rays = slab(0.5)
    lac_per_cm = lac_of("aluminium", rays)
    alone = estimate(1.6 * lac_per_cm, "", rays, KNOWN)
    paired = estimate(1.6 * lac_per_cm, "", rays, KNOWN, [(lac_per_cm, rays)])
    assert abs(paired.density_g_cm3 - 2.7) < abs(alone.density_g_cm3 - 2.7)
    turned = estimate(lac_per_cm, "", rays, KNOWN, [(1.6 * lac_per_cm, rays)])
    assert paired.density_g_cm3 == pytest.approx(turned.density_g_cm3)


def test_copies_agree_in_volume_shadow_and_coefficient():
    one = survey().parts[0]
    other = [
        replace(one, lac_per_cm=0.22, rays=[100, 104, 98]),
        replace(one, filled_voxels=1100.0),
        replace(one, rays=[150, 150, 150]),
        replace(one, lac_per_cm=0.5),
    ]
    assert copies([one, *other]) == [[1], [0], [], [], []]
    assert copies([]) == []


def test_radiographs_are_taken_across_the_axis_on_which_things_stand(monkeypatch):
    monkeypatch.setattr(release_fit, "FILTERS_MM_AL", (4.0, 7.0))
    monkeypatch.setattr(release_fit, "STRAYS", (0.0,))
    upright = [replace(survey(), object_id=str(k)) for k in range(3)]
    assert fit_release(upright).beam.beam.axes == (0, 2)


@pytest.mark.parametrize(("lot", "hopeless"), [(1, 1000.0), (1, 0.1), (2, 5.0)])
def test_beams_dropped_after_some_parts_change_nothing_for_those_that_stay(
    monkeypatch, lot, hopeless
):
    monkeypatch.setattr(release_fit, "FILTERS_MM_AL", (4.0, 7.0, 20.0))
    monkeypatch.setattr(release_fit, "STRAYS", (0.0, 0.04))
    upright = [replace(survey(), object_id=str(k)) for k in range(3)]
    at_once = fit_release(upright).beam
    monkeypatch.setattr(release_fit, "LOT", lot)
    monkeypatch.setattr(release_fit, "HOPELESS", hopeless)
    in_lots = fit_release(upright).beam
    assert (in_lots.beam, in_lots.parts) == (at_once.beam, 3)
    assert in_lots.evidence == pytest.approx(at_once.evidence)
    assert (
        in_lots.runner_up_filter_mm_al
        == at_once.runner_up_filter_mm_al
        != in_lots.beam.filter_mm_al
    )
    assert in_lots.runner_up == pytest.approx(at_once.runner_up)


def test_a_name_speaks_for_its_families_and_against_the_others():
    assert families_of("Left_grip-2") == {"elastomer", "polymer", "wood"}
    assert families_of("part_3") == frozenset()
    rays = slab(1.0)
    plain, named = (estimate(0.19, name, rays, KNOWN) for name in ("plastic", "rubber"))
    families = [load_materials()[next(iter(found.likeliest))].family for found in (plain, named)]
    assert families == ["polymer", "elastomer"]


def test_no_deviation_is_below_three_per_cent_and_every_label_is_a_guess():
    found = estimate(lac_of("water", slab(3.0)), "water", slab(3.0), KNOWN)
    assert found.sd_g_cm3 >= 0.03 * found.density_g_cm3
    assert "material_guessed" in found.flags


def test_priors_add_up_to_one_whatever_the_name_says():
    for families in (frozenset(), frozenset({"metal"})):
        assert np.exp(hypotheses(families).log_prior).sum() == pytest.approx(1.0)


def test_voxels_and_ways_are_in_centimetres():
    convention = vote([survey()] * 3)
    assert ORIENTATIONS[convention.place].text == "+x +y +z"
    assert voxels_cm(survey(), convention) == pytest.approx([0.2, 0.2, 0.2])
    rays = part_rays(survey().parts[0], voxels_cm(survey(), convention), (0, 1))
    assert rays.mean_cm == pytest.approx(2.0)
    assert rays.clear == 1.0
    assert rays.narrow_cm == pytest.approx(2.0)
    flat = part_rays(survey().parts[0], np.array([0.2, 0.2, 0.02]), (0, 1))
    assert flat.narrow_cm == pytest.approx(0.2)  # both see it from its edge


def test_a_release_fit_survives_json():
    likely = ((BEAM, 0.75), (HARDER, 0.25))
    fit = ReleaseFit(vote([survey()] * 3), BeamFit(BEAM, -3.0, -4.0, 7.0, 3, likely))
    assert ReleaseFit.from_json(fit.to_json()) == fit
