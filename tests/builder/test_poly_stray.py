"""Stray light: nothing from nothing, and a veil of the assumed shape is measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from tests.builder.poly_scenes import (
    TUBE,
    captured,
    composition,
    fitted,
    geometries,
    relabelled,
    solved,
    tool,
)
from xden1k.rays import PathLengths, ownership_order, path_lengths
from xden1k.values.views import ViewGeometry, XRayView
from xden_builder.capture import Capture
from xden_builder.physics.groups import energy_groups
from xden_builder.physics.source import Detector
from xden_builder.poly.model.beam import Heel, ViewBeam
from xden_builder.poly.model.frames import coarse
from xden_builder.poly.model.stray import (
    WIDTHS,
    StrayShapes,
    coarse_binning,
    glare_of,
    middle_of,
    pitches_cm,
    scatter_reaches_cm,
    spread_by_glare,
    stray_image,
    stray_light,
)
from xden_builder.poly.posterior import problem

SIZE = 128
GROUPS = energy_groups(TUBE, Detector("CsI"))


def coefficients() -> tuple[np.ndarray, np.ndarray]:
    """Attenuation of each part in each group, and the scattering part of it."""
    compositions = [composition(solid.material) for solid in tool()]
    return (
        np.stack([GROUPS.mac_cm2_g(each) for each in compositions]),
        np.stack([GROUPS.scattering_cm2_g(each) for each in compositions]),
    )


def reaches_of(view: XRayView) -> np.ndarray:
    """What is assumed of the widths of scatter."""
    return np.array(scatter_reaches_cm(view.geometry, np.zeros(3)))


def shapes_of(view: XRayView, wider: tuple[float, ...] = (1.0, 1.0)) -> np.ndarray:
    """Shapes of stray light over the whole panel for the true object.

    Scatter is so much wider than assumed: near, then far, each perhaps in several widths.
    """
    reaches_cm = np.repeat(reaches_of(view), len(wider) // 2) * wider
    meshes = [solid.mesh for solid in tool()]
    small = coarse(view.geometry, coarse_binning(view.geometry.shape))
    every = np.arange(view.transmission.size)
    return stray_light(
        view,
        ViewBeam(GROUPS, view.geometry, Heel()),
        path_lengths(meshes, ownership_order(meshes), small),
        *coefficients(),
        np.array([solid.density_g_cm3 for solid in tool()]),
        every,
        view.transmission.ravel().astype(np.float64),
        reaches_cm.tolist(),
    )


def veiled(
    capture: Capture,
    near: float,
    far: float,
    glare: float = 0.0,
    wider: tuple[float, float] = (1.0, 1.0),
) -> Capture:
    """The capture with stray light of the shapes that the fit knows, or of wider scatter."""
    views = []
    for view in capture.views:
        veil = shapes_of(view, wider) @ np.array([near, far, glare])
        light = view.transmission + veil.reshape(view.transmission.shape)
        views.append(replace(view, transmission=light.astype(np.float32)))
    return replace(capture, views=(views[0], views[1]))


@pytest.fixture(scope="module")
def clean() -> Capture:
    return captured(tool(), size=SIZE)


def test_there_is_no_stray_light_without_an_object():
    geometry = geometries(size=32)["pa"]
    image = np.full(geometry.shape, 0.8, dtype=np.float32)
    view = XRayView("pa", image, np.ones(image.shape, dtype=bool), geometry)
    nothing = PathLengths(
        np.zeros(0, dtype=np.int64),
        np.zeros((0, 1, 3), dtype=np.float32),
        np.zeros(0, dtype=np.float32),
        np.zeros(0, dtype=bool),
        geometry.shape,
    )
    pixels = np.arange(0, image.size, 7)
    found = stray_light(
        view,
        ViewBeam(GROUPS, geometry, Heel()),
        nothing,
        *coefficients(),
        np.ones(3),
        pixels,
        image.flat[pixels].astype(np.float64),
        [2.0, 6.0],
    )
    assert found.shape == (len(pixels), 3)
    assert np.abs(found).max() < 1e-6, "scatter of air, or glare of an even image"


def test_the_stray_light_of_a_whole_view_is_that_of_its_pixels(clean):
    view, amplitudes = clean.views[0], np.array([0.1, 0.2, 0.03])
    meshes = [solid.mesh for solid in tool()]
    small = coarse(view.geometry, coarse_binning(view.geometry.shape) * 3)
    model = (
        view,
        ViewBeam(GROUPS, view.geometry, Heel()),
        path_lengths(meshes, ownership_order(meshes), small),
        *coefficients(),
        np.array([solid.density_g_cm3 for solid in tool()]),
    )
    every = np.arange(view.transmission.size)
    reaches = [1.5, 7.0]
    by_pixel = stray_light(*model, every, view.transmission.ravel().astype(np.float64), reaches)
    whole = stray_image(*model, amplitudes, reaches)
    np.testing.assert_allclose(whole.ravel(), by_pixel @ amplitudes, atol=1e-12)
    with_glare = stray_image(*model, amplitudes, reaches, glare_of(view, small.shape))
    np.testing.assert_array_equal(with_glare, whole)


def test_scatter_is_spread_as_by_a_gaussian_with_nothing_around(clean):
    """Against SciPy's filter on the pixels themselves, whose tails end at four deviations."""
    view = clean.views[0]
    pixel_cm = float(np.linalg.norm(view.geometry.column_step_cm))
    assert coarse_binning(view.transmission.shape) == 1
    pin, near, far = (
        shapes_of(view, (wider, wider))[:, place].reshape(SIZE, SIZE)
        for wider, place in ((1e-3, 0), (1.0, 0), (1.0, 1))
    )
    for sharp_cm, found in zip(reaches_of(view), (near, far), strict=True):
        filtered = gaussian_filter(pin, sharp_cm / pixel_cm, mode="constant", truncate=6.0)
        np.testing.assert_allclose(found, filtered, atol=1e-4 * filtered.max())


