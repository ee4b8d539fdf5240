"""A rebuild that is told no labels: nothing that tells a density by words reaches it."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from tests.builder.poly_scenes import captured, relabelled, tool
from xden1k.format.records import object_row
from xden1k.rays import outer_surface
from xden_builder.capture import Capture
from xden_builder.reconstruct.clues import find_clues
from xden_builder.reconstruct.object import reconstruct
from xden_builder.reconstruct.settings import BuildSettings
from xden_builder.reconstruct.withheld import as_told

BLIND = BuildSettings(labels="withheld")
OUTER = BuildSettings(geometry="outer")


@pytest.fixture(scope="module")
def capture() -> Capture:
    return captured(tool(), size=32)


@pytest.fixture(scope="module")
def lying(capture: Capture) -> Capture:
    """The same images, with labels, a hollow part and a mass that are all wrong."""
    wrong = relabelled(capture, blade="pp", grip="lead", level="gold")
    parts = tuple(replace(part, hollow=True) for part in wrong.parts)
    return replace(wrong, parts=parts, weighed_mass_g=1e4)


def test_a_blind_capture_holds_no_material_hollow_part_or_mass(lying: Capture) -> None:
    told = as_told(lying, BLIND)
    assert {(part.material, part.hollow) for part in told.parts} == {("", False)}
    assert told.weighed_mass_g is None
    assert as_told(lying, BuildSettings()) is lying


def test_the_outer_surface_alone_says_nothing_of_parts(lying: Capture) -> None:
    for settings in (OUTER, replace(OUTER, labels="withheld")):
        (whole,) = as_told(lying, settings).parts
        assert (whole.name, whole.material, whole.hollow) == ("whole", "", True)
    outer = outer_surface([part.mesh for part in lying.parts])
    assert float(whole.mesh.volume) == pytest.approx(float(outer.volume))


@pytest.mark.slow
def test_a_rebuild_of_the_outer_surface_alone_is_of_one_part(capture: Capture) -> None:
    rebuilt = reconstruct(capture, OUTER)
    assert [part.name for part in rebuilt.parts] == ["whole"]
    assert rebuilt.meta["settings"]["geometry"] == "outer"
    assert rebuilt.meta["mesh_units"] == "cm"


@pytest.mark.slow
def test_labels_change_no_byte_of_a_blind_rebuild(capture: Capture, lying: Capture) -> None:
    capture, lying = replace(capture, split="test"), replace(lying, split="test")
    assert find_clues(capture, BLIND) == find_clues(lying, BLIND)
    rows = [object_row(reconstruct(one, BLIND)) for one in (capture, lying)]
    assert rows[0] == rows[1]
    assert json.loads(rows[0]["meta_json"])["settings"]["labels"] == "withheld"
