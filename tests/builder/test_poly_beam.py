"""The beam of each pixel: groups of energy, a heel told from a flat, a harder anode side."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.builder.fit_scenes import FLAT, cone
from tests.builder.poly_scenes import TUBE, composition
from xden1k.values.materials import load_materials
from xden_builder.phantoms import Scanner
from xden_builder.physics.attenuation import mac_cm2_g
from xden_builder.physics.groups import GROUPS, EnergyGroups, energy_groups
from xden_builder.physics.source import Detector, Tube
from xden_builder.physics.spectrum import tube_spectrum
from xden_builder.poly.model.beam import Heel, ViewBeam, find_heel

ONE_LINE = Tube(energy_kev=60.0)
SCANNER = Scanner.realistic(64)
GEOMETRY = SCANNER.geometry("pa")


def mean_kev(groups: EnergyGroups, weights: np.ndarray) -> np.ndarray:
    return weights @ groups.spectrum.grouped(groups.count).energies_kev


def flat() -> np.ndarray:
    """A flat of the simulated scanner less its dark; its anode lies above the panel."""
    panel = SCANNER.calibration(3, "pa")
    assert panel is not None
    return np.asarray(panel.flat.astype(np.float32) - panel.dark, dtype=np.float32)


@settings(deadline=None)
@given(
    st.lists(st.floats(-0.3, 0.3), min_size=1, max_size=5),
    st.sampled_from([TUBE, Tube(kv=85.0), ONE_LINE]),
    st.sampled_from(["CsI", "GOS", ""]),
)
def test_shares_of_the_groups_add_up_to_one_wherever_a_ray_goes(slopes, tube, scintillator):
    weights = energy_groups(tube, Detector(scintillator)).weights_at(np.array(slopes))
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    assert (weights >= 0).all()


def test_one_photon_energy_is_one_group_with_the_tables_coefficient():
    groups = energy_groups(ONE_LINE, Detector("CsI"))
    assert groups.weights.tolist() == [[1.0]]
    for name in ("water", "steel"):
        expected = float(mac_cm2_g(composition(name), 60.0))
        assert groups.mac_cm2_g(composition(name)) == pytest.approx([expected])


@pytest.mark.parametrize("name", ["pp", "water", "aluminium", "steel"])
def test_groups_weaken_the_beam_as_the_whole_spectrum_does(name):
    groups, spectrum = energy_groups(TUBE, Detector("CsI")), tube_spectrum(TUBE)
    assert len(groups.weights_at(np.zeros(1))[0]) == GROUPS
    mac = mac_cm2_g(composition(name), spectrum.energies_kev)
    areal = np.geomspace(0.01, 3.0, 12) / (mac @ spectrum.weights)
    full = spectrum.transmission(np.outer(areal, mac))
    pooled = groups.mac_cm2_g(composition(name))
    few = np.exp(-np.outer(areal, pooled)) @ groups.weights_at(np.zeros(1))[0]
    np.testing.assert_allclose(np.log(few), np.log(full), rtol=0.0025)


def test_scattering_is_a_part_of_attenuation_and_most_of_it_in_light_matter():
    groups = energy_groups(Tube(energy_kev=100.0), Detector("CsI"))
    for material in load_materials().values():
        total = groups.mac_cm2_g(material.composition)
        turned = groups.scattering_cm2_g(material.composition)
        assert ((turned > 0) & (turned < total)).all()
    water = composition("water")
    assert groups.scattering_cm2_g(water) == pytest.approx(0.98 * groups.mac_cm2_g(water), rel=0.01)


@pytest.mark.parametrize(
    ("quarter_turns", "heel"),
    [(0, Heel(1, 0)), (1, Heel(0, 1)), (2, Heel(-1, 0)), (3, Heel(0, -1))],
    ids=["row", "column", "-row", "-column"],
)
def test_cathode_is_found_on_whichever_side_it_is(quarter_turns, heel):
    turned = np.ascontiguousarray(np.rot90(flat(), quarter_turns))
    assert find_heel(turned, GEOMETRY, TUBE, Detector("CsI")) == heel


def test_cathode_is_found_although_some_pixels_are_dead():
    dead = flat()
    dead[::7, ::5] = 0.0
    dead[3, 3] = np.nan
    assert find_heel(dead, GEOMETRY, TUBE, Detector("CsI")) == find_heel(
        flat(), GEOMETRY, TUBE, Detector("CsI")
    )


def test_no_heel_is_told_where_the_open_field_shows_none():
    rng = np.random.default_rng(0)
    even = np.full(GEOMETRY.shape, 5e4, dtype=np.float32)
    noisy = rng.poisson(even).astype(np.float32)
    rows, columns = np.indices(GEOMETRY.shape) - 31.5
    square_cm = (43 / 64) ** 2 * (rows**2 + columns**2)
    distant = (even / (1 + square_cm / 120**2)).astype(np.float32)  # by the inverse square alone
    for field in (even, noisy, distant, None):
        assert find_heel(field, GEOMETRY, TUBE, Detector("CsI")) == Heel()


def test_no_heel_is_sought_without_a_tube_or_a_focal_spot():
    assert find_heel(flat(), GEOMETRY, ONE_LINE, Detector("CsI")) == Heel()
    image = np.ascontiguousarray(flat()[:24, :24])
    assert find_heel(image, FLAT, TUBE, Detector("CsI")) == Heel()
    assert (Heel(1, 0).slopes(FLAT, np.arange(3.0), np.arange(3.0)) == 0).all()


def test_slopes_grow_towards_the_cathode_from_the_foot_of_the_perpendicular():
    geometry = cone(0.0, 41, 41.0)
    rows = np.array([0.0, 20.0, 40.0])
    found = Heel(1, 0).slopes(geometry, rows, np.full(3, 20.0))
    np.testing.assert_allclose(found, np.array([-20.0, 0.0, 20.0]) / 130.0, atol=1e-12)
    np.testing.assert_allclose(Heel(-1, 0).slopes(geometry, rows, rows), -found, atol=1e-12)
    assert np.abs(Heel(0, 1).slopes(geometry, rows, np.full(3, 20.0))).max() < 1e-12


def test_beam_is_harder_on_the_anodes_side_and_one_beam_without_a_heel():
    groups = energy_groups(TUBE, Detector("CsI"))
    beam = ViewBeam(groups, GEOMETRY, Heel(-1, 0))  # cathode above
    top, middle, bottom = mean_kev(groups, beam.weights(np.array([32, 32 * 64 + 32, 63 * 64 + 32])))
    assert top + 0.3 < middle < bottom - 1.0
    even = replace(beam, heel=Heel()).weights(np.array([0, 64 * 64 - 1]))
    np.testing.assert_array_equal(even[0], even[1])
    assert mean_kev(groups, even)[0] == pytest.approx(groups.spectrum.mean_detected_kev, abs=0.05)


def test_a_bin_has_the_mean_hardness_of_its_pixels():
    groups = energy_groups(TUBE, Detector("CsI"))
    beam = ViewBeam(groups, GEOMETRY, Heel(0, 1))
    rows, columns = np.indices((4, 4))
    pixels = ((8 + rows) * 64 + 12 + columns).ravel()
    (binned,) = beam.weights(np.array([2 * 16 + 3]), binning=4)
    np.testing.assert_allclose(binned, beam.weights(pixels).mean(axis=0), rtol=1e-4)
