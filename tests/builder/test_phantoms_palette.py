"""Paint and bare material: told apart where an eye could, and nowhere else."""

import numpy as np
import pytest

from xden1k.values.palette import PAINTS, is_coat, usual_colors
from xden_builder.phantoms.appearance import draw_color, draw_paint

DRAWS = 300


@pytest.mark.parametrize("material", ["steel", "brass", "cast_iron", "wood_beech", "porcelain"])
def test_paint_is_told_from_bare_material(material: str) -> None:
    rng, shades = np.random.default_rng(3), np.random.default_rng(4)
    bare = [is_coat(material, draw_color(rng, material)) for _ in range(DRAWS)]
    coats = [is_coat(material, draw_paint(rng, shades)[0]) for _ in range(DRAWS)]
    assert np.mean(bare) < 0.02
    assert np.mean(coats) > 0.8


@pytest.mark.parametrize("material", ["abs", "pet"])
def test_paint_on_plastic_is_not_told(material: str) -> None:
    rng, shades = np.random.default_rng(3), np.random.default_rng(4)
    assert usual_colors(material) == PAINTS
    assert not any(is_coat(material, draw_paint(rng, shades)[0]) for _ in range(DRAWS))


def test_no_coat_keeps_on_a_liquid() -> None:
    assert not any(is_coat("water", color) for color in PAINTS)
