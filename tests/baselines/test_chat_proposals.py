"""Reading proposals, pairing them by name, asking again, falling back; and the prior."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.baselines.chat_stub import Parrot
from tests.phantoms import Box, box_object
from xden1k.errors import DataError
from xden1k.folder import open_folder, write_folder
from xden1k.predictor import Examples
from xden1k.values.modality import Modality
from xden_baselines.chat.answers import (
    paired,
    parse_caption,
    parse_densities,
    parse_json,
    parse_thicknesses,
)
from xden_baselines.chat.candidates import Candidate, MaterialProposer
from xden_baselines.chat.prior import PriorProposer
from xden_baselines.chat.proposer import ChatProposer
from xden_baselines.chat.request import ChatRequest

LIST = "(Steel: 7,750-8,050 kg/m^3);(oak  wood: 600 - 900 kg/m3);(water: 1000 kg/m³)"
THICKNESS = "(water: 5-10 cm);(steel: 0.1-0.2 cm);(oak wood: 20-30 mm)"
STEEL = Candidate("steel", (7.75, 8.05), (0.1, 0.2))
OAK = Candidate("oak wood", (0.6, 0.9), (2.0, 3.0))
WATER = Candidate("water", (1.0, 1.0), (5.0, 10.0))
JSON = {
    "materials": [
        {"name": "Steel", "density_kg_m3": [7750, 8050], "thickness_cm": [0.1, 0.2]},
        {"name": "oak wood", "density_kg_m3": "600-900", "thickness_cm": "20-30 mm"},
        {"name": "water", "density_kg_m3": 1000, "thickness_cm": [5, 10]},
    ]
}


def test_a_list_is_read_with_thousands_commas_single_values_and_any_spelling_of_the_unit() -> None:
    assert parse_densities(LIST) == {"steel": (7.75, 8.05), "oak wood": (0.6, 0.9), "water": (1, 1)}


@pytest.mark.parametrize(
    ("text", "g_cm3"),
    [
        ("(oak: 600-900)", (0.6, 0.9)),
        ("(oak: 0.6-0.9 g/cm^3)", (0.6, 0.9)),
        ("(oak: 600\u2013900 kg/m^3).", (0.6, 0.9)),
        ("(oak: 600 to 900 kg / m^3);", (0.6, 0.9)),
        ("  (oak: 6e2-9e2 kg/m^3)\n", (0.6, 0.9)),
        ("(oak: 22,590 kg/m^3)", (22.59, 22.59)),
        ("oak: 600-900 kg/m^3", (0.6, 0.9)),
        ("```\n(oak: 600-900 kg/m^3)\n```", (0.6, 0.9)),
        ("Here is the list you asked for:\n(oak: 600-900 kg/m^3)", (0.6, 0.9)),
        ("(**Oak**: 600-900 kg/m^3)\n\nThese are typical values.", (0.6, 0.9)),
        ("1. **oak**: 600-900 kg/m^3", (0.6, 0.9)),
        ("<think>(pine: 500)</think>(oak: 600-900 kg/m^3)", (0.6, 0.9)),
        ("pine: 500, or oak?\n</think>\n(oak: 600-900 kg/m^3)", (0.6, 0.9)),
        ("(oak: ~600-900 kg/m^3)", (0.6, 0.9)),
        ("(oak: approx. 600\u2212900 kg/m^3)", (0.6, 0.9)),
        ("(oak: 600 kg/m^3 - 900 kg/m^3)", (0.6, 0.9)),
        ("(oak: 0.6 g/cm\u00b3 to 0.9 g/cm\u00b3)", (0.6, 0.9)),
        ("The final answer is: (oak: 600-900 kg/m^3)", (0.6, 0.9)),
        ("- Oak (600-900 kg/m^3)", (0.6, 0.9)),
        ("oak: (600-900 kg/m^3)", (0.6, 0.9)),
    ],
)
def test_units_dashes_and_ends_are_forgiven(text: str, g_cm3: tuple[float, float]) -> None:
    assert parse_densities(text) == {"oak": g_cm3}


def test_a_figure_in_brackets_of_a_name_is_no_range() -> None:
    assert parse_densities("Nylon (6): 1120-1140 kg/m^3") == {"nylon (6)": (1.12, 1.14)}


@pytest.mark.parametrize("between", [";", "; ", ", ", "\n", ",\n"])
def test_items_may_be_divided_by_commas_and_names_hold_brackets(between: str) -> None:
    items = ("(Polyethylene (HDPE): 940-970 kg/m^3)", "(steel: 7,750-8,050 kg/m^3)")
    assert parse_densities(between.join(items)) == {
        "polyethylene (hdpe)": (0.94, 0.97),
        "steel": (7.75, 8.05),
    }


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("(steel: 7.75 g/cm^3 - 8050 kg/m^3)", "expected one unit for both ends"),
        ("", "expected '\\(name: low-high unit\\)'"),
        ("I am sorry, but I cannot help with that.", "expected '\\(name: low-high unit\\)'"),
        ("(steel, 7750-8050 kg/m^3)", "expected '\\(name: low-high unit\\)'"),
        ("(steel: plated: 7750-8050 kg/m^3)", "expected '\\(name: low-high unit\\)'"),
        ("(material 1: 100-200 kg/m^3)", "expected the name of a material"),
        ("(material: 100-200 kg/m^3)", "expected the name of a material"),
        ("(<name>: 100-200 kg/m^3)", "expected the name of a material"),
        ("(1. steel: 100-200 kg/m^3)", "expected the name of a material"),
        ("<think>(steel: 7800 kg/m^3)", "ends within a thought"),
        ("(steel \ud83d: 7800 kg/m^3)", "half a character"),
        ("Steel and oak, I think.", "expected '\\(name: low-high unit\\)'"),
        ("(: 100-200 kg/m^3)", "expected the name of a material"),
        ("(steel: low-high kg/m^3)", "expected a range like"),
        ("(steel: very dense)", "expected a range like"),
        ("(oak: 600 kg/m^3);(steel: 7", "expected '\\(name: low-high unit\\)', got '\\(steel"),
        ("(steel: -5 kg/m^3)", "expected a range like"),
        ("(steel: 490 lb/ft^3)", "expected a unit of"),
        ("(steel: 7800 kg/m^3);(Steel: 7900 kg/m^3)", "'steel' comes twice"),
        (";".join(f"({name}: 900)" for name in "abcdef"), "1 to 5 materials, got 6"),
    ],
)
def test_what_is_no_list_is_refused(text: str, message: str) -> None:
    with pytest.raises(DataError, match=message):
        parse_densities(text)


def test_thicknesses_pair_by_name_whatever_their_order() -> None:
    assert paired(parse_densities(LIST), parse_thicknesses(THICKNESS)) == (STEEL, OAK, WATER)


@given(st.permutations(THICKNESS.split(";")))
def test_no_order_of_the_thicknesses_swaps_materials(order: list[str]) -> None:
    thicknesses = parse_thicknesses(";".join(order))
    assert paired(parse_densities(LIST), thicknesses) == (STEEL, OAK, WATER)


@pytest.mark.parametrize("answer", ["(steel: 1 cm)", THICKNESS + ";(tin: 1 cm)"])
def test_thicknesses_of_other_materials_are_refused(answer: str) -> None:
    with pytest.raises(
        DataError, match=r"expected thicknesses of \['oak wood', 'steel', 'water'\]"
    ):
        paired(parse_densities(LIST), parse_thicknesses(answer))


@pytest.mark.parametrize(
    ("densities", "what"),
    [
        ({"steel": (8.05, 7.75)}, "density"),
        ({"steel": (0.0, 7.75)}, "density"),
        ({"steel": (7750.0, 8050.0)}, "density"),
        ({"steel": (7.75, float("inf"))}, "density"),
    ],
)
def test_impossible_densities_are_refused(densities: dict, what: str) -> None:
    with pytest.raises(DataError, match=f"steel: {what}_g_cm3 must be 0 < low <= high <= 25"):
        paired(densities, {"steel": (0.1, 0.2)})


@pytest.mark.parametrize("density", ["7850 g/cm^3", "8050-7750 kg/m^3", "0 kg/m^3", "1e999"])
def test_densities_of_no_matter_are_asked_for_again_and_not_their_thicknesses(density: str) -> None:
    first = iter([f"(steel: {density});(oak: 600-900 kg/m^3)", "(steel: 7750-8050 kg/m^3)"])
    model = Parrot(lambda asked: next(first) if "Materials:" not in asked.text else "(steel: 1 cm)")
    (found,) = ChatProposer(model, None).propose("pot-0001", "pot")
    assert found == Candidate("steel", (7.75, 8.05), (1.0, 1.0))
    asked = [(one.prompt, one.seed) for one in model.asked]
    assert asked == [("materials/2", 100), ("materials/2", 101), ("thickness/2", 100)]


@pytest.mark.parametrize("around", ["%s", "```json\n%s\n```", "Sure!\n%s\nAnything else?"])
def test_json_is_read_bare_fenced_or_amid_prose(around: str) -> None:
    assert parse_json(around % json.dumps(JSON, indent=1)) == (STEEL, OAK, WATER)


def test_the_key_of_the_original_is_known() -> None:
    item = {"name": "steel", "mass density (kg/m^3)": "7,750-8,050", "thickness_cm": [0.1, 0.2]}
    assert parse_json(json.dumps({"description": "a pot", "materials": [item]})) == (STEEL,)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected a JSON object"),
        ("I cannot say.", "expected a JSON object"),
        ('{"materials": [', "expected a JSON object"),
        ("[" * 100_000, "expected a JSON object"),
        ("[1]", "under 'materials'"),
        ("{}", "under 'materials'"),
        ('{"materials": {"steel": 1}}', "under 'materials'"),
        ('{"materials": []}', "got 0"),
        ('{"materials": [{"density_kg_m3": 1}]}', "the name of a material, got None"),
        ('{"materials": [{"name": "..."}]}', "the name of a material"),
        ('{"materials": [{"name": "tin"}]}', "a number or a range, got None"),
        ('{"materials": [{"name": "tin", "density_kg_m3": [1, 2, 3]}]}', "a number or a range"),
        ('{"materials": [{"name": "tin", "density_kg_m3": true}]}', "a number or a range"),
        ('{"materials": [{"name": "tin", "density_kg_m3": NaN}]}', "a number or a range"),
        ('{"materials": [{"name": "tin", "density_kg_m3": ["low", "high"]}]}', "a number or a"),
        (
            '{"materials": [{"name": "tin", "density_kg_m3": 7290}]}',
            "a number or a range, got None",
        ),
    ],
)
def test_what_is_no_such_json_is_refused(text: str, message: str) -> None:
    with pytest.raises(DataError, match=message):
        parse_json(text)


@given(st.text() | st.text(alphabet='(): ;-.0123456789kg/m^3abc{}[]",e'))
def test_no_answer_does_worse_than_being_refused(text: str) -> None:
    for parse in (parse_densities, parse_thicknesses, parse_json):
        with suppress(DataError):
            assert parse(text)


class Fixed:
    source = "fixed"
    fallbacks = 0

    def propose(self, object_id: str, category: str, picture: object = None) -> tuple:
        return (WATER,)


def asked_in_lists(request: ChatRequest) -> str:
    return LIST if request.prompt == "materials/2" else THICKNESS


def test_the_lists_take_two_questions_and_the_second_names_what_the_first_gave() -> None:
    model = Parrot(asked_in_lists)
    proposer = ChatProposer(model, Fixed())
    assert isinstance(proposer, MaterialProposer)
    assert proposer.propose("pot-0001", "pot") == (STEEL, OAK, WATER)
    assert [request.prompt for request in model.asked] == ["materials/2", "thickness/2"]
    assert '"pot"' in model.asked[0].text
    assert "steel, oak wood, water" in model.asked[1].text
    assert proposer.fallbacks == 0


def test_a_caption_takes_the_place_of_the_category_and_of_the_picture() -> None:
    def answer(request: ChatRequest) -> str:
        return "A pot with two ears." if request.images else asked_in_lists(request)

    model = Parrot(answer)
    proposer = ChatProposer(model, None, form="caption")
    picture = np.zeros((4, 4, 3), dtype=np.uint8)
    assert proposer.propose("pot-0001", "secret", picture) == (STEEL, OAK, WATER)
    prompts = [request.prompt for request in model.asked]
    assert prompts == ["caption/1", "materials/2", "thickness/2"]
    assert [len(request.images) for request in model.asked] == [1, 0, 0]
    assert all('"A pot with two ears"' in request.text for request in model.asked[1:])
    assert "secret" not in repr(model.asked)


def test_four_worked_examples_go_before_a_question_about_thicknesses_and_can_be_read() -> None:
    model = Parrot(asked_in_lists)
    ChatProposer(model, None).propose("pot-0001", "pot")
    before = model.asked[1].messages()[:-1]
    assert [one["role"] for one in before] == ["system", *["user", "assistant"] * 4]
    for question, answer in zip(before[1::2], before[2::2], strict=True):
        names = question["content"].partition("Materials: ")[2].split(", ")
        assert list(parse_thicknesses(answer["content"])) == names


@pytest.mark.parametrize(
    "text",
    [
        "",
        "I'm sorry, but I can't help with that.",
        "I\u2019m unable to see pictures",
        "As an AI model, I have no eyes.",
        "Sorry, no.",
        "a pot " * 100,
        "Here it is:",
        "N/A",
        "I don't see any picture.",
        "Unfortunately, I cannot view images",
        "No image was attached",
    ],
)
def test_what_is_no_caption_is_refused(text: str) -> None:
    with pytest.raises(DataError, match="expected a sentence about the object"):
        parse_caption(text)


@pytest.mark.parametrize(
    "text",
    [
        "A pot.",
        "<think>a pan?</think>A pot.",
        "A pan, or a pot? It has a lid.\n</think>\n\nA pot.",
        "```\nA pot.\n```",
        "Sure, a description:\n**A pot.**",
        '"A pot."',
    ],
)
def test_a_caption_is_read_out_of_what_stands_around_it(text: str) -> None:
    assert parse_caption(text) == "A pot"


def test_json_takes_one_question_and_shows_the_picture() -> None:
    model = Parrot(lambda request: json.dumps(JSON))
    picture = np.zeros((4, 4, 3), dtype=np.uint8)
    proposer = ChatProposer(model, Fixed(), form="json")
    assert proposer.propose("pot-0001", "pot", picture) == (STEEL, OAK, WATER)
    (request,) = model.asked
    assert len(request.images) == 1
    assert "picture of it is attached" in request.text


def test_rubbish_is_asked_again_with_another_seed() -> None:
    model = Parrot(lambda request: "hm" if request.seed < 102 else asked_in_lists(request))
    proposer = ChatProposer(model, Fixed(), retries=2)
    assert proposer.propose("pot-0001", "pot") == (STEEL, OAK, WATER)
    assert proposer.fallbacks == 0
    assert [request.seed for request in model.asked] == [100, 101, 102] * 2


@pytest.mark.parametrize("form", ["lists", "json"])
def test_rubbish_to_the_end_is_a_fallback_that_is_counted_and_named(form: str) -> None:
    proposer = ChatProposer(Parrot(lambda request: "hm"), Fixed(), form=form, retries=1)
    assert proposer.propose("pot-0001", "pot") == (WATER,)
    assert proposer.propose("pot-0002", "pot") == (WATER,)
    assert proposer.fallbacks == 2
    assert proposer.source == "parrot; if it fails, fixed"


def test_thicknesses_of_other_materials_to_the_end_are_a_fallback() -> None:
    model = Parrot(lambda request: LIST if request.prompt == "materials/2" else "(tin: 1 cm)")
    proposer = ChatProposer(model, Fixed(), retries=1)
    assert proposer.propose("pot-0001", "pot") == (WATER,)
    assert proposer.fallbacks == 1


def plate(name: str, low_z: float, thickness_cm: float, material: str) -> Box:
    return Box(name, (0, 0, low_z), (100, 100, low_z + thickness_cm), 1.0, material=material)


@pytest.fixture(scope="module")
def train(tmp_path_factory: pytest.TempPathFactory) -> Examples:
    root = tmp_path_factory.mktemp("prior") / "dataset"
    pots = [
        [plate("a", 0, 0.2, "steel"), plate("b", 1, 0.2, "steel"), plate("c", 2, 0.4, "abs")],
        [plate("a", 0, 0.4, "steel"), plate("b", 1, 3, "wood"), plate("c", 9, 1, "air")],
    ]
    mugs = [[plate("a", 0, 1.0, "porcelain"), plate("b", 2, 1.0, "")]]
    boxes = [("pot", parts) for parts in pots] + [("mug", parts) for parts in mugs]
    objects = [
        box_object(f"a-{number:04}", parts, split="train", category=category)
        for number, (category, parts) in enumerate(boxes)
    ]
    objects.append(box_object("b-0001", [plate("a", 0, 1, "gold")], category="pot"))
    write_folder(objects, root, version="0.1.0", builder="tests")
    return Examples(open_folder(root), "train", Modality.CATEGORY)


def test_the_prior_gives_what_the_category_was_made_of_commonest_first(train: Examples) -> None:
    candidates = PriorProposer(train).propose("pot-0009", "pot")
    # steel in two pots, abs and wood in one each; porcelain from the mugs; gold is not in training
    assert [each.name for each in candidates] == ["steel", "abs", "wood", "porcelain"]
    assert candidates[0].density_g_cm3 == (7.75, 7.9)
    assert candidates[2].density_g_cm3 == (0.1, 1.0)


def test_the_prior_has_the_quartiles_of_plate_thicknesses(train: Examples) -> None:
    steel = PriorProposer(train).propose("pot-0009", "pot")[0]
    # 0.2, 0.2 and 0.4 cm; a plate of 100 cm has 2 V / A within 1 % of its thickness
    assert steel.thickness_cm == pytest.approx((0.2, 0.3), rel=0.01)


def test_the_prior_gives_an_unseen_category_what_is_commonest_of_all(train: Examples) -> None:
    names = [each.name for each in PriorProposer(train).propose("jar-0001", "jar")]
    assert names == ["steel", "abs", "porcelain", "wood"]


def test_the_prior_says_that_it_is_one(train: Examples) -> None:
    prior = PriorProposer(train)
    assert isinstance(prior, MaterialProposer)
    assert prior.source == "material prior of the training split"
    assert prior.fallbacks == 0


def test_the_prior_has_no_apparent_densities(train: Examples) -> None:
    apparent = Examples(train.folder, "train", train.reads, "apparent_density")
    with pytest.raises(DataError, match="expected the target 'density', got 'apparent_density'"):
        PriorProposer(apparent)


def test_a_training_split_without_materials_is_no_prior(tmp_path: Path) -> None:
    root = tmp_path / "dataset"
    bare = box_object("mug-0001", [plate("a", 0, 1, "")], split="train")
    write_folder([bare], root, version="0.1.0", builder="tests")
    with pytest.raises(DataError, match="no part of the split 'train' has a material"):
        PriorProposer(Examples(open_folder(root), "train", Modality.NONE))
