"""The whole fit on images without error: what it says, what it flags, what must not change it."""

from __future__ import annotations

import json
from dataclasses import replace
from statistics import NormalDist

import pytest
import trimesh

from tests.builder.fit_scenes import cone
from tests.builder.poly_scenes import (
    TUBE,
    Solid,
    captured,
    fitted,
    radiograph,
    relabelled,
    saturated,
    solved,
    tool,
    true_mass_g,
)
from xden1k.errors import DataError
from xden1k.format.records import object_row
from xden1k.values.types import DensityObject
from xden_builder.audit.object import audit_object
from xden_builder.capture import Capture, CapturePart
from xden_builder.capture.space import divide
from xden_builder.physics.source import Tube
from xden_builder.poly.judgement import UNCERTAIN
from xden_builder.poly.model.frames import Pose
from xden_builder.reconstruct.object import reconstruct
from xden_builder.reconstruct.settings import BuildSettings

SIZE_PX = 72
TRUTH = {solid.name: solid.density_g_cm3 for solid in tool()}


@pytest.fixture(scope="module")
def capture() -> Capture:
    return captured(tool(), size=SIZE_PX)


@pytest.fixture(scope="module")
def rebuilt(capture) -> DensityObject:
    return reconstruct(capture)


def densities(obj: DensityObject) -> dict[str, float]:
    return {part.name: part.density_g_cm3 for part in obj.parts}


def beside_the_panels(name: str, material: str, **how) -> CapturePart:
    """A part that neither view shows."""
    above = trimesh.transformations.translation_matrix((0, 3 * len(name), 20))
    return CapturePart(name, trimesh.creation.box((1, 2, 2), above), material, **how)


def with_parts(capture: Capture, *parts: CapturePart) -> Capture:
    return replace(capture, parts=(*capture.parts, *parts))


def test_densities_are_those_of_the_object(rebuilt):
    assert rebuilt.meta["model"] == "poly"
    assert densities(rebuilt) == pytest.approx(TRUTH, rel=0.015)
    assert rebuilt.mass_g == pytest.approx(true_mass_g(tool()), rel=0.01)
    assert rebuilt.flags == ()
    for part in rebuilt.parts:
        assert abs(part.density_g_cm3 - TRUTH[part.name]) < 2 * part.density_sd_g_cm3
        assert not {"label_doubted", "material_guessed", "hidden", "starved"} & set(part.flags)


def test_the_papers_number_is_kept_beside_ours(rebuilt):
    apparent = {part.name: part.apparent_density_g_cm3 for part in rebuilt.parts}
    assert apparent["blade"] > 20
    assert apparent["level"] == pytest.approx(1.4, rel=0.1)


def test_model_explains_its_images(rebuilt):
    for view in rebuilt.meta["reprojection"].values():
        assert view["transmission_corr"] > 0.999


def test_an_audit_repeats_the_fits_images_from_what_is_kept(capture, rebuilt):
    oblique = radiograph(tool(), "oblique", cone(40.0, SIZE_PX, 14.0))
    audit = audit_object(rebuilt, replace(capture, audit_views=(oblique,)))
    assert audit.good
    *fitted_views, unseen = audit.views
    for view in fitted_views:
        kept = rebuilt.meta["reprojection"][view.name]
        assert view.transmission_mae == pytest.approx(kept["transmission_mae"], rel=0.02)
    assert not unseen.fitted
    assert unseen.transmission_corr > 0.998


def test_report_is_of_jsons_types_and_complete(capture, rebuilt):
    text = json.dumps(rebuilt.meta, allow_nan=False)
    report = json.loads(text)["poly"]
    assert report == rebuilt.meta["poly"]
    assert set(report["views"]) == {"pa", "lat"}
    assert set(report["materials"]) == {part.name for part in capture.parts}
    assert report["converged"]
    assert Pose.from_dict(report["pose"]).centre_cm != (0.0, 0.0, 0.0)
    for candidates in report["materials"].values():
        chances = [chance for _, _, chance in candidates]
        assert 0 < sum(chances) <= 1 + 1e-9
        assert chances == sorted(chances, reverse=True)


def test_mass_centre_and_inertia_have_deviations(rebuilt):
    uncertainty = rebuilt.meta["uncertainty"]
    assert 0.005 < uncertainty["mass_sd_g"] / rebuilt.mass_g < 0.05
    assert all(0 < sd < 0.2 for sd in uncertainty["com_sd_cm"])
    assert len(uncertainty["inertia_sd_g_cm2"]) == 6
    assert abs(rebuilt.mass_g - true_mass_g(tool())) < 2 * uncertainty["mass_sd_g"]


@pytest.mark.slow
def test_the_same_capture_gives_the_same_bytes(capture, rebuilt):
    assert object_row(reconstruct(capture)) == object_row(rebuilt)


def test_order_of_the_parts_does_not_matter(capture, rebuilt):
    backwards = replace(capture, parts=capture.parts[::-1])
    again = reconstruct(backwards)
    assert densities(again) == pytest.approx(densities(rebuilt), rel=0.003)
    assert {part.name: part.flags for part in again.parts} == {
        part.name: part.flags for part in rebuilt.parts
    }


