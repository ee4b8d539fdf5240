"""What makes phantoms untidy: each thing as often as said, and nothing else changed by it."""

from __future__ import annotations

import numpy as np
import pytest

from xden1k.errors import DataError
from xden1k.values.materials import MaterialLibrary, load_materials
from xden1k.values.palette import PAINTS
from xden_builder.phantoms import CATALOGUE, Plan, make_phantom, realism
from xden_builder.phantoms.realism import (
    LIFELIKE,
    TIDY,
    Realism,
    draw_label,
    draw_solid_share,
)

PAINTED = Realism(paint_share=1.0)
WRONG = Realism(wrong_label_share=1.0)
PLAN = Plan.of(3, "screwdriver-0002")


def test_tidy_parts_are_solid_bare_and_rightly_labelled() -> None:
    for part in make_phantom(PLAN).parts:
        assert part.solid_share == 1.0
        assert not part.painted
        assert part.label_material == part.material
        assert 0.0 <= part.roughness <= 1.0
        assert part.metalness == float(load_materials()[part.material].family == "metal")


def test_realism_leaves_shape_and_material_alone() -> None:
    tidy, real = make_phantom(PLAN), make_phantom(PLAN, Realism(1.0, 0.5, 0.5, 1.0))
    for one, other in zip(tidy.parts, real.parts, strict=True):
        assert (one.name, one.role, one.material) == (other.name, other.role, other.material)
        assert one.mesh.vertices.tobytes() == other.mesh.vertices.tobytes()
        assert other.density_g_cm3 == one.density_g_cm3 * other.solid_share
        assert other.label_material != one.material
        assert other.painted
        assert other.metalness == 0.0


def test_parts_of_one_role_share_pores_and_paint() -> None:
    real = Realism(porous_share=0.5, paint_share=0.5)
    for number in range(6):
        parts = make_phantom(Plan.of(0, f"scissors-{number:04d}"), real).parts
        batches = {(p.role, p.solid_share, p.painted, p.color_rgb, p.roughness) for p in parts}
        assert len(batches) == len({part.role for part in parts})


def test_no_coat_is_told_by_a_colour_of_the_palette_to_the_bit() -> None:
    painted = [
        part.color_rgb
        for number in range(4)
        for part in make_phantom(Plan.of(3, f"screwdriver-{number:04d}"), PAINTED).parts
    ]
    off = np.abs(np.array(painted)[:, None] - np.array(PAINTS)).max(axis=2).min(axis=1)
    assert (off > 0.0).all()
    assert np.median(off) < 0.05


@pytest.mark.parametrize(("material", "may"), [("abs", True), ("steel", False), ("water", False)])
def test_only_what_can_have_pores_has_them(material: str, may: bool) -> None:
    rng = np.random.default_rng(0)
    shares = np.array([draw_solid_share(rng, material, 0.3) for _ in range(2000)])
    assert ((shares >= 0.35) & (shares <= 1.0)).all()
    assert (shares < 1.0).mean() == pytest.approx(0.3 * may, abs=0.04)


def test_labels_err_as_often_as_said_and_stay_in_the_family() -> None:
    rng, known = np.random.default_rng(0), load_materials()
    labels = [draw_label(rng, "abs", LIFELIKE) for _ in range(4000)]
    wrong = [label for label in labels if label not in ("", "abs")]
    assert labels.count("") / 4000 == pytest.approx(0.05, abs=0.015)
    assert len(wrong) / 4000 == pytest.approx(0.05, abs=0.015)
    assert {known[label].family for label in wrong} == {"polymer"}
    assert {draw_label(rng, "abs", TIDY) for _ in range(50)} == {"abs"}


def test_grades_in_the_library_change_no_label_that_is_drawn(monkeypatch) -> None:
    bases = load_materials().bases
    drawn = [draw_label(np.random.default_rng(3), name, WRONG) for name in bases]
    monkeypatch.setattr(realism, "load_materials", lambda: MaterialLibrary(tuple(bases.values())))
    assert drawn == [draw_label(np.random.default_rng(3), name, WRONG) for name in bases]


def test_phantoms_are_made_of_bases_alone() -> None:
    used = {name for each in CATALOGUE for row in each.materials.values() for name in row.split()}
    assert used <= set(load_materials().bases)


@pytest.mark.parametrize(
    ("shares", "message"),
    [
        ({"paint_share": 1.2}, "paint_share must be from 0 to 1, got 1.2"),
        ({"porous_share": -0.1}, "porous_share must be from 0 to 1"),
        ({"wrong_label_share": 0.6, "missing_label_share": 0.5}, "must be 1 at most, got 1.1"),
    ],
)
def test_impossible_shares_are_refused(shares: dict[str, float], message: str) -> None:
    with pytest.raises(DataError, match=message):
        Realism(**shares)
