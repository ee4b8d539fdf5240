"""The compiled forward model against plain loops, the search over materials against slabs."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.builder.poly_scenes import TUBE
from xden1k.values.materials import load_materials
from xden_builder.fit.huber import HUBER
from xden_builder.physics.groups import energy_groups
from xden_builder.physics.source import Detector
from xden_builder.poly.model import kernels

LIBRARY = load_materials()
GROUPS = energy_groups(TUBE, Detector("CsI"))
OPEN = GROUPS.weights_at(np.zeros(1))[0]
ALL_MAC = np.stack([GROUPS.mac_cm2_g(each.composition) for each in LIBRARY.values()])
seeds = st.integers(0, 2**32 - 1)


def scene(rng, parts=3, rays=4, groups=5):
    """Random path lengths, some of which miss a part, with shares of groups that add up to one."""
    shape = (7, rays, parts)
    lengths = (rng.uniform(0, 2, shape) * (rng.uniform(size=shape) < 0.6)).astype(np.float32)
    weights = rng.uniform(size=(7, groups))
    return (
        lengths,
        rng.integers(1, rays + 1, 7),
        rng.uniform(0.1, 3.0, (parts, groups)),
        rng.uniform(0.1, 2.0, parts),
        weights / weights.sum(axis=1, keepdims=True),
    )


def predicted(lengths, rays, mac, density, weights):
    transmission, slopes = np.empty(len(lengths)), np.empty((len(lengths), len(density)))
    kernels.predict(lengths, rays, mac, density, weights, transmission, slopes)
    return transmission, slopes


@settings(max_examples=25, deadline=None)
@given(seeds)
def test_a_pixel_is_the_mean_over_its_rays_of_the_sum_over_energies(seed):
    lengths, rays, mac, density, weights = scene(np.random.default_rng(seed))
    expected = [
        np.mean([weights[p] @ np.exp(-(lengths[p, s] * density) @ mac) for s in range(rays[p])])
        for p in range(len(lengths))
    ]
    found, _ = predicted(lengths, rays, mac, density, weights)
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    bare = np.empty(len(lengths))
    kernels.predict(lengths, rays, mac, density, weights, bare, np.empty((0, len(density))))
    np.testing.assert_array_equal(bare, found)


def test_light_behind_any_depth_is_e_to_minus_that_depth():
    depths = np.geomspace(1e-6, 1e4, 5001, dtype=np.float32)
    one = np.ones((len(depths), 1))
    lengths, rays = depths[:, None, None], np.ones(len(depths), np.int64)
    found, _ = predicted(lengths, rays, np.ones((1, 1)), np.ones(1), one)
    expected = np.exp(-depths.astype(np.float64))
    np.testing.assert_allclose(found, expected, rtol=5e-16, atol=1e-300)


def test_the_search_sees_e_to_minus_any_depth_to_single_precision():
    """Of a known density before a black panel the cost is half the square of what is seen."""
    depths, rays = np.geomspace(1e-6, 1e4, 5001, dtype=np.float32), np.array([67])
    one, known, found = np.ones(1), np.ones((5001, 4)), np.empty((5001, 3))
    kernels.scan(
        np.ones((1, 67), np.float32),
        np.ones(67, np.float32),
        rays,
        np.zeros(1),
        rays,
        np.zeros(1),
        np.zeros(1, bool),
        one,
        one,
        HUBER,
        depths[:, None].astype(np.float64),
        known,
        found,
    )
    expected = np.exp(-depths.astype(np.float64))
    np.testing.assert_allclose(np.sqrt(2 * found[:, 1]), expected, rtol=1.2e-7, atol=5e-18)


@settings(max_examples=25, deadline=None)
@given(seeds)
def test_slopes_are_the_derivatives_by_the_densities(seed):
    lengths, rays, mac, density, weights = scene(np.random.default_rng(seed))
    _, slopes = predicted(lengths, rays, mac, density, weights)
    step = 1e-5
    for part, axis in enumerate(np.eye(len(density)) * step):
        ahead, behind = (
            predicted(lengths, rays, mac, density + way * axis, weights)[0] for way in (1, -1)
        )
        np.testing.assert_allclose(slopes[:, part], (ahead - behind) / (2 * step), atol=1e-8)


@settings(max_examples=25, deadline=None)
@given(seeds)
def test_scatter_starts_where_the_beam_is_both_bright_and_turned(seed):
    rng = np.random.default_rng(seed)
    lengths, _, mac, density, weights = scene(rng)
    scattering = mac * rng.uniform(0.1, 0.9, mac.shape)
    found = np.empty(len(lengths))
    kernels.scattered(lengths, mac, scattering, density, weights, found)
    expected = []
    for p in range(len(lengths)):
        areal = lengths[p] * density
        expected.append(np.mean((np.exp(-areal @ mac) * (areal @ scattering)) @ weights[p]))
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@settings(max_examples=20, deadline=None)
@given(seed=seeds)
def test_the_best_density_balances_what_every_ray_tells_and_the_prior(seed):
    rng = np.random.default_rng(seed)
    counts = rng.integers(1, 5, 12)
    rays, mac = int(counts.sum()), rng.uniform(0.1, 0.5, 6)
    others = rng.uniform(0.02, 0.3, (6, rays)).astype(np.float32)
    ways = rng.uniform(0.5, 3.0, rays).astype(np.float32)
    ways[rng.random(rays) < 0.3] = 0.0
    starts = np.append(0, np.cumsum(counts)[:-1])

    def cost(density):
        seen = (others * np.exp(-density * np.outer(mac, ways))).sum(axis=0)
        off = (np.add.reduceat(seen, starts) / counts - measured) / 0.01
        return 0.5 * ((density - 1.0) / 0.4) ** 2 + 0.5 * (off**2).sum()

    behind = (others * np.exp(-1.2 * np.outer(mac, ways))).sum(axis=0)
    measured = np.add.reduceat(behind, starts) / counts + rng.normal(0, 0.001, 12)
    found, priors = np.empty((1, 3)), np.array([[1.0, 0.4, 0.1, 5.0]])
    below, inverse_sd = np.zeros(12, dtype=bool), np.full(12, 100.0)
    meets = ways > 0
    kernels.scan(
        np.ascontiguousarray(others[:, meets]),
        ways[meets],
        np.cumsum(np.add.reduceat(meets.astype(int), starts)),
        np.add.reduceat(np.where(meets, 0.0, others.sum(axis=0, dtype=float)), starts),
        counts,
        measured,
        below,
        inverse_sd,
        np.ones(12),
        HUBER,
        mac[None],
        priors,
        found,
    )
    density, least, _ = found[0]
    assert least == pytest.approx(cost(density), rel=1e-5)  # signals to 1e-7, deviations 0.01
    assert cost(density) <= min(cost(density * factor) for factor in (0.999, 1.001))


def slab(mac, density, transmissions=(0.9, 0.6, 0.3, 0.1)):
    """Thicknesses with about these transmissions at one energy, and the transmissions."""
    ways = -np.log(transmissions) / (density * (mac @ OPEN))
    return ways, np.exp(-np.outer(ways * density, mac)) @ OPEN


def scanned(ways, measured, macs, priors, *, rays=1, sd=0.003, at_least=False, share=1.0):
    """Densities, costs and curvatures of candidates."""
    others, found = np.repeat(OPEN[:, None], len(ways), axis=1), np.empty((len(macs), 3))
    ends = np.arange(rays, len(ways) + 1, rays)
    inverse_sd = np.full(len(measured), 1 / sd)
    below, shares = np.full(len(measured), at_least), np.full(len(measured), share)
    kernels.scan(
        others.astype(np.float32),
        ways.astype(np.float32),
        ends,
        np.zeros(len(ends)),
        np.full(len(ends), rays),
        measured,
        below,
        inverse_sd,
        shares,
        HUBER,
        macs,
        priors,
        found,
    )
    return found.T


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.slow] * (place % 8 > 0))
        for place, name in enumerate(sorted(LIBRARY))
    ],
)
def test_search_finds_the_density_of_a_slab_and_nothing_unlike_explains_it_better(name):
    material, index = LIBRARY[name], list(LIBRARY).index(name)
    truth = material.density_nominal_g_cm3
    ways, measured = slab(ALL_MAC[index], truth)
    nominal = np.array([each.density_nominal_g_cm3 for each in LIBRARY.values()])
    off = 1.5 * nominal  # a prior that knows no better than a factor of two
    priors = np.stack([off, off, 0.05 * nominal, 4 * nominal], axis=1)
    density, cost, curvature = scanned(ways, measured, ALL_MAC, priors)
    assert density[index] == pytest.approx(truth, rel=0.002)
    assert (curvature > 0).all()
    likelihood = cost - 0.5 * ((density - off) / off) ** 2
    assert likelihood[index] < 0.1
    unlike = np.abs(ALL_MAC / ALL_MAC[index] - 1).max(axis=1) > 0.5
    assert likelihood[unlike].min() > likelihood[index]


def test_search_lets_a_part_be_thinner_than_saturation_tells_but_not_denser():
    mac = ALL_MAC[list(LIBRARY).index("aluminium")]
    ways, light = slab(mac, 2.7)
    for usual, expected in ((2.0, 2.0), (3.5, 2.7)):
        priors = np.array([[usual, 0.5, 0.1, 9.0]])
        density, _, _ = scanned(ways, light, mac[None], priors, at_least=True)
        assert density[0] == pytest.approx(expected, rel=0.02)


def test_search_averages_the_rays_of_a_pixel():
    mac = ALL_MAC[list(LIBRARY).index("aluminium")]
    ways, light = slab(mac, 2.7, (0.9, 0.5, 0.7, 0.2))
    priors = np.array([[2.7, 2.7, 0.1, 9.0]])
    density, _, _ = scanned(ways, light.reshape(2, 2).mean(axis=1), mac[None], priors, rays=2)
    assert density[0] == pytest.approx(2.7, rel=1e-3)


def test_search_stays_between_the_bounds_and_a_sure_prior_holds():
    mac = ALL_MAC[list(LIBRARY).index("steel")]
    ways, measured = slab(mac, 7.85)
    bounded, sure = np.array([[7.0, 1.0, 6.5, 7.2]]), np.array([[7.0, 1e-4, 6.5, 9.0]])
    assert scanned(ways, measured, mac[None], bounded)[0] == 7.2
    assert scanned(ways, measured, mac[None], sure)[0] == pytest.approx(7.0, rel=1e-3)


def test_a_pixel_worth_two_says_what_two_alike_say_however_far_off_they_are():
    """What a pixel is worth must not move how many of its deviations count in full."""
    steel = ALL_MAC[list(LIBRARY).index("steel")]
    ways, measured = slab(steel, 7.8)
    measured = measured + 0.003 * np.array([1.5, -3.0, 5.0, 0.5])
    priors = np.array([[7.8, 0.4, 4.0, 12.0]])
    twice = scanned(np.repeat(ways, 2), np.repeat(measured, 2), steel[None], priors)
    np.testing.assert_allclose(
        scanned(ways, measured, steel[None], priors, share=2.0), twice, rtol=1e-9
    )


def test_one_wild_pixel_does_not_move_the_search_far():
    mac = ALL_MAC[list(LIBRARY).index("pp")]
    ways, measured = slab(mac, 0.9, np.linspace(0.9, 0.2, 30))
    measured[7] = 1.0
    priors = np.array([[0.9, 0.9, 0.05, 4.0]])
    density, _, _ = scanned(ways, measured, mac[None], priors)
    assert density[0] == pytest.approx(0.9, rel=0.01)
