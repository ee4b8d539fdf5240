"""What LAC / 0.17 reads: pinned to tabulated attenuation, and the manual's page says the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from xden1k.values.materials import load_materials, parse_composition
from xden_builder.physics import rule
from xden_builder.physics.attenuation import mac_cm2_g
from xden_builder.physics.rule import (
    PRINTED,
    draw_rule,
    printed_table,
    times_table,
    times_too_dense,
    times_too_dense_in_beam,
)
from xden_builder.physics.source import Tube

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "manual" / "lac-017.md").read_text(encoding="utf-8")
XCOM_100_KEV = {
    "water, H₂O": 0.1707,
    "air": 0.1541,
    "glass, SiO₂": 0.1684,
    "polypropylene, C₃H₆": 0.1719,
    "rubber, C₅H₈": 0.1683,
    "wood, C₆H₁₀O₅": 0.1621,
    "aluminium": 0.1704,
}
"""NIST XCOM, cm²/g."""


@pytest.mark.parametrize("row", PRINTED, ids=lambda row: row.name)
def test_table_1_is_set_beside_tabulated_attenuation(row: rule.PrintedRow) -> None:
    tabulated = mac_cm2_g(row.composition, 100.0)
    assert float(tabulated) == pytest.approx(XCOM_100_KEV[row.name], rel=1e-3)
    assert abs(row.mac_cm2_g / tabulated - 1) < 0.13


def test_of_table_1_rubber_is_off_most_and_water_least() -> None:
    off = {row.name: abs(row.mac_cm2_g / XCOM_100_KEV[row.name] - 1) for row in PRINTED}
    assert (max(off, key=off.__getitem__), min(off, key=off.__getitem__)) == (
        "rubber, C₅H₈",
        "water, H₂O",
    )


def test_the_lac_of_rubber_and_wood_alone_are_not_as_printed_mac_and_density() -> None:
    odd = {
        row.name.partition(",")[0]
        for row in PRINTED
        if abs(row.mac_cm2_g * row.density_g_cm3 / row.lac_per_cm - 1) > 0.03
    }
    assert odd == {"rubber", "wood"}


def test_the_rule_is_right_for_light_matter_at_100_kev_alone() -> None:
    light = [
        load_materials()[name].composition for name in ("water", "pp", "wood_oak", "aluminium")
    ]
    assert [float(times_too_dense(one, 100.0)) for one in light] == pytest.approx([1] * 4, abs=0.05)
    assert all(times_too_dense(one, 50.0) > 1.2 for one in light)
    assert float(times_too_dense(parse_composition("Pb:1"), 100.0)) == pytest.approx(32.6, rel=0.01)


def test_one_energy_in_a_beam_is_that_energy() -> None:
    steel = load_materials()["steel"]
    found = times_too_dense_in_beam(steel.composition, 7.85, 0.3, Tube(energy_kev=100.0))
    assert found == pytest.approx(float(times_too_dense(steel.composition, 100.0)))


def test_in_a_beam_nothing_is_read_too_light_and_thick_parts_less_dense_than_thin_ones() -> None:
    for name in rule.SHOWN:
        material = load_materials()[name]
        solid = (material.composition, material.density_nominal_g_cm3)
        thin, thick = (times_too_dense_in_beam(*solid, depth) for depth in (0.1, 2.0))
        assert thin > thick > 1.2


def test_the_page_has_the_tables_as_they_are_computed() -> None:
    assert printed_table() in PAGE
    assert times_table() in PAGE


@pytest.mark.slow
def test_the_figure_of_the_page_is_the_one_that_is_drawn(tmp_path: Path) -> None:
    draw_rule(tmp_path / "drawn.png")
    drawn, kept = imread(tmp_path / "drawn.png"), imread(DOCS / "images" / "lac-017.png")
    assert drawn.shape == kept.shape
    assert np.abs(drawn - kept).mean() < 0.01