def test_light_spreads_as_far_across_rows_as_along_them_where_pixels_are_not_square(clean):
    view = clean.views[0]
    half = replace(
        view.geometry, row_step_cm=2 * view.geometry.row_step_cm, shape=(SIZE // 2, SIZE)
    )
    pairs = slice(0, SIZE, 2)
    high = XRayView("pa", view.transmission[pairs], view.valid[pairs], half)
    assert pitches_cm(high, 1) == pytest.approx(
        (2 * pitches_cm(view, 1)[0], pitches_cm(view, 1)[1])
    )
    pin = np.zeros(half.shape)
    pin[SIZE // 4, SIZE // 2] = 1.0
    spread = spread_by_glare(pin, pitches_cm(high, 1))
    reach_cm = [
        pitch * np.sqrt((each * (np.arange(len(each)) - each.argmax()) ** 2).sum() / each.sum())
        for pitch, each in zip(
            pitches_cm(high, 1), (spread.sum(axis=1), spread.sum(axis=0)), strict=True
        )
    ]
    assert reach_cm[0] == pytest.approx(reach_cm[1], rel=0.1)


def test_shapes_between_the_widths_are_those_of_their_widths(clean):
    view = clean.views[0]
    shapes = StrayShapes(shapes_of(view, (*np.exp(WIDTHS), *np.exp(WIDTHS))))
    for widths in ((0.0, 0.0), (0.25, -0.25), (-0.4, 0.4)):
        wider = float(np.exp(widths[0])), float(np.exp(widths[1]))
        found, expected = shapes.at(np.array(widths)), shapes_of(view, wider)
        np.testing.assert_allclose(found, expected, atol=0.03 * expected[:, 0].max())
        step = 1e-5
        ahead, behind = (shapes.at(np.array(widths) + off) for off in (step, -step))
        slopes = (ahead - behind)[:, :2] / (2 * step)
        np.testing.assert_allclose(shapes.slopes(np.array(widths)), slopes, atol=1e-8)


def test_scatter_reaches_as_much_farther_as_the_panel_is_away():
    near_by = geometries(size=32)["pa"]
    far_away = replace(near_by, pixel00_cm=near_by.pixel00_cm + np.array([0.0, 20.0, 0.0]))
    (near, far), (nearer, farther) = (
        scatter_reaches_cm(each, np.zeros(3)) for each in (near_by, far_away)
    )
    assert far / near == pytest.approx(3.0)
    assert (nearer - near, farther - far) == pytest.approx((2.0, 6.0))
    on_the_panel = scatter_reaches_cm(near_by, near_by.pixel00_cm)
    assert on_the_panel == pytest.approx((0.5, 1.5)), "no shape without a width"


@pytest.mark.parametrize("way_cm", [0.0, 1000.0])
def test_a_parallel_beam_tells_no_gap(way_cm):
    panel = geometries(size=32)["pa"]
    beam = ViewGeometry(
        "parallel",
        np.array([-4.0, way_cm, -4.0]),
        panel.column_step_cm,
        panel.row_step_cm,
        panel.shape,
        direction=np.array([0.0, 1.0, 0.0]),
    )
    assert scatter_reaches_cm(beam, np.zeros(3)) == pytest.approx((2.0, 6.0))


def test_the_middle_of_an_object_is_that_of_its_box():
    meshes = [solid.mesh for solid in tool()]
    corners = np.concatenate([mesh.bounds for mesh in meshes])
    whole = (corners.min(axis=0) + corners.max(axis=0)) / 2
    np.testing.assert_allclose(middle_of([*meshes, meshes[0]]), whole)


def test_scatter_is_smooth_and_fades_away_from_the_object(clean):
    near, far, glare = shapes_of(clean.views[0]).T.reshape(3, SIZE, SIZE)
    centre, corner = (SIZE // 2, SIZE // 2), (2, 2)
    for scatter, contrast in ((near, 3), (far, 1.5)):
        assert scatter.min() >= -1e-15
        assert scatter[centre] > contrast * scatter[corner]
    assert near[centre] > far[centre]
    assert near[corner] < far[corner] * near[centre] / far[centre]
    dark = clean.views[0].transmission < 0.4
    assert glare[dark].mean() > 0 > glare[~dark & (near > 0.05)].mean()


@pytest.mark.parametrize(
    ("near", "far"),
    [
        *(pytest.param(*one, marks=pytest.mark.slow) for one in ((0.15, 0.0), (0.0, 0.3))),
        (0.12, 0.1),
    ],
)
def test_strength_of_a_veil_is_recovered(clean, near, far):
    capture = veiled(clean, near, far)
    found = solved(capture, pose=False)
    for number, view in enumerate(clean.views):
        shadow = shapes_of(view)[:, 0] > 0.05
        shapes = shapes_of(view)[shadow, :2]
        expected = float((shapes @ np.array([near, far])).mean())
        fitted_veil = float((shapes @ found.nuisances(number)[1:3]).mean())
        assert fitted_veil == pytest.approx(expected, abs=0.0035)


def test_near_scatter_of_another_width_is_found_and_moves_no_density(clean, monkeypatch):
    """In the units of what is assumed; with the widths held it pulls the grip aside."""
    wider = 0.75, 1.2
    capture = relabelled(veiled(clean, 0.3, 0.2, wider=wider), grip="polymer")
    found = solved(capture, pose=False)
    monkeypatch.setattr(problem, "WIDTH", (0.0, 1e-6, *problem.WIDTH[2:]))
    held = solved(capture, pose=False)
    for number, view in enumerate(clean.views):
        shares = np.array(found.reaches_cm(number)) / reaches_of(view)
        assert shares[0] == pytest.approx(wider[0], rel=0.1)
    grip = [part.name for part in capture.parts].index("grip")
    off = [abs(each.density_g_cm3[grip] / 0.91 - 1) for each in (found, held)]
    assert off[0] < 0.01
    assert off[1] > 2 * off[0]


@pytest.mark.slow
def test_a_veil_moves_densities_only_if_it_is_not_modelled(clean):
    capture = relabelled(veiled(clean, 0.2, 0.2), grip="polymer")
    truth = 0.91
    off = {
        stray: abs(fitted(capture, pose=False, stray=stray)["grip"].density_g_cm3 / truth - 1)
        for stray in (True, False)
    }
    assert off[True] < 0.03
    assert off[False] > 2 * off[True]


@pytest.mark.parametrize(
    ("shape", "binning"), [((512, 512), 4), ((2048, 512), 4), ((100, 700), 1), ((255, 256), 1)]
)
def test_smooth_light_is_reckoned_on_about_128_pixels(shape, binning):
    assert coarse_binning(shape) == binning