@pytest.mark.parametrize(
    "exposures", [pytest.param((1.1, 1.1), marks=pytest.mark.slow), (0.93, 1.08)]
)
def test_exposure_moves_the_gain_and_no_density(capture, rebuilt, exposures):
    fit = solved(captured(tool(), size=SIZE_PX, exposures=exposures))
    assert fit.density_g_cm3 == pytest.approx(list(densities(rebuilt).values()), rel=0.01)
    gains = [float(fit.nuisances(number)[0]) for number in (0, 1)]
    assert gains == pytest.approx(exposures, rel=0.003)


@pytest.fixture(scope="module")
def bright() -> Capture:
    """The object exposed longer than usual."""
    return captured(tool(), size=SIZE_PX, exposures=(1.3, 1.3))


def test_saturated_air_costs_no_density_and_is_no_shadow(bright, rebuilt):
    capture = saturated(bright, 1.1)
    obj = reconstruct(capture)
    assert densities(obj) == pytest.approx(densities(rebuilt), rel=0.03)
    gains = [view["gain"] for view in obj.meta["poly"]["views"].values()]
    assert gains == pytest.approx([1.3, 1.3], rel=0.02)
    assert obj.flags == rebuilt.flags
    again = audit_object(obj, capture)
    assert again.good
    assert all(view.background_transmission_mae < 0.01 for view in again.views)


def test_an_object_most_of_which_is_saturated_is_refused(bright):
    with pytest.raises(DataError, match=r"view pa: \d+\.\d% of the object's pixels are saturated,"):
        reconstruct(saturated(bright, 0.2))


@pytest.mark.parametrize("label", ["aluminium", pytest.param("pp", marks=pytest.mark.slow)])
def test_a_wrong_label_is_found_out_and_flagged(capture, label):
    found = fitted(relabelled(capture, blade=label))
    assert found["blade"].density_g_cm3 == pytest.approx(TRUTH["blade"], rel=0.05)
    assert "label_doubted" in found["blade"].flags
    assert found["blade"].materials[0][0] != label
    for name in ("grip", "level"):
        assert "label_doubted" not in found[name].flags
        assert found[name].density_g_cm3 == pytest.approx(TRUTH[name], rel=0.02)


def test_without_a_materials_name_it_is_guessed_and_says_so(capture, rebuilt):
    found = fitted(relabelled(capture, blade="metal", level=""))
    sure = {part.name: part.density_sd_g_cm3 for part in rebuilt.parts}
    for name in ("blade", "level"):
        assert "material_guessed" in found[name].flags
        assert found[name].density_g_cm3 == pytest.approx(TRUTH[name], rel=0.12)
        assert abs(found[name].density_g_cm3 - TRUTH[name]) < 2 * found[name].sd_g_cm3
        assert found[name].sd_g_cm3 > 1.3 * sure[name]
    assert found["grip"].density_g_cm3 == pytest.approx(TRUTH["grip"], rel=0.02)


@pytest.mark.parametrize(
    "hollow", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["foamed", "hollow"]
)
def test_a_body_of_half_the_density_is_measured(hollow):
    found = fitted(captured(tool(density_g_cm3=0.455, hollow=hollow), size=SIZE_PX))
    assert found["grip"].density_g_cm3 == pytest.approx(0.455, rel=0.05)
    assert found["grip"].source == "xray"
    assert "label_doubted" not in found["grip"].flags
    assert ("porous" in found["grip"].flags) == (not hollow), "a hollow part was annotated so"
    assert not {"porous", "at_bound"} & set(found["blade"].flags)


@pytest.mark.parametrize("label", ["pp", "polymer", ""])
def test_a_part_that_is_not_in_the_object_is_told_from_a_foamed_one(label):
    """Drawn, but a cell that nobody put in: its label, if any, is not what to check."""
    for density_g_cm3, gone in ((0.002, True), (0.3, False)):
        mostly_air = tool(density_g_cm3=density_g_cm3, label=label)
        found = fitted(captured(mostly_air, size=SIZE_PX))
        assert ("hardly_there" in found["grip"].flags) == gone
        assert "hardly_there" not in found["blade"].flags


def test_a_label_means_its_grades_and_which_one_is_told():
    flame_retarded = tool(material="abs_brominated", density_g_cm3=1.19, label="abs")
    found = fitted(captured(flame_retarded, size=96))
    grip = found["grip"]
    assert grip.density_g_cm3 == pytest.approx(1.19, rel=0.05)
    assert grip.materials[0][0] == "abs_brominated"
    assert "label_doubted" not in grip.flags


def test_an_exposure_that_no_gain_makes_up_for_is_at_its_bound(capture, rebuilt):
    exposed = reconstruct(captured(tool(), size=96, exposures=(1.0, 2.6)))
    assert "lat:at_bound" in exposed.flags
    assert not [flag for flag in (*exposed.flags, *rebuilt.flags) if flag == "pa:at_bound"]


