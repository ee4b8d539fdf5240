"""Tube spectra against SpekPy and published numbers; energy groups against 1 keV bins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from xden1k.errors import DataError
from xden1k.values.materials import load_materials
from xden_builder.physics.attenuation import mac_cm2_g
from xden_builder.physics.groups import energy_groups
from xden_builder.physics.source import Detector, Tube
from xden_builder.physics.spectrum import (
    Spectrum,
    absorbed_share,
    air_kerma_mgy,
    effective_energy_kev,
    effective_mac_cm2_g,
    half_value_layer_mm_al,
    tube_fluence,
    tube_spectrum,
)
from xden_builder.physics.spectrum.make_tables import made_fluence
from xden_builder.physics.spectrum.panels import taken_up
from xden_builder.physics.spectrum.tables import TABLE_KV, TABLE_SLOPES, bare_fluence

TUBE = Tube(kv=100.0, mas=126.0, filtration_cm={"Al": 0.25})
SPECTRUM = tube_spectrum(TUBE)
WATER, ALUMINIUM, IRON = ((("H2O", 1.0),), (("Al", 1.0),), (("Fe", 1.0),))


@pytest.mark.peer
@pytest.mark.parametrize(
    ("kv", "slope"), [(80.0, 0.0), (100.0, -0.18), (100.0, 0.0), (120.0, 0.09)]
)
def test_packaged_table_is_what_its_maker_makes(kv: float, slope: float) -> None:
    pytest.importorskip("spekpy", reason="SpekPy, which makes the table, is not installed")
    packaged = bare_fluence(kv, np.array([slope]))[0]
    np.testing.assert_allclose(packaged, made_fluence(kv, slope), rtol=1e-4)


@pytest.mark.peer
@pytest.mark.parametrize(("kv", "slope"), [(93.0, 0.0), (100.0, -0.165), (100.0, 0.105)])
def test_between_tabulated_values_the_spectrum_stays_close(kv: float, slope: float) -> None:
    pytest.importorskip("spekpy", reason="SpekPy, which makes the table, is not installed")
    made = made_fluence(kv, slope)
    mixed = bare_fluence(kv, np.array([slope]))[0][: len(made)]
    energies = np.arange(len(made)) + 10.5
    behind = np.exp(-mac_cm2_g(ALUMINIUM, energies) * 2.699 * 0.25)
    assert (mixed @ behind) == pytest.approx(made @ behind, rel=0.01)
    means = [np.average(energies, weights=fluence * behind) for fluence in (mixed, made)]
    assert means[0] == pytest.approx(means[1], abs=0.1)


@pytest.mark.parametrize(
    ("filtration", "mean_kev", "detected_kev", "hvl_mm"),
    [
        ({"Al": 0.25}, 49.1, 52.0, 3.46),
        ({"Al": 0.3}, 50.1, 52.7, 3.82),
        ({"Al": 0.25, "Cu": 0.01}, 54.4, 56.0, 5.46),
    ],
)
def test_hardness_behind_filters(
    filtration: dict[str, float], mean_kev: float, detected_kev: float, hvl_mm: float
) -> None:
    spectrum = tube_spectrum(replace(TUBE, filtration_cm=filtration))
    assert spectrum.mean_kev == pytest.approx(mean_kev, abs=0.15)
    assert spectrum.mean_detected_kev == pytest.approx(detected_kev, abs=0.15)
    assert half_value_layer_mm_al(spectrum) == pytest.approx(hvl_mm, rel=0.005)


def test_exposure_gives_the_quanta_and_kerma_of_a_radiograph() -> None:
    assert SPECTRUM.photons_per_cm2.sum() == pytest.approx(3.2e10, rel=0.02)
    assert air_kerma_mgy(SPECTRUM) == pytest.approx(15.0, rel=0.02)
    per_pixel = SPECTRUM.quanta_per_cm2.sum() / 1.2**2 * 0.015**2  # 0.15 mm at 120 cm
    assert per_pixel == pytest.approx(4.3e6, rel=0.02)


def test_heel_weakens_and_hardens_the_anode_side() -> None:
    offsets_cm = np.array([-21.0, -15, -10, -5, 0, 5, 10, 15, 21])
    energies, fluence = tube_fluence(TUBE, offsets_cm / 120)
    energy = fluence @ energies
    expected = [0.623, 0.840, 0.923, 0.971, 1, 1.015, 1.021, 1.018, 1.006]
    np.testing.assert_allclose(energy / energy[4], expected, atol=0.005)
    means = [53.9, 51.3, 50.3, 49.6, 49.1, 48.8, 48.6, 48.4, 48.2]
    np.testing.assert_allclose(energy / fluence.sum(axis=1), means, atol=0.15)


@pytest.mark.parametrize(
    ("composition", "areal_g_cm2", "expected_kev"),
    [
        (WATER, 0.1, 42.6),
        (WATER, 2.0, 44.1),
        (WATER, 10.0, 48.4),
        (ALUMINIUM, 0.27, 42.7),
        (ALUMINIUM, 2.7, 48.3),
        (IRON, 0.0787, 44.1),
        (IRON, 0.787, 52.5),
        (IRON, 3.935, 63.7),
    ],
)
def test_thicker_absorbers_have_a_higher_effective_energy(
    composition: tuple[tuple[str, float], ...], areal_g_cm2: float, expected_kev: float
) -> None:
    energy = effective_energy_kev(SPECTRUM, composition, areal_g_cm2)
    assert energy == pytest.approx(expected_kev, abs=0.15)


def test_water_weakens_the_beam_by_a_quarter_a_centimetre_not_by_a_sixth() -> None:
    assert effective_mac_cm2_g(SPECTRUM, WATER, 0.1) == pytest.approx(0.254, abs=0.001)
    assert effective_mac_cm2_g(SPECTRUM, WATER, 10.0) == pytest.approx(0.232, abs=0.001)


def test_24_groups_change_attenuation_by_two_thousandths_at_most() -> None:
    grouped, worst = SPECTRUM.grouped(24), {True: 0.0, False: 0.0}
    assert len(grouped.energies_kev) == 24
    for material in load_materials().values():
        mac = mac_cm2_g(material.composition, SPECTRUM.energies_kev)
        pooled = SPECTRUM.group_means(mac, 24)
        areal = np.geomspace(1e-5, 400.0, 200)[:, None]
        full, few = SPECTRUM.transmission(mac * areal), grouped.transmission(pooled * areal)
        seen = (full < 0.99) & (full > 1e-3)
        error = float(np.abs(np.log(few[seen]) / np.log(full[seen]) - 1).max())
        has_edge = bool((np.diff(mac) > 0).any())
        worst[has_edge] = max(worst[has_edge], error)
    assert worst[False] < 0.0021
    assert worst[True] < 0.04


@given(st.integers(1, 200))
def test_groups_keep_photons_quanta_and_signal(count: int) -> None:
    grouped = SPECTRUM.grouped(count)
    for name in ("photons_per_cm2", "quanta_per_cm2", "signal_kev_per_cm2"):
        assert getattr(grouped, name).sum() == pytest.approx(getattr(SPECTRUM, name).sum())
    assert (np.diff(grouped.energies_kev) > 0).all()
    lac = mac_cm2_g(WATER, SPECTRUM.energies_kev)
    pooled = SPECTRUM.group_means(lac, count)
    assert pooled @ grouped.weights == pytest.approx(lac @ SPECTRUM.weights)


@given(
    st.sampled_from(sorted(TABLE_KV)), st.floats(*TABLE_SLOPES[:: len(TABLE_SLOPES) - 1]), st.data()
)
def test_every_filter_hardens_and_weakens(kv: float, slope: float, data: st.DataObject) -> None:
    name, thickness_cm = data.draw(st.sampled_from([("Al", 0.5), ("Cu", 0.02), ("pmma", 5.0)]))
    bare = tube_spectrum(Tube(kv=kv), slope=slope)
    behind = tube_spectrum(Tube(kv=kv, filtration_cm={name: thickness_cm}), slope=slope)
    assert (behind.photons_per_cm2 < bare.photons_per_cm2).all()
    assert behind.mean_kev > bare.mean_kev
    assert behind.weights.sum() == pytest.approx(1.0)


def test_monochromatic_source_is_one_line() -> None:
    line = tube_spectrum(Tube(energy_kev=60.0))
    assert line.energies_kev.tolist() == [60.0]
    assert line.weights.tolist() == [1.0]
    assert line.grouped(24).energies_kev == pytest.approx([60.0])


@pytest.mark.parametrize("scintillator", ["CdTe-counting", "Si-counting"])
def test_a_counting_panel_weighs_photons_not_energies(scintillator: str) -> None:
    counted = tube_spectrum(TUBE, detector=Detector(scintillator))
    stopped = counted.photons_per_cm2 * absorbed_share(counted.energies_kev, scintillator)
    np.testing.assert_allclose(counted.weights, stopped / stopped.sum())
    energy = Spectrum(counted.energies_kev, counted.photons_per_cm2, counted.absorbed)
    assert counted.mean_detected_kev < energy.mean_detected_kev - 3.0
    grouped = counted.grouped(24)
    assert grouped.signal_per_cm2.sum() == pytest.approx(counted.signal_per_cm2.sum())
    assert grouped.mean_detected_kev == pytest.approx(counted.mean_detected_kev)


def test_groups_of_a_counting_panel_are_those_of_its_spectrum_along_every_ray() -> None:
    groups, slope = energy_groups(TUBE, Detector("CdTe-counting")), TABLE_SLOPES[2]
    leaning = tube_spectrum(TUBE, slope=slope, detector=Detector("CdTe-counting"))
    weights = groups.weights_at(np.array([slope]))[0]
    np.testing.assert_allclose(weights, leaning.grouped(24).weights, rtol=1e-9)


def test_scintillator_stops_more_above_its_edges() -> None:
    below, above = absorbed_share(np.array([33.0, 36.5]))
    assert above > below
    with pytest.raises(DataError, match="unknown scintillator 'NaI'; known are"):
        absorbed_share(np.array([50.0]), "NaI")


def test_fluorescence_that_escapes_is_lost_above_the_edge_alone() -> None:
    energies_kev = np.array([30.0, 49.0, 51.0, 80.0])
    kept, all_of = (
        taken_up(energies_kev, Detector("GOS", escape=escape)) for escape in (0.3, None)
    )
    assert kept[:2].tolist() == all_of[:2].tolist()
    # of 51 keV nearly all are stopped by the K shell of gadolinium, which sends on 43 keV of most
    assert kept[2] / all_of[2] == pytest.approx(1 - 0.3 * 0.67, abs=0.03)
    assert kept[2] / all_of[2] < kept[3] / all_of[3] < 1


def test_photons_below_the_threshold_hardly_count() -> None:
    energies_kev = np.array([20.0, 30.0, 40.0])
    counted = taken_up(energies_kev, Detector("CdTe-counting", threshold_kev=30.0))
    stopped = absorbed_share(energies_kev, "CdTe-counting")
    assert (counted / stopped) == pytest.approx([0.0, 0.5, 1.0], abs=1e-4)


def test_light_behind_steel_rises_evenly_with_the_voltage() -> None:
    steel = 7.87 * mac_cm2_g(IRON, SPECTRUM.energies_kev)
    kv = np.arange(95.0, 100.01, 0.1)
    through = np.log(
        [
            (spectrum := tube_spectrum(replace(TUBE, kv=float(each)))).transmission(
                steel[: len(spectrum.energies_kev)]
            )
            for each in kv.round(1)
        ]
    )
    steps = np.diff(through)
    assert steps.min() > 0
    assert steps.max() < 1.3 * steps.min()


@pytest.mark.parametrize(
    ("tube", "slope", "message"),
    [
        (Tube(kv=140.0), 0.0, "tube.kv: tube spectra are tabulated from 80 to 120 kV, got 140"),
        (Tube(kv=100.0), -0.2, "may lean by 0.18 at most towards anode or cathode, got 0.2"),
        (Tube(), 0.0, "needs its kv"),
        (Tube(kv=100.0, filtration_cm={"unobtainium": 1.0}), 0.0, "unobtainium"),
    ],
)
def test_spectra_outside_the_table_are_refused(tube: Tube, slope: float, message: str) -> None:
    with pytest.raises((DataError, LookupError), match=message):
        tube_spectrum(tube, slope=slope)


def test_spectrum_without_signal_is_refused() -> None:
    with pytest.raises(DataError, match=r"no signal in the detector at 50 keV: too much tube\.f"):
        Spectrum(np.array([50.0]), np.zeros(1), np.ones(1))
