"""Which samples are compared, and how far each is trusted."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
import trimesh

from tests.builder.poly_scenes import TUBE, captured, tool
from xden1k.rays import ownership_order, path_lengths
from xden1k.values.views import ViewGeometry, XRayView
from xden_builder.capture import Capture
from xden_builder.capture.space import divide
from xden_builder.fit.outline import on_outline
from xden_builder.physics.groups import energy_groups
from xden_builder.physics.source import Detector
from xden_builder.poly.line import sampled
from xden_builder.poly.materials.candidates import candidate_table
from xden_builder.poly.materials.stand_ins import certain
from xden_builder.poly.model.beam import Heel, ViewBeam
from xden_builder.poly.model.frames import coarse
from xden_builder.poly.model.pixels import (
    BLOCK_PX,
    BLOCK_RAYS,
    SATURATED,
    ViewPixels,
    choose_pixels,
)
from xden_builder.poly.model.stray import StrayShapes
from xden_builder.poly.posterior.trust import USUAL_VEIL, Veil, sample_sd
from xden_builder.poly.settings import PolySettings

GROUPS = energy_groups(TUBE, Detector("CsI"))
MESHES = [solid.mesh for solid in tool()]
ORDER = ownership_order(MESHES)
NONE = np.zeros((126, 126), dtype=bool)


@pytest.fixture(scope="module")
def capture() -> Capture:
    return captured(tool(), size=126, rays=11)


def lengths_of(view):
    """Of its pixels, and of its blocks."""
    return (
        path_lengths(MESHES, ORDER, view.geometry),
        path_lengths(MESHES, ORDER, coarse(view.geometry, BLOCK_PX), BLOCK_RAYS, turned=True),
    )


def chosen(view, seed=0, saturated=NONE) -> ViewPixels:
    beam = ViewBeam(GROUPS, view.geometry, Heel())
    rng = np.random.default_rng(seed)
    return choose_pixels(view, saturated, *lengths_of(view), beam, rng)


def test_every_part_is_sampled_and_air_on_all_sides(capture):
    for view in capture.views:
        samples = chosen(view)
        assert (samples.meets.sum(axis=0) >= 50).all()
        air = ~samples.meets.any(axis=1)
        rows, columns = np.divmod(samples.pixels[air], 126)
        assert air.sum() == 300
        assert np.ptp(rows) > 63
        assert np.ptp(columns) > 63
        assert (samples.measured[air] == 1).all()


def test_inner_pixels_stand_alone_and_outlines_come_in_blocks(capture):
    view = capture.views[1]
    lengths, _ = lengths_of(view)
    outline = set(lengths.pixels[on_outline(lengths)].tolist())
    samples = chosen(view)
    alone = samples.meets.any(axis=1) & ~samples.is_block
    assert not outline & set(samples.pixels[alone].tolist())
    assert (samples.rays[alone] == 1).all()
    assert (samples.rays[samples.is_block] == BLOCK_RAYS**2 + 1).all()
    middle = np.divmod(samples.pixels[samples.is_block], 126)
    assert all(((index - 1) % BLOCK_PX == 0).all() for index in middle)


PANEL = ViewGeometry.from_dict(
    {
        "beam": "parallel",
        "direction": [0, 1, 0],
        "pixel00_cm": [-2.95, 0, 2.95],
        "column_step_cm": [0.1, 0, 0],
        "row_step_cm": [0, 0, -0.1],
        "shape": [60, 60],
    }
)


def samples_of(mesh) -> ViewPixels:
    """Of a view of that panel without any shadow."""
    light, valid = np.ones((60, 60), dtype=np.float32), np.ones((60, 60), dtype=bool)
    return choose_pixels(
        XRayView("pa", light, valid, PANEL),
        ~valid,
        path_lengths([mesh], [0], PANEL),
        path_lengths([mesh], [0], coarse(PANEL, BLOCK_PX), BLOCK_RAYS, turned=True),
        ViewBeam(GROUPS, PANEL, Heel()),
        np.random.default_rng(0),
    )


def comb(of: Literal["wires", "wedge"]) -> trimesh.Trimesh:
    """A row of wires, each behind the middle of a column of pixels, or a wedge as wide."""
    if of == "wedge":
        corners = [(x, y, z) for x, y in ((-1.5, 0), (1.5, 0), (1.5, 0.1)) for z in (-1.5, 1.5)]
        return trimesh.convex.convex_hull(corners)
    wire = trimesh.creation.cylinder(0.045, 3.0, sections=64)
    places = np.arange(-14.5, 15) / 10
    return trimesh.util.concatenate([wire.copy().apply_translation((x, 0, 0)) for x in places])


@pytest.mark.parametrize(("of", "alone"), [("wires", False), ("wedge", True)])
def test_a_centre_on_a_wire_finer_than_its_pixel_does_not_stand_for_the_pixel(of, alone):
    samples = samples_of(comb(of))
    meets = samples.meets[:, 0]
    assert (meets & ~samples.is_block).any() == alone
    assert (meets & samples.is_block).sum() >= 50


@pytest.mark.parametrize("height_cm", [0.0, 0.013, 0.04, 0.077, 0.111, 0.16, 0.21])
def test_blocks_see_a_thin_plate_along_their_rows_to_a_thirtieth(height_cm):
    """Rays in rows would all cross a surface at once, and see it to a twelfth."""
    plate = trimesh.creation.box((2.4, 1.0, 0.2)).apply_translation((0.0, 0.0, height_cm))
    samples = samples_of(plate)
    rows = samples.index // 20
    tops = 3.0 - 0.3 * rows
    low = np.maximum(tops - 0.3, height_cm - 0.1)
    expected = (np.minimum(tops, height_cm + 0.1) - low).clip(0) / 0.3
    met = (samples.lengths_cm[..., 0] > 0).sum(axis=1) / samples.rays
    mine = samples.is_block & (np.abs(samples.index % 20 - 9.5) < 3)
    assert mine.sum() >= 6
    assert np.abs(met - expected)[mine].max() < 1 / 30


def test_the_model_of_a_sample_is_its_measured_transmission(capture):
    mac = np.stack([table.mac_cm2_g[0] for table in tables()])
    density = np.array([solid.density_g_cm3 for solid in tool()])
    for view in capture.views:
        samples = chosen(view)
        model, _ = samples.predict(mac, density)
        kinds = {"pixel": ~samples.is_block, "block": samples.is_block}
        for kind, limit in (("pixel", 0.005), ("block", 0.015)):
            off = np.abs(model - samples.measured)[kinds[kind]]
            assert np.quantile(off, 0.95) < limit, kind


def tables():
    return [candidate_table(solid.annotated, GROUPS) for solid in tool()]


def test_pixels_that_are_not_valid_are_not_compared(capture):
    view = capture.views[0]
    valid = np.random.default_rng(1).random(view.valid.shape) > 0.3
    image = np.where(valid, view.transmission, np.nan).astype(np.float32)
    samples = chosen(replace(view, transmission=image, valid=valid))
    assert np.isfinite(samples.measured).all()
    assert valid.flat[samples.pixels[~samples.is_block]].all()
    for row, column in zip(*np.divmod(samples.pixels[samples.is_block], 126), strict=True):
        assert valid[row - 1 : row + 2, column - 1 : column + 2].all(), "a block with a hole"


def test_saturated_pixels_are_known_from_below_and_crowd_out_nothing_else(capture):
    view = capture.views[0]
    saturated = view.transmission > 0.7  # all air, and thin plastic
    samples, full = chosen(view), chosen(view, saturated=saturated)
    alone = ~full.is_block
    np.testing.assert_array_equal(full.at_least[alone], saturated.flat[full.pixels[alone]])
    assert full.at_least[full.is_block].any()
    told = ~full.at_least & full.meets.any(axis=1)
    assert told.sum() > 0.5 * samples.meets.any(axis=1).sum()
    assert (full.meets & full.at_least[:, None]).sum(axis=0).max() <= 3 * 2 * SATURATED


def test_the_same_numbers_choose_the_same_samples(capture):
    view = capture.views[0]
    first, again, other = chosen(view), chosen(view), chosen(view, seed=1)
    np.testing.assert_array_equal(first.pixels, again.pixels)
    assert first.pixels.tolist() != other.pixels.tolist()


def trusted(view, samples, noise_sd=0.0, stray=0.0, scatter=None, **choices):
    lengths, blocks = lengths_of(view)
    taken = certain(tables(), [0, 0, 0])
    return sample_sd(
        samples,
        lengths,
        blocks,
        ViewBeam(GROUPS, view.geometry, Heel()),
        taken.mac_cm2_g,
        taken.mean_g_cm3,
        StrayShapes(np.full((len(samples.pixels), 7), stray)),
        USUAL_VEIL if scatter is None else Veil(np.array(scatter), np.zeros(2)),
        noise_sd,
        PolySettings(**choices),
    )


def test_bare_air_errs_by_the_floor_and_nothing_by_less(capture):
    view = capture.views[0]
    samples = chosen(view)
    sd = trusted(view, samples)
    air = ~samples.meets.any(axis=1)
    np.testing.assert_allclose(sd[air], PolySettings().clear_floor, rtol=1e-9)
    assert sd.min() >= PolySettings().floor


def test_much_scatter_errs_by_more_than_is_usual_and_little_by_no_less(capture):
    samples = chosen(capture.views[0])
    air = ~samples.meets.any(axis=1)
    usual_amplitude = USUAL_VEIL.amplitudes[0]
    none, usual, much = (
        trusted(capture.views[0], samples, stray=0.5, scatter=[amplitude] * 2)[air]
        for amplitude in (0.0, usual_amplitude, 5 * usual_amplitude)
    )
    np.testing.assert_array_equal(none, usual)
    floor = PolySettings().floor
    np.testing.assert_allclose(np.sqrt(much**2 - floor**2), 5 * np.sqrt(usual**2 - floor**2))


def test_each_error_adds_to_the_others(capture):
    view = capture.views[0]
    samples = chosen(view)
    least = trusted(view, samples)
    assert (trusted(view, samples, noise_sd=0.01) > least).all()
    assert (trusted(view, samples, stray=0.5) > least).all()
    dark, clear = trusted(view, samples, floor=0.02), trusted(view, samples, clear_floor=0.02)
    assert ((dark > least) ^ (clear > least)).all()
    met = samples.meets.any(axis=1)
    assert (trusted(view, samples, model_share=0.1) >= least).all()
    assert (trusted(view, samples, model_share=0.1) > least)[met].mean() > 0.95


def test_edges_are_trusted_less_unless_told_otherwise(capture):
    view = capture.views[0]
    samples = chosen(view)
    careful, blind = (trusted(view, samples, edge_weights=choice) for choice in (True, False))
    assert (careful >= blind).all()
    blocks = samples.is_block
    assert np.median((careful / blind)[blocks]) > 2 * np.median((careful / blind)[~blocks])


@pytest.mark.parametrize("rows", [4, 5, 8])
def test_images_whose_rows_are_no_whole_number_of_blocks_are_sampled(capture, rows):
    """Blocks are as wide as they are, whatever rows they leave over."""
    view = capture.views[0]
    first = view.geometry.shape[0] // 2
    middle = slice(first, first + rows)
    pixel00_cm = view.geometry.pixel00_cm + first * view.geometry.row_step_cm
    columns = view.geometry.shape[1]
    few = replace(view.geometry, pixel00_cm=pixel00_cm, shape=(rows, columns))
    samples = chosen(XRayView("pa", view.transmission[middle], view.valid[middle], few))
    assert samples.lengths_cm.shape[2] == len(capture.parts)


def test_a_large_panel_is_cut_into_strips_of_blocks_that_are_those_of_the_whole(
    capture, monkeypatch
):
    settings = PolySettings(pose=False, size=False)
    whole = sampled(capture, divide(capture.parts), settings)
    monkeypatch.setattr("xden_builder.poly.samples.BLOCKS_AT_ONCE", 100)
    cut = sampled(capture, divide(capture.parts), settings)
    for one, other in zip(whole.seen, cut.seen, strict=True):
        assert one.blocks.shape == other.blocks.shape
        assert one.blocks.pixels.tolist() == other.blocks.pixels.tolist()
        assert one.blocks.lengths_cm == pytest.approx(other.blocks.lengths_cm, abs=1e-6)
