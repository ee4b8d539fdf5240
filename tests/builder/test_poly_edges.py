"""Differences of neighbouring pixels: what they see of a model, and what not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.builder.poly_scenes import TUBE, box, composition, geometries, radiograph, tool
from xden1k.rays import disjoint_regions, ownership_order
from xden1k.values.views import XRayView
from xden_builder.physics.groups import energy_groups
from xden_builder.physics.source import Detector
from xden_builder.poly import pose
from xden_builder.poly.descent import Descent
from xden_builder.poly.edges import Edges, edge_doubt
from xden_builder.poly.model.beam import Heel, ViewBeam
from xden_builder.poly.model.frames import Pose
from xden_builder.poly.model.poses import Poses
from xden_builder.poly.model.radiograph import GAIN
from xden_builder.poly.pyramid import Level
from xden_builder.poly.target import Target, window

SOLIDS = tool()


def level_of(views: list[XRayView], saturated: float = np.inf) -> Level:
    """The tool before its radiographs, of which pixels beyond some light are saturated."""
    groups, meshes = energy_groups(TUBE, Detector("CsI")), [solid.mesh for solid in SOLIDS]
    regions = disjoint_regions(meshes, ownership_order(meshes))
    target = Target(
        views,
        [view.transmission > saturated for view in views],
        [GAIN] * len(views),
        [ViewBeam(groups, view.geometry, Heel()) for view in views],
        regions,
        np.stack([groups.mac_cm2_g(composition(solid.material)) for solid in SOLIDS]),
    )
    x, y, z = target.centre_cm.tolist()
    windows = [window(view.geometry, target.points_cm, 1) for view in views]
    return Level.of(target, Poses((False, False), Pose(centre_cm=(x, y, z))), windows, 1)


def shown() -> list[XRayView]:
    """What the tool looks like in its place."""
    return [radiograph(SOLIDS, name, geometry, rays=4) for name, geometry in geometries(96).items()]


def right(level: Level) -> np.ndarray:
    """Unknowns of the tool as it is."""
    density = np.array([solid.density_g_cm3 for solid in SOLIDS])
    return np.concatenate([density, [1.0, 1.0, 0.0, 0.0], np.zeros(level.poses.count)])


@pytest.fixture(scope="module")
def views() -> list[XRayView]:
    return shown()


def test_what_takes_the_same_share_of_all_light_changes_no_difference(views):
    dimmed = [replace(view, transmission=np.float32(0.7) * view.transmission) for view in views]
    plain, behind = (Edges.of(level_of(each)) for each in (views, dimmed))
    unknowns = right(plain.level)
    told = (each.residuals(unknowns) for each in (plain, behind))
    for off, other, scale, same in zip(*told, plain.scales, behind.scales, strict=True):
        assert_allclose(other[: len(same)] * same, off[: len(scale)] * scale, atol=1e-5)
        assert np.abs(off[: len(scale)]).max() > 0.1


def test_light_that_the_model_lacks_counts_and_light_that_was_taken_does_not(views):
    plain, darker, brighter = (
        Edges.of(
            level_of(
                [
                    replace(view, transmission=np.float32(share) * view.transmission)
                    for view in views
                ]
            )
        )
        for share in (1.0, 0.8, 1.25)
    )
    unknowns = right(plain.level)
    wanting = [
        sum(
            float(np.abs(off[len(scale) :]).sum())
            for off, scale in zip(each.residuals(unknowns), each.scales, strict=True)
        )
        for each in (plain, darker, brighter)
    ]
    assert wanting[1] <= wanting[0]
    assert wanting[2] > 10 * wanting[0]


def test_slopes_are_those_of_the_residuals(views):
    edges = Edges.of(level_of(views), sd=0.05)
    unknowns = right(edges.level)
    unknowns[edges.level.parts :][:2] = 0.9  # darker than the image everywhere
    _, slopes = edges.residuals_and_slopes(unknowns)
    last = len(unknowns) - 1
    by_light = [(place, 1e-3, 1e-2) for place in (0, 1, 2, 4)]
    for place, step, most in (*by_light, (last - 4, 3e-3, 0.5), (last - 2, 1e-2, 0.5)):
        way = step * np.eye(len(unknowns))[place]
        ahead, behind = (edges.residuals(unknowns + sign * way) for sign in (1, -1))
        for number, slope in enumerate(slopes):
            told = (ahead[number] - behind[number]) / (2 * step)
            off = np.linalg.norm(slope[:, place] - told)
            assert off <= most * np.linalg.norm(told) + 1e-9


def test_the_derivatives_of_the_loss_are_half_its_gradient(views):
    edges = Edges.of(level_of(views), sd=0.05)
    unknowns = 1.1 * right(edges.level)
    residuals, slopes = edges.residuals_and_slopes(unknowns)
    there = edges.evaluate(unknowns, residuals, slopes)
    for place in range(edges.level.parts):
        way = 1e-4 * np.eye(len(unknowns))[place]
        ahead, behind = (
            edges.loss(there_, edges.residuals(there_))
            for there_ in (unknowns + way, unknowns - way)
        )
        assert (ahead - behind) / 4e-4 == pytest.approx(there.gradient[place], rel=0.02)


def test_saturated_pixels_have_no_differences(views):
    level = level_of(views, saturated=0.5)
    for (before, after), at_least in zip(Edges.of(level).pairs, level.at_least, strict=True):
        assert not at_least[before].any()
        assert not at_least[after].any()
        assert len(before)


def test_the_true_pose_is_doubted_least_where_a_block_has_no_mesh(views):
    block = replace(SOLIDS[0], mesh=box((3.4, 2.8, 6.0), (0.2, 0.6, -2.4)), material="pp")
    seen = [
        replace(
            radiograph([*SOLIDS, block], view.name, view.geometry, rays=4), geometry=view.geometry
        )
        for view in views
    ]
    level = level_of(seen)
    unknowns = right(level)
    here = edge_doubt(level, unknowns)
    for place in range(len(unknowns) - level.poses.count, len(unknowns) - 1):
        for sign in (-1, 1):
            moved = unknowns + sign * 0.1 * np.eye(len(unknowns))[place]
            assert edge_doubt(level, moved) > 1.05 * here


def test_shade_beside_what_is_compared_is_doubted(views):
    level = level_of(views)
    unknowns = right(level)
    stained = []
    for view, mask in zip(views, level.masks, strict=True):
        image = view.transmission.copy()
        image[::2][~mask[::2]] = 0.3
        stained.append(replace(view, transmission=image))
    assert edge_doubt(level_of(stained), unknowns) > 1.2 * edge_doubt(level, unknowns)


@pytest.mark.parametrize("gain", [0.9, 1.1])
def test_air_that_a_model_makes_darker_or_brighter_hides_no_difference(views, gain):
    level = level_of(views)
    nothing = right(level)
    nothing[: level.parts] = 1e-4
    otherwise = nothing.copy()
    otherwise[level.parts : level.parts + 2] = gain
    assert edge_doubt(level, otherwise) > 0.99 * edge_doubt(level, nothing)


def test_too_dark_a_model_is_doubted_where_nothing_differs(views):
    dark = [replace(view, transmission=np.full_like(view.transmission, 0.5)) for view in views]
    for view in dark:
        view.transmission[:48] = 1.0
    level = level_of(dark)
    nothing = right(level)
    nothing[: level.parts] = 0.0
    darker = nothing.copy()
    darker[level.parts : level.parts + 2] = 0.6
    assert edge_doubt(level, darker) > 3 * edge_doubt(level, nothing)


def test_a_told_pose_is_gone_on_from_on_the_last_images_alone_too(views, monkeypatch):
    level = level_of(views)
    true = right(level)
    off = true.copy()
    off[level.parts + 4] = 0.05

    def astray_but_there(_level, unknowns, sds, _bounds):
        return unknowns if tuple(sds) == pose.EDGE_SDS[-1:] else off

    monkeypatch.setattr(pose, "descend_by_edges", astray_but_there)
    monkeypatch.setattr(pose, "sought_by_edges", lambda *_rest: off)
    residuals, slopes = level.residuals_and_slopes(off)
    evaluated = level.evaluate(off, residuals, slopes)
    end = Descent(off, evaluated, residuals, residuals, slopes)
    there = pose._by_edges([level], end, true, level.target.bounds(true[: level.parts], 7))
    assert np.array_equal(there.unknowns, true)


@pytest.mark.parametrize(
    ("begun_again", "very_much", "looks"), [(True, False, 2), (True, True, 4), (False, True, 0)]
)
def test_a_pose_is_looked_around_where_it_is_begun_again_and_on_while_any_reach_leaves_less(
    views, monkeypatch, begun_again, very_much, looks
):
    level = level_of(views)
    true = right(level)
    off = true.copy()
    off[level.parts + 4] = 0.05
    asked = []

    def around(_level, unknowns, _sd, reach, _bounds):
        asked.append((unknowns, reach))
        return true if len(asked) == 1 else off

    monkeypatch.setattr(pose, "descend_by_edges", lambda _level, unknowns, *_rest: unknowns)
    monkeypatch.setattr(pose, "sought_by_edges", around)
    monkeypatch.setattr(pose, "much_left", lambda *_rest: very_much)
    residuals, slopes = level.residuals_and_slopes(off)
    evaluated = level.evaluate(off, residuals, slopes)
    end = Descent(off, evaluated, residuals, residuals, slopes)
    told = off if begun_again else None
    there = pose._by_edges([level], end, told, level.target.bounds(true[: level.parts], 7))
    assert np.array_equal(there.unknowns, true if begun_again else off)
    assert [np.array_equal(start, off) for start, _ in asked] == [True, False, False, False][:looks]
    assert len({reach for _, reach in asked}) == (3 if looks > 2 else min(looks, 1))
