"""Materials weighed by the images: what is not tried would have changed nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.builder.poly_scenes import captured, solved, tool
from xden_builder.poly.materials import evidence
from xden_builder.poly.materials.stand_ins import mixtures
from xden_builder.poly.model import pixels


def test_what_is_not_tried_would_not_have_been_probable(monkeypatch):
    capture = captured(tool(label="abs"), size=64)
    few = solved(capture, pose=False).posteriors
    monkeypatch.setattr(evidence, "NEGLIGIBLE", 1e-300)
    every = solved(capture, pose=False).posteriors
    for some, all_of_them in zip(few, every, strict=True):
        left_out = some.probability == 0
        assert left_out.any()
        best = all_of_them.probability.max()
        assert (all_of_them.probability[left_out] < 1e-3 * best).all()
        np.testing.assert_allclose(some.probability, all_of_them.probability, atol=0.02)
        assert np.isfinite(some.density_g_cm3).all()


def test_what_images_say_of_a_density_they_do_not_say_twice():
    """A density within its material's range is expected where the material's is, not where seen."""
    solution = solved(captured(tool(), size=64), pose=False)
    tables = solution.scene.light.tables
    once = mixtures(tables, solution.posteriors, 0.1)
    denser = [
        replace(each, density_g_cm3=1.02 * each.density_g_cm3) for each in solution.posteriors
    ]
    np.testing.assert_array_equal(mixtures(tables, denser, 0.1).mean_g_cm3, once.mean_g_cm3)
    for table, posterior, mean in zip(tables, solution.posteriors, once.mean_g_cm3, strict=True):
        if posterior.probability.max() > 0.99:
            likeliest = int(posterior.probability.argmax())
            assert mean == pytest.approx(table.priors[likeliest, 0], rel=0.01)


def test_a_body_with_pores_is_expected_where_images_put_it():
    """The middle of its wide range says nothing, and would pull solids mixed with it."""
    solution = solved(captured(tool(), size=64), pose=False)
    tables = solution.scene.light.tables
    index, table = next(
        (index, table)
        for index, table in enumerate(tables)
        if any(not each.solid for each in table.candidates)
    )
    porous = next(k for k, each in enumerate(table.candidates) if not each.solid)
    posterior = solution.posteriors[index]
    probability = np.zeros_like(posterior.probability)
    probability[porous] = 1.0
    low, high = table.priors[porous, 2:]
    for seen in (0.7 * low + 0.3 * high, 0.4 * low + 0.6 * high):
        density = posterior.density_g_cm3.copy()
        density[porous] = seen
        told = replace(posterior, probability=probability, density_g_cm3=density)
        mixed = mixtures([table], [told], 0.1)
        assert mixed.mean_g_cm3[0] == pytest.approx(seen)


def test_between_materials_of_which_none_is_likely_a_density_is_one_of_theirs():
    """Half of steel and half of aluminium is no density that anything has."""
    solution = solved(captured(tool(label=""), size=64), pose=False)
    table = next(each for each in solution.scene.light.tables if len(each.candidates) > 20)
    posterior = solution.posteriors[solution.scene.light.tables.index(table)]
    solids = [k for k, each in enumerate(table.candidates) if each.solid]
    light, middle, dense = sorted(solids, key=lambda k: table.priors[k, 0])[:: len(solids) // 2][:3]
    probability = np.zeros_like(posterior.probability)
    probability[[light, middle, dense]] = 0.4, 0.25, 0.35
    mixed = mixtures([table], [replace(posterior, probability=probability)], 0.1)
    assert mixed.mean_g_cm3[0] == pytest.approx(table.priors[middle, 0])
    probability[[light, middle, dense]] = 0.6, 0.0, 0.4
    clear = mixtures([table], [replace(posterior, probability=probability)], 0.1)
    assert clear.mean_g_cm3[0] <= table.priors[light, 3]


def test_air_beside_an_object_does_not_weaken_what_its_radiographs_say(monkeypatch):
    capture = captured(tool(), size=128)
    little = solved(capture, pose=False)
    monkeypatch.setattr(pixels, "AIR_PIXELS", 20 * pixels.AIR_PIXELS)
    much = solved(capture, pose=False)
    for before, after in zip(little.seen, much.seen, strict=True):
        assert len(after.samples.pixels) > 2 * len(before.samples.pixels)
    for before, after in zip(little.posteriors, much.posteriors, strict=True):
        likeliest = int(before.probability.argmax())
        sds = before.sd_g_cm3[likeliest], after.sd_g_cm3[likeliest]
        assert sds[1] == pytest.approx(sds[0], rel=0.1)
        np.testing.assert_allclose(after.probability, before.probability, atol=0.1)
