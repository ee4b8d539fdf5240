"""Each effect of the realistic scanner by itself: what it conserves and what it may not do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.builder.scanner_scenes import BARE, TUBE, WATER, block, middle
from xden1k.errors import DataError
from xden1k.values.materials import load_materials
from xden_builder.phantoms import (
    Phantom,
    Plan,
    Scanner,
    make_phantom,
)
from xden_builder.phantoms.scanner.beam import make_beam
from xden_builder.phantoms.scanner.primary import Absorber, pixel_kernel, render
from xden_builder.phantoms.scanner.scatter import MOST_REACHING, ScatterDraw, scatter_image
from xden_builder.phantoms.scanner.spread import gaussian_spread
from xden_builder.physics.attenuation import mac_cm2_g
from xden_builder.physics.spectrum import absorbed_share, tube_fluence, tube_spectrum

# the direct beam


def test_one_energy_gives_the_same_image_on_both_ways() -> None:
    scanner = Scanner(size_px=64)
    phantom = make_phantom(Plan.of(0, "screwdriver-0000"))
    lacs = scanner.lac_per_cm(phantom).astype(np.float32)
    absorber = Absorber([part.mesh for part in phantom.parts], lacs[:, None], lacs[:, None])
    kernel = pixel_kernel(6, scanner.pixel_cm, 0.0, 0.0)
    made = render(absorber, scanner.beam, scanner.geometry("pa"), 6, kernel).transmission
    np.testing.assert_allclose(made, scanner.transmission(phantom, "pa"), atol=2e-6)


@pytest.mark.parametrize(
    ("material", "density", "depth_cm"), [("water", 1.0, 6.0), ("steel", 7.85, 0.2)]
)
def test_slab_weakens_the_beam_as_its_spectrum_says(
    material: str, density: float, depth_cm: float
) -> None:
    scanner = replace(BARE, size_px=129, subrays=1)
    composition = load_materials()[material].composition
    image = scanner.transmission(
        block(12.0, depth_cm, 12.0, material=material, density=density), "pa"
    )
    spectrum = tube_spectrum(TUBE)
    path = mac_cm2_g(composition, spectrum.energies_kev) * density * depth_cm
    expected = float(spectrum.transmission(path))
    assert -np.log(image[64, 64]) == pytest.approx(-np.log(expected), rel=0.003)


@pytest.mark.parametrize("material", ["pp", "water", "aluminium", "steel"])
def test_compositions_err_from_object_to_object_by_as_much_as_is_asked(material: str) -> None:
    scanner = replace(BARE, composition_sd=0.02)
    phantom = block(1.0, 1.0, 1.0, material=material)
    others = [replace(phantom, plan=Plan(seed, 0, 0)) for seed in range(400)]
    ratio = np.array([scanner.lac_per_cm(each)[0] for each in others]) / BARE.lac_per_cm(phantom)
    assert ratio.std() == pytest.approx(0.02, rel=0.15)
    assert ratio.mean() == pytest.approx(1, abs=0.003)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"composition_sd": 0.02, "energy_kev": 100.0}, "need a tube"),
        ({"composition_sd": 0.06}, "expected 0.05 at most, got 0.06"),
    ],
)
def test_compositions_that_would_hardly_absorb_are_refused(settings, words) -> None:
    with pytest.raises(DataError, match=words):
        replace(BARE, **settings)


def test_a_composition_changes_what_is_absorbed_and_not_what_is_scattered() -> None:
    scanner = replace(BARE, composition_sd=0.05)
    phantom = block(1.0, 1.0, 1.0, material="aluminium")
    absorbers = scanner._absorber(phantom), BARE._absorber(phantom)
    other, usual = (each.lac_per_cm - each.scattering_per_cm for each in absorbers)
    np.testing.assert_array_equal(*(each.scattering_per_cm for each in absorbers))
    ratio = other / usual
    np.testing.assert_allclose(ratio, ratio[0, 0], rtol=1e-3)
    assert abs(ratio[0, 0] - 1) > 0.01


def test_all_parts_of_one_material_in_an_object_are_of_one_composition() -> None:
    phantom = make_phantom(Plan.of(0, "side_table-0000"))
    off = replace(BARE, composition_sd=0.05).lac_per_cm(phantom) / BARE.lac_per_cm(phantom)
    by_material: dict[str, set[float]] = {}
    for part, each in zip(phantom.parts, off.round(9).tolist(), strict=True):
        by_material.setdefault(part.material, set()).add(each)
    assert max(map(len, by_material.values())) == 1 < len(set().union(*by_material.values()))


def test_image_does_not_depend_on_how_many_rows_are_made_at_a_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scanner = replace(Scanner.realistic(48), bits=None)
    phantom = make_phantom(Plan.of(0, "hammer-0000"))
    whole = scanner.signal(phantom, "lat").values
    monkeypatch.setattr("xden_builder.phantoms.scanner.primary.LENGTHS_AT_ONCE", 1)
    np.testing.assert_allclose(scanner.signal(phantom, "lat").values, whole, atol=1e-6)


def test_heel_weakens_and_hardens_the_upper_rows() -> None:
    beam = make_beam(
        TUBE,
        groups=24,
        scintillator_g_cm2=0.22,
        heel=True,
        size_px=129,
        panel_cm=43.0,
        distance_cm=120.0,
    )
    hardness = beam.row_weights @ beam.energies_kev
    assert (np.diff(hardness) < 0).all()
    assert hardness[0] - hardness[-1] > 4.0
    assert beam.open_field[64, 64] == pytest.approx(1.0)
    assert beam.open_field[0, 64] == pytest.approx(0.58, abs=0.03)
    np.testing.assert_allclose(beam.open_field, beam.open_field[:, ::-1])
    np.testing.assert_allclose(beam.open_field[64, 0], (1 + (21.33 / 120) ** 2) ** -1.5, rtol=1e-3)
    np.testing.assert_allclose(beam.row_weights.sum(axis=1), 1.0)


def test_without_heel_rows_are_alike() -> None:
    assert (BARE.beam.open_field == 1.0).all()
    assert (BARE.beam.row_weights == BARE.beam.row_weights[0]).all()


# the size of heel and hardening, as tables of the spectrum have them


@pytest.mark.parametrize(
    ("material", "density", "thin_cm", "thick_cm", "thin_kev", "thick_kev"),
    [
        ("water", 1.0, 0.1, 10.0, 42.6, 48.4),
        ("aluminium", 2.7, 0.1, 1.0, 42.7, 48.3),
        ("iron", 7.874, 0.01, 0.5, 44.1, 63.7),
    ],
)
def test_thick_slab_looks_thinner_by_as_much_as_its_beam_is_harder(
    material: str,
    density: float,
    thin_cm: float,
    thick_cm: float,
    thin_kev: float,
    thick_kev: float,
) -> None:
    scanner = replace(BARE, size_px=129, subrays=1)
    depths = [
        -np.log(float(scanner.transmission(slab, "pa")[64, 64])) / cm
        for cm in (thin_cm, thick_cm)
        for slab in [block(12.0, cm, 12.0, material=material, density=density)]
    ]
    thin, thick = (
        float(mac_cm2_g(load_materials()[material].composition, kev))
        for kev in (thin_kev, thick_kev)
    )
    assert depths[1] / depths[0] == pytest.approx(thick / thin, abs=0.005)


def test_open_field_falls_as_heel_slant_and_scintillator_say() -> None:
    beam, scanner = Scanner.realistic(513).beam, Scanner.realistic(513)
    offsets_cm = np.array([-21.0, -15.0, -10.0, -5.0, 0.0, 5.0, 10.0, 15.0, 21.0])
    rows = (256 + offsets_cm / scanner.pixel_cm).round().astype(int)
    fluence = np.array([0.623, 0.840, 0.923, 0.971, 1.0, 1.015, 1.021, 1.018, 1.006])
    slant = 1 / np.sqrt(1 + (offsets_cm / 120) ** 2)
    energies_kev, photons = tube_fluence(TUBE, offsets_cm / 120)
    energy = photons * energies_kev
    # of a harder beam the scintillator takes up less: 3 % at the anode's end
    absorbed = (energy * absorbed_share(energies_kev)).sum(axis=1) / energy.sum(axis=1)
    expected = fluence * slant * absorbed / absorbed[4]
    np.testing.assert_allclose(beam.open_field[rows, 256], expected, atol=0.006)
    hardness_kev = (beam.row_weights @ beam.energies_kev)[rows[[0, 4, 8]]]
    np.testing.assert_allclose(hardness_kev, [55.7, 52.0, 51.4], atol=0.1)


# blur and glare


@given(
    subrays=st.integers(1, 8),
    box=st.floats(0.0, 3.0),
    gauss=st.floats(0.0, 2.0),
)
def test_blur_moves_light_and_loses_none(subrays: int, box: float, gauss: float) -> None:
    kernel = pixel_kernel(subrays, 1.0, box, gauss)
    assert (kernel >= 0).all()
    np.testing.assert_allclose(kernel.sum(axis=0), 1 / subrays)
    np.testing.assert_allclose(kernel, kernel[::-1, ::-1], atol=1e-12)


def test_blur_has_the_width_asked_for() -> None:
    kernel, subrays = pixel_kernel(24, 1.0, 1.5, 0.7), 24
    at = (np.arange(kernel.size) + 0.5) / subrays - 0.5 - len(kernel) // 2
    assert at @ kernel.ravel() == pytest.approx(0.0, abs=1e-9)
    assert at**2 @ kernel.ravel() == pytest.approx(1 / 12 + 1.5**2 / 12 + 0.7**2, rel=0.005)


@pytest.mark.parametrize("fault", [{"focal_spot_cm": 2.0}, {"detector_blur_cm": 0.3}])
def test_blurred_object_takes_as_much_light(fault: dict[str, float]) -> None:
    phantom = block(5.0, 5.0, 5.0)
    sharp, soft = (
        scanner.signal(phantom, "pa").values.astype(np.float64)
        for scanner in (BARE, replace(BARE, **fault))
    )
    assert (1 - soft).sum() == pytest.approx((1 - sharp).sum(), rel=1e-5)
    assert np.abs(soft - sharp).max() > 0.05
    assert middle(soft) == pytest.approx(middle(sharp), rel=1e-5)


@given(st.integers(0, 39), st.integers(0, 39), st.floats(0.3, 4.0))
def test_spread_keeps_what_stays_on_the_panel(row: int, column: int, sd_px: float) -> None:
    image = np.zeros((40, 40), dtype=np.float32)
    image[row, column] = 3.0
    spread = gaussian_spread(image, sd_px)
    assert (spread >= 0).all()
    assert spread.sum() <= 3.0 + 1e-5
    if min(row, column, 39 - row, 39 - column) > 5 * sd_px:
        assert spread.sum() == pytest.approx(3.0, rel=1e-5)


def test_glare_brightens_the_dark_and_keeps_the_sum() -> None:
    phantom = block(4.0, 12.0, 4.0, material="steel", density=7.85)
    dark = BARE.signal(phantom, "pa").values.astype(np.float64)
    lit = replace(BARE, glare_share=0.04).signal(phantom, "pa").values.astype(np.float64)
    assert middle(dark) < 1e-6
    assert 1e-4 < middle(lit) < 0.04
    inner = slice(20, -20)
    open_field = BARE._open_signal().astype(np.float64)
    glared = replace(BARE, glare_share=0.04)._open_signal().astype(np.float64)
    assert (glared - lit).sum() == pytest.approx((open_field - dark).sum(), rel=1e-4)
    np.testing.assert_allclose(glared[inner, inner], 1.0, atol=1e-5)


# scatter


def test_scatter_never_darkens_and_reaches_its_level() -> None:
    scanner = replace(BARE, scatter_level=0.02)
    phantom = block(14.0, 10.0, 14.0)
    clear, veiled = (each.signal(phantom, "pa").values for each in (BARE, scanner))
    veil = veiled.astype(np.float64) - clear
    assert veil.min() > -1e-6
    shadow = clear < 0.999
    level = scanner.scatter(phantom.plan).level
    assert 0.01 <= level <= 0.03
    assert veil[shadow].mean() == pytest.approx(level, rel=0.02)
    assert veil.max() < 3 * level
    share = scanner.signal(phantom, "pa").scatter_share
    assert share == pytest.approx(veil[shadow].sum() / veiled[shadow].sum(), rel=0.02)


@pytest.mark.parametrize("name", ["screwdriver-0000", "water_bottle-0000", "padlock-0000"])
def test_no_more_is_scattered_than_was_lost(name: str) -> None:
    scanner, phantom = replace(BARE, scatter_level=0.5), make_phantom(Plan.of(2, name))
    kernel = pixel_kernel(scanner.subrays, scanner.pixel_cm, 0.0, 0.0)
    absorber = scanner._absorber(phantom)
    made = render(absorber, scanner.beam, scanner.geometry("pa"), scanner.subrays, kernel)
    lost = (1.0 - made.transmission).astype(np.float64)
    assert made.scattered.sum(dtype=np.float64) < lost.sum()
    veil = scanner.signal(phantom, "pa").values - made.transmission
    assert veil.sum(dtype=np.float64) <= MOST_REACHING * lost.sum()


def test_metal_scatters_less_than_plastic_of_the_same_shadow() -> None:
    water, steel = block(8.0, 6.0, 8.0), block(8.0, 0.11, 8.0, material="steel", density=7.85)
    kernel = pixel_kernel(1, BARE.pixel_cm, 0.0, 0.0)
    made = [
        render(BARE._absorber(each), BARE.beam, BARE.geometry("pa"), 1, kernel)
        for each in (water, steel)
    ]
    depths = [-np.log(middle(each.transmission)) for each in made]
    assert depths[0] == pytest.approx(depths[1], rel=0.1)
    assert middle(made[1].scattered) < 0.3 * middle(made[0].scattered)


def test_scatter_of_a_block_of_water_is_a_few_percent_and_less_than_its_level() -> None:
    scanner, shadows = replace(BARE, scatter_level=0.05), []
    for number in range(3):
        phantom = Phantom(Plan(0, 0, number), block(8.0, 6.0, 8.0).parts)
        clear, veiled = (each.signal(phantom, "pa").values for each in (BARE, scanner))
        shadows.append(float((veiled - clear)[clear < 0.999].mean()))
        assert shadows[-1] < scanner.scatter(phantom.plan).level
    np.testing.assert_allclose([min(shadows), max(shadows)], [0.018, 0.037], atol=0.001)


def test_scatter_of_nothing_is_nothing() -> None:
    draw = ScatterDraw(level=0.05, near_cm=2.0, far_cm=6.0, near_share=0.5, reaching=0.3)
    assert (scatter_image(np.zeros((8, 8), dtype=np.float32), draw, 0.5) == 0).all()


def test_scatter_varies_from_object_to_object() -> None:
    draws = [Scanner.realistic().scatter(Plan(0, 0, number)) for number in range(200)]
    levels = np.array([draw.level for draw in draws])
    assert levels.min() >= 0.025
    assert levels.max() <= 0.075
    assert levels.mean() == pytest.approx(0.05, abs=0.003)
    assert max(draw.reaching for draw in draws) <= MOST_REACHING


# noise and panel


def test_noise_is_that_of_quanta_which_leave_their_energy() -> None:
    scanner = replace(Scanner.realistic(400), mas=0.002, readout_sd_counts=0.0, heel=False)
    scanner = replace(scanner, scatter_level=0.0, glare_share=0.0, dead_share=0.0)
    spectrum = scanner.beam.spectrum.grouped(24)
    pixel_cm2 = (scanner.pixel_cm * 100 / 120) ** 2
    mac = scanner.beam.spectrum.group_means(
        mac_cm2_g(WATER, scanner.beam.spectrum.energies_kev), 24
    )
    for depth_cm in (0.0, 8.0):
        behind = np.exp(-mac * depth_cm)
        quanta = spectrum.quanta_per_cm2 * pixel_cm2 * behind
        signal, second = quanta @ spectrum.energies_kev, quanta @ spectrum.energies_kev**2
        per_kev = scanner.open_counts / (spectrum.signal_kev_per_cm2.sum() * pixel_cm2)
        share = np.full((400, 400), signal * per_kev / scanner.open_counts)
        mean_kev = np.full((400, 400), second / signal, dtype=np.float32)
        panel = scanner._panel(0, "pa", 16)
        raw = panel.read(share, mean_kev, 1, np.random.default_rng(1)).astype(np.float64)
        rng = np.random.default_rng(2)  # quantum by quantum, in each group
        drawn = rng.poisson(quanta, (40_000, 24)) @ spectrum.energies_kev * per_kev
        assert raw.mean() - 100 == pytest.approx(drawn.mean(), rel=0.002)
        assert raw.var() == pytest.approx(drawn.var() + 1 / 12, rel=0.03)


def test_mean_energy_behind_an_object_is_that_of_its_hardened_beam() -> None:
    phantom = block(12.0, 8.0, 12.0)
    signal = replace(BARE, detector_blur_cm=1e-4).signal(phantom, "pa")
    spectrum = BARE.beam.spectrum
    behind = spectrum.weights * np.exp(-8.0 * mac_cm2_g(WATER, spectrum.energies_kev))
    hardened = spectrum.energies_kev @ behind / behind.sum()
    assert middle(signal.mean_kev) == pytest.approx(hardened, rel=0.003)
    assert signal.mean_kev[0, 0] == pytest.approx(spectrum.mean_detected_kev, rel=1e-3)


def test_dead_pixels_are_dead_in_every_image_and_not_valid() -> None:
    scanner = replace(Scanner.realistic(128), dead_share=0.01)
    dead = scanner._panel(0, "pa", 16).dead
    assert 100 < dead.sum() < 230
    first, second = (scanner.corrected(block(*size), "pa") for size in ((3, 3, 3), (9, 2, 2)))
    np.testing.assert_array_equal(first.valid, ~dead)
    np.testing.assert_array_equal(second.valid, ~dead)
    assert (scanner._panel(1, "pa", 16).dead != dead).any()


def test_dead_lines_are_whole_rows_and_columns_and_leave_other_pixels_as_they_are() -> None:
    plain = replace(Scanner.realistic(64), dead_share=0.0, quantum_noise=False)
    plain = replace(plain, readout_sd_counts=0.0)
    scanner = replace(plain, dead_lines=2)
    view, before = (each.corrected(block(3, 3, 3), "pa") for each in (scanner, plain))
    rows, columns = (~view.valid.any(axis=axis) for axis in (1, 0))
    assert (rows.sum(), columns.sum()) == (2, 2)
    np.testing.assert_array_equal(~view.valid, rows[:, None] | columns)
    np.testing.assert_array_equal(view.transmission[view.valid], before.transmission[view.valid])


def test_settings_that_came_later_go_without_saying_where_they_are_as_before() -> None:
    later = {"exposure_ratio", "one_tube", "dead_lines", "mesh_warp_cm", "composition_sd"}
    usual = Scanner.realistic()
    assert not later & usual.settings().keys()
    assert "warp_cm" not in usual.mesh_error(Plan(0, 0, 0)).as_dict()
    other = replace(
        usual,
        exposure_ratio=1.1,
        one_tube=True,
        dead_lines=1,
        mesh_warp_cm=0.01,
        composition_sd=0.02,
    )
    assert later < other.settings().keys()
    assert other.mesh_error(Plan(0, 0, 0)).as_dict()["warp_cm"] == 0.01
    assert other.mesh_error(Plan(0, 0, 0)).scale == usual.mesh_error(Plan(0, 0, 0)).scale


def test_more_dead_lines_than_a_panel_has_are_refused() -> None:
    with pytest.raises(DataError, match="65 dead lines of 64"):
        Scanner(size_px=64, dead_lines=65)


def test_flat_shows_the_heel_and_correction_removes_it() -> None:
    scanner, phantom = Scanner.realistic(96), block(6.0, 1.0, 6.0)
    panel = scanner.calibration(0, "pa")
    assert panel is not None
    assert panel.flat[5].mean() < 0.75 * panel.flat[48].mean()
    view = scanner.corrected(phantom, "pa")
    gain = scanner.exposure(phantom.plan, "pa")
    air = np.zeros_like(view.valid)
    air[2:15] = air[-15:-2] = True
    # scatter of so small an object is what remains
    np.testing.assert_allclose(view.transmission[air & view.valid] / gain, 1.0, atol=0.012)
