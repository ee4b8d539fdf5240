"""What a mass on the scale says of materials, beside the images."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.builder.poly_scenes import Solid, box, captured, solved, tool, true_mass_g
from xden_builder.capture.space import divide
from xden_builder.poly.posterior.problem import Mass
from xden_builder.poly.weighed import by_mass


def bar(label: str) -> tuple[Solid, ...]:
    """Steel that hardly any light comes through, under some label."""
    return (Solid("bar", box((1.6, 1.6, 5.0), (0.0, 0.0, 0.0)), "steel", 7.82, label),)


def chance_of(solution, posterior, number, *materials) -> float:
    candidates = solution.scene.light.tables[number].candidates
    named = np.array([each.material in materials for each in candidates])
    return float(posterior.probability[named].sum())


@pytest.mark.parametrize("label", ["copper", "zamak_3"])
def test_a_scale_tells_dark_metals_apart_that_images_cannot(label):
    capture = captured(bar(label))
    (by_images,) = solved(capture, pose=False).density_g_cm3
    weighed = replace(capture, weighed_mass_g=true_mass_g(bar(label)))
    solution = solved(weighed, pose=False)
    (by_both,) = solution.density_g_cm3
    assert abs(by_images - 7.82) > 0.5
    assert by_both == pytest.approx(7.82, rel=0.01)
    (posterior,) = solution.posteriors
    assert chance_of(solution, posterior, 0, label) < 0.1


@pytest.fixture(scope="module")
def solution():
    return solved(captured(tool()), pose=False)


def posteriors(solution, factor):
    volumes = divide([solid.annotated for solid in tool()]).volumes_cm3
    return by_mass(solution, Mass(factor * true_mass_g(tool()), volumes))


def test_the_right_mass_speaks_against_no_right_label(solution):
    for number, (solid, posterior) in enumerate(
        zip(tool(), posteriors(solution, 1.0), strict=True)
    ):
        before = chance_of(solution, solution.posteriors[number], number, solid.material)
        assert chance_of(solution, posterior, number, solid.material) > 0.95 * before


@pytest.mark.parametrize("factor", [0.1, 0.5, 2.0, 10.0])
def test_a_scale_that_was_misread_changes_no_material_that_images_tell(solution, factor):
    for before, after in zip(solution.posteriors, posteriors(solution, factor), strict=True):
        assert after.probability.sum() == pytest.approx(1.0)
        assert after.probability.argmax() == before.probability.argmax()