def test_parts_that_no_ray_meets_are_hidden_and_of_their_materials_density(capture, rebuilt):
    lost = beside_the_panels("lost", "brass"), beside_the_panels("unknown", "")
    found = fitted(with_parts(capture, *lost))
    brass, unknown = found.pop("lost"), found.pop("unknown")
    for part in (brass, unknown):
        assert part.source == "prior"
        assert {"hidden", "prior_dominated"} <= set(part.flags)
    assert brass.density_g_cm3 == pytest.approx(8.45, rel=0.03)
    assert {"material_guessed", "uncertain"} <= set(unknown.flags)
    assert unknown.sd_g_cm3 > 0.5 * unknown.density_g_cm3
    seen = {name: part.density_g_cm3 for name, part in found.items()}
    assert seen == pytest.approx(densities(rebuilt), rel=0.005)


def test_densities_of_which_one_in_ten_is_off_by_a_tenth_are_uncertain(capture):
    parts = fitted(relabelled(capture, grip="abs")).values()
    assert pytest.approx(0.1 / NormalDist().inv_cdf(0.95), rel=0.02) == UNCERTAIN
    shares = [part.sd_g_cm3 / part.density_g_cm3 for part in parts]
    assert ["uncertain" in part.flags for part in parts] == [share > UNCERTAIN for share in shares]
    assert min(shares) < UNCERTAIN < max(shares) < 0.1


def test_a_scale_tells_what_no_ray_does(capture):
    part = beside_the_panels("lost", "pp", hollow=True)
    true_g = true_mass_g(tool()) + 4 * 0.5
    found = fitted(replace(with_parts(capture, part), weighed_mass_g=true_g))["lost"]
    assert found.source == "weighed"
    assert "hidden" in found.flags
    assert found.density_g_cm3 == pytest.approx(0.5, abs=0.07)
    assert abs(found.density_g_cm3 - 0.5) < 2 * found.sd_g_cm3


@pytest.mark.parametrize(
    ("factor", "disagrees"),
    [(2.0, True), pytest.param(0.5, True, marks=pytest.mark.slow), (1.02, False)],
)
def test_a_mass_that_the_images_contradict_is_flagged_with_both(capture, factor, disagrees):
    true_g = true_mass_g(tool())
    found = reconstruct(replace(capture, weighed_mass_g=factor * true_g))
    assert ("weighed_disagrees" in found.flags) == disagrees
    both = found.meta["poly"]["weighing"]
    assert both["weighed_g"] == pytest.approx(factor * true_g)
    assert both["by_images_g"] == pytest.approx(true_g, rel=0.02)
    mass_g, sd_g = found.mass_g, found.meta["uncertainty"]["mass_sd_g"]
    off_g = max(abs(mass_g - both["weighed_g"]), abs(mass_g - both["by_images_g"]))
    assert (sd_g == pytest.approx(off_g, rel=0.05)) if disagrees else sd_g < 0.01 * mass_g


def test_a_weighed_mass_makes_the_mass_right(capture):
    true_g = true_mass_g(tool())
    families = {"blade": "metal", "grip": "polymer", "level": "liquid"}
    weighed = relabelled(replace(capture, weighed_mass_g=true_g), **families)
    mass_g = float(divide(weighed.parts).volumes_cm3 @ solved(weighed).density_g_cm3)
    assert mass_g == pytest.approx(true_g, rel=0.005)


def test_without_a_known_source_there_is_attenuation_only(capture):
    obj = reconstruct(replace(capture, tube=None))
    assert obj.meta["model"] == "attenuation"
    assert "attenuation_only" in obj.flags
    assert "poly" not in obj.meta
    assert obj.density is None
    for part in obj.parts:
        assert part.density_source == "none"
        assert part.lac_per_cm > 0


def test_one_photon_energy_needs_no_spectrum():
    solids = tuple(replace(solid, density_g_cm3=0.9 * solid.density_g_cm3) for solid in tool()[1:])
    capture = captured(solids, size=SIZE_PX, tube=Tube(energy_kev=100.0))
    obj = reconstruct(capture)
    assert obj.meta["model"] == "mono"
    assert "poly" not in obj.meta
    expected = {solid.name: solid.density_g_cm3 for solid in solids}
    assert densities(obj) == pytest.approx(expected, rel=0.01)


@pytest.mark.slow
def test_the_papers_way_keeps_the_papers_number():
    obj = reconstruct(captured(tool(), size=32), BuildSettings(model="paper"))
    assert obj.meta["model"] == "paper"
    assert "poly" not in obj.meta
    for part in obj.parts:
        assert part.density_g_cm3 == part.apparent_density_g_cm3 == part.lac_per_cm / 0.17
        assert "apparent_density" in part.flags


def test_a_beam_harder_than_told_makes_parts_look_lighter_and_no_gain_hides_it():
    harder = replace(TUBE, filtration_cm={"Al": 0.25, "Cu": 0.03})
    solids = (Solid("grip", tool()[1].mesh, "aluminium", 2.7, label="metal"),)
    right, wrong = (
        fitted(replace(captured(solids, size=64, tube=tube), tube=TUBE))["grip"].density_g_cm3
        for tube in (TUBE, harder)
    )
    assert right == pytest.approx(2.7, rel=0.01)
    assert wrong < right
