"""The material library: its file, its look-ups and its parser."""

import pickle

import pytest
from hypothesis import given
from hypothesis import strategies as st

from xden1k.errors import DataError
from xden1k.values.materials import (
    FAMILY_WORDS,
    Material,
    MaterialLibrary,
    check_label,
    families,
    load_materials,
    parse_composition,
)

LIBRARY = load_materials()


def test_library_is_read_once_and_survives_pickling():
    assert load_materials() is LIBRARY
    assert pickle.loads(pickle.dumps(LIBRARY["iron"])) == LIBRARY["iron"]  # noqa: S301


@pytest.mark.parametrize("material", LIBRARY.values(), ids=lambda material: material.name)
def test_every_row_is_complete(material):
    assert material.name == material.name.lower().strip()
    assert " " not in material.name
    assert material.composition_source
    assert material.density_source
    assert sum(fraction for _, fraction in material.composition) == pytest.approx(1)
    assert material.density_sd_g_cm3 >= 0


def test_the_families_that_capture_folders_may_use_are_there():
    wanted = {"metal", "polymer", "elastomer", "wood", "paper", "textile", "glass", "ceramic"}
    assert wanted | {"liquid", "composite", "foam"} <= set(families())


def test_names_come_in_any_case_but_no_other_spelling():
    assert LIBRARY["IRON"] is LIBRARY["iron"]
    assert LIBRARY["Polypropylene"] is LIBRARY["pp"]
    assert "stainless steel" not in LIBRARY
    assert len(LIBRARY) == len(set(LIBRARY))


def test_label_is_a_name_an_alias_a_family_or_empty():
    assert check_label("Aluminum") == "aluminium"
    assert check_label("Metal") == "metal"
    assert check_label("") == ""
    assert [check_label(word) for word in FAMILY_WORDS] == list(FAMILY_WORDS.values())
    assert set(FAMILY_WORDS.values()) <= set(families())
    assert not any(word in LIBRARY or word in families() for word in FAMILY_WORDS)
    with pytest.raises(DataError, match=r"unknown material 'irn'.*near: iron"):
        check_label("irn")
    with pytest.raises(DataError, match=r"unknown material 'xqzk'.*or nothing$"):
        check_label("xqzk")


def _material(
    name: str, family: str = "metal", aliases: tuple[str, ...] = (), grade_of: str = ""
) -> Material:
    figures = ((("Fe", 1.0),), 7.0, 7.5, 8.0, "element", "assumed")
    return Material(name, family, *figures, aliases, grade_of)


def test_a_grade_is_called_by_its_base_and_a_base_not_by_its_grades():
    grade, base = LIBRARY["brass_leaded"], LIBRARY["brass"]
    assert (grade.base, base.base) == ("brass", "brass")
    assert grade.called("brass")
    assert grade.called("brass_leaded")
    assert not base.called("brass_leaded")
    assert grade.called("")
    assert base.called("")
    assert "brass_leaded" in LIBRARY
    assert "brass_leaded" not in LIBRARY.bases


@pytest.mark.parametrize("grade_of", ["c", "b"])
def test_a_grade_of_nothing_or_of_a_grade_is_refused(grade_of):
    known = _material("a"), _material("b", grade_of="a"), _material("x", grade_of=grade_of)
    with pytest.raises(DataError, match=f"x: expected grade_of .* family metal, got '{grade_of}'"):
        MaterialLibrary(known)


def test_grades_differ_from_their_bases():
    for each in LIBRARY.values():
        base = LIBRARY[each.base]
        assert each is base or each.composition != base.composition


def test_one_name_never_means_two_things():
    with pytest.raises(DataError, match=r"used more than once: \['metal'\]"):
        MaterialLibrary((_material("metal"),))
    with pytest.raises(DataError, match=r"used more than once: \['b'\]"):
        MaterialLibrary((_material("a", aliases=("b",)), _material("b")))


def test_densities_out_of_order_are_refused():
    with pytest.raises(DataError, match=r"material x: densities must be 0 < low <= nominal"):
        Material("x", "metal", (("Fe", 1.0),), 8.0, 7.5, 8.5, "element", "assumed")


def test_composition_reads_back_what_was_written():
    assert parse_composition("H2O") == (("H2O", 1.0),)
    assert parse_composition("Fe:0.7 Cr:0.3") == (("Fe", 0.7), ("Cr", 0.3))


@pytest.mark.parametrize("text", ["", "fe", "Fe:x", "Fe:-1 Cr:2", "Fe:", ":1", "Fe Cr", "(OH)2"])
def test_unreadable_composition_is_refused(text):
    with pytest.raises(DataError, match="expected FORMULA:MASS_FRACTION"):
        parse_composition(text)


def test_fractions_that_leave_something_out_are_refused():
    with pytest.raises(DataError, match=r"must add up to 1, got 0\.9"):
        parse_composition("Fe:0.7 Cr:0.2")


@given(st.lists(st.floats(0.01, 1), min_size=1, max_size=6))
def test_parsed_fractions_add_up_to_one(weights):
    elements = ["Fe", "Cr", "Ni", "Mn", "C", "Si"]
    text = " ".join(
        f"{element}:{weight / sum(weights):.9f}"
        for element, weight in zip(elements, weights, strict=False)
    )
    assert sum(fraction for _, fraction in parse_composition(text)) == pytest.approx(1, abs=1e-12)
