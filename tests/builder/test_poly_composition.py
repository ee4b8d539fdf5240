"""How far coefficients may be off: by family, and by what a grade has been given."""

from __future__ import annotations

import pytest

from xden1k.values.materials import load_materials
from xden_builder.poly.materials.composition import (
    BY_FAMILY,
    DOSED,
    TO_MEASURE,
    USUAL,
    composition_sd,
)

LIBRARY = load_materials()
COMPOUNDS = sorted(each.name for each in LIBRARY.values() if each.family not in TO_MEASURE)


@pytest.mark.parametrize("name", sorted(LIBRARY.bases))
def test_a_base_errs_as_its_family_does(name):
    material = LIBRARY[name]
    assert composition_sd(material) == BY_FAMILY.get(material.family, USUAL)


@pytest.mark.parametrize("name", COMPOUNDS)
def test_no_grade_errs_less_than_its_family_or_more_than_all_of_it_being_dosed(name):
    usual = BY_FAMILY.get(LIBRARY[name].family, USUAL)
    assert usual <= composition_sd(LIBRARY[name]) < (usual**2 + DOSED**2) ** 0.5


def test_a_grade_errs_as_much_of_the_dose_as_it_owes_to_it():
    """Barium makes three quarters of that glass's attenuation, titania a tenth of white ABS's."""
    assert composition_sd(LIBRARY["glass_barium_crystal"]) == pytest.approx(0.16, abs=0.01)
    assert composition_sd(LIBRARY["abs_white"]) == pytest.approx(0.037, abs=0.002)


def test_alloys_and_dilutions_are_made_to_measure():
    assert composition_sd(LIBRARY["brass_leaded"]) == composition_sd(LIBRARY["brass"])
    assert composition_sd(LIBRARY["ethanol_70"]) == composition_sd(LIBRARY["ethanol"])
