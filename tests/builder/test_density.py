"""Density by what is known of source and material; never silently wrong."""

import math

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from xden1k.errors import DataError
from xden1k.values.materials import load_materials
from xden_builder.capture import CapturePart
from xden_builder.fit import LacFit
from xden_builder.fit.density import part_densities
from xden_builder.physics.attenuation import mac_cm2_g
from xden_builder.physics.source import Tube

LIBRARY = load_materials()
MONO = Tube(energy_kev=100.0)
SPECTRUM = Tube(kv=100.0)
BOX = trimesh.creation.box()


def density_of(lac, material="", tube=MONO, sd=0.001, flags=(), hollow=False):
    fit = LacFit(
        lac_per_cm=np.array([lac]),
        lac_sd_per_cm=np.array([sd]),
        gain=np.ones(2),
        loss=0.0,
        iterations=1,
        flags=(frozenset(flags),),
        report={},
    )
    (density,) = part_densities(fit, [CapturePart("p", BOX, material, hollow=hollow)], tube)
    return density


def mac(material, energy_kev=100.0):
    return float(mac_cm2_g(LIBRARY[material].composition, energy_kev))


@given(st.sampled_from(sorted(LIBRARY)), st.floats(30.0, 200.0))
def test_known_material_and_energy_give_its_own_density_back(name, energy_kev):
    nominal = LIBRARY[name].density_nominal_g_cm3
    found = density_of(nominal * mac(name, energy_kev), name, Tube(energy_kev=energy_kev))
    assert found.density_g_cm3 == pytest.approx(nominal)
    assert found.source == "xray"
    assert found.flags == ()


def test_deviation_of_the_attenuation_and_of_the_table_both_count():
    found = density_of(7.8 * mac("iron"), "iron", sd=0.078 * mac("iron"))
    assert found.sd_g_cm3 == pytest.approx(math.hypot(0.078, 0.078))


@pytest.mark.parametrize("material", ["", "metal"])
def test_without_a_material_the_density_is_apparent_and_says_so(material):
    found = density_of(0.34, material, sd=0.017)
    assert found.density_g_cm3 == pytest.approx(2.0)
    assert found.sd_g_cm3 == pytest.approx(0.1)
    assert (found.source, found.flags) == ("xray", ("apparent_density",))


@pytest.mark.parametrize("material", ["", "metal", "iron"])
def test_with_a_spectrum_the_density_is_apparent_and_says_so(material):
    found = density_of(3.4, material, SPECTRUM)
    assert found.density_g_cm3 == pytest.approx(20.0)
    assert (found.source, found.flags) == ("xray", ("apparent_density",))


@pytest.mark.parametrize("flags", [(), ("hidden",)])
def test_without_a_source_there_is_no_density(flags):
    found = density_of(3.4, "iron", None, flags=flags)
    assert math.isnan(found.density_g_cm3)
    assert math.isnan(found.sd_g_cm3)
    assert found.source == "none"
    assert found.flags == ("attenuation_only", *flags)


@pytest.mark.parametrize("tube", [MONO, SPECTRUM])
def test_hidden_part_takes_what_its_material_usually_has(tube):
    found = density_of(math.nan, "Brass", tube, sd=math.nan, flags=("hidden",))
    brass = LIBRARY["brass"]
    assert found.density_g_cm3 == brass.density_nominal_g_cm3
    assert found.sd_g_cm3 == brass.density_sd_g_cm3
    assert (found.source, found.flags) == ("prior", ("hidden",))


@pytest.mark.parametrize("material", ["", "metal"])
def test_hidden_part_of_unknown_material_has_no_density_rather_than_a_guess(material):
    found = density_of(math.nan, material, sd=math.nan, flags=("hidden",))
    assert math.isnan(found.density_g_cm3)
    assert (found.source, found.flags) == ("none", ("hidden", "no_density"))


def test_hidden_hollow_part_is_lighter_and_less_sure():
    solid, hollow = (
        density_of(math.nan, "pp", sd=math.nan, flags=("hidden",), hollow=hollow)
        for hollow in (False, True)
    )
    assert hollow.density_g_cm3 < solid.density_g_cm3
    assert hollow.sd_g_cm3 > 5 * solid.sd_g_cm3


def test_uncertain_attenuation_yields_to_the_material_when_that_is_surer():
    lac = 0.5 * mac("pp")
    found = density_of(lac, "pp", sd=0.5 * lac, flags=("uncertain",))
    assert found.density_g_cm3 == LIBRARY["pp"].density_nominal_g_cm3
    assert (found.source, found.flags) == ("prior", ("uncertain",))


def test_uncertain_attenuation_stays_when_the_material_says_still_less():
    lac = 0.1 * mac("foam_organic")
    found = density_of(lac, "foam_organic", sd=0.15 * lac, flags=("uncertain",))
    assert found.density_g_cm3 == pytest.approx(0.1)
    assert (found.source, found.flags) == ("xray", ("uncertain",))


def test_runaway_coefficient_is_not_turned_into_a_density():
    found = density_of(200.0, "lead", sd=57.0, flags=("at_bound", "starved"))
    assert found.source == "prior"
    assert found.density_g_cm3 == 11.34


def test_wrong_label_is_kept_as_measured_and_flagged():
    found = density_of(7.87 * mac("iron"), "pp")
    assert found.density_g_cm3 == pytest.approx(7.87 * mac("iron") / mac("pp"))
    assert found.flags == ("unlike_material",)


def test_light_hollow_part_is_like_its_material_but_a_light_solid_one_is_not():
    assert density_of(0.3 * mac("pp"), "pp").flags == ("unlike_material",)
    assert density_of(0.3 * mac("pp"), "pp", hollow=True).flags == ()
    assert density_of(0.01 * mac("pp"), "pp", hollow=True).flags == ("unlike_material",)


def test_energy_outside_the_tables_is_refused():
    with pytest.raises(DataError, match=r"photon energies must be 0\.1 to 800\.0 keV"):
        density_of(1.0, "iron", Tube(energy_kev=2000.0))
