"""Compiled kernels: the polychromatic forward model and a search over materials.

For pixel p with rays s and energy groups b,
``T_p = mean_s sum_b w_pb exp(-sum_k rho_k m_kb l_psk)``.

A product may fuse with the sum it goes to, which rounds once in place of twice.
"""

import math
from typing import Final, no_type_check

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64

from xden1k.errors import require

__all__ = ["predict", "scan", "scattered"]

compiled = require("numba", "build").njit(cache=True, nogil=True, fastmath={"contract"})

LN2_HIGH: Final = float.fromhex("0x1.62e42feep-1")
LN2_LOW: Final = 1.9082149292705877e-10
"""Logarithm of 2 in two parts: whole multiples of the first are exact."""
TAYLOR: Final = tuple(1 / math.factorial(degree) for degree in range(12, -1, -1))
"""Of the exponential function; what is left out is below 3e-16 of it up to ln(2) / 2."""
LEAST_POWER: Final = -700.0
EXPONENT_BIAS: Final = 1023
MANTISSA_BITS: Final = 52
"""Of float64."""
WHOLE: Final = 1.5 * 2.0**MANTISSA_BITS
"""Added to a number it leaves the nearest whole one in the lowest bits."""


@compiled
@no_type_check
def _raise_e(powers: Float64[np.ndarray, "n"], scales: Int64[np.ndarray, "n"]) -> None:
    """Replace some powers by e raised to them, many at once where the processor can.

    A call of the library's function for each would keep the loop from being vectorised, as would
    a conversion to integers. Cody and Waite's way: p = k ln 2 + r, Taylor's series for r, and k
    written into the exponent's bits.

    Parameters
    ----------
    powers
        At most 700; those below -700 count as that. Overwritten.
    scales
        Room to work in.
    """
    doublings = scales.view(np.float64)
    for i in range(len(powers)):
        power = max(powers[i], LEAST_POWER)
        whole = power * (1 / LN2_HIGH) + WHOLE
        twos = whole - WHOLE
        rest = (power - twos * LN2_HIGH) - twos * LN2_LOW
        series = 0.0
        for coefficient in TAYLOR:
            series = series * rest + coefficient
        powers[i] = series
        doublings[i] = whole
    for i in range(len(powers)):
        scales[i] = (scales[i] + EXPONENT_BIAS) << MANTISSA_BITS
    for i in range(len(powers)):
        powers[i] *= doublings[i]


@compiled
@no_type_check
def predict(
    lengths: Float32[np.ndarray, "n s k"],
    rays: Int64[np.ndarray, "n"],
    mac: Float64[np.ndarray, "k b"],
    density: Float64[np.ndarray, "k"],
    weights: Float64[np.ndarray, "n b"],
    transmission: Float64[np.ndarray, "n"],
    slopes: Float64[np.ndarray, "n k1"],
) -> None:
    """Write the transmission of each pixel and its derivatives by the densities.

    Parameters
    ----------
    lengths, weights
        Path lengths in cm, and share of each energy group in the open field of the pixel.
    rays
        How many rays of each pixel are averaged, the first ones.
    mac, density
        Mass attenuation coefficients in cm²/g and densities in g/cm³.
    transmission, slopes
        Written. With no row in ``slopes`` no derivative is computed.
    """
    parts, groups = mac.shape
    room = lengths.shape[1] * groups
    light, scales = np.empty(room), np.empty(room, np.int64)
    sums, way_light = np.empty(groups), np.empty((parts, groups))
    for pixel in range(lengths.shape[0]):
        used = rays[pixel] * groups
        light[:used] = 0.0
        for ray in range(rays[pixel]):
            for part in range(parts):
                way = lengths[pixel, ray, part]
                if way > 0:
                    areal = way * density[part]
                    for group in range(groups):
                        light[ray * groups + group] -= areal * mac[part, group]
        _raise_e(light[:used], scales[:used])
        sums[:] = 0.0
        for ray in range(rays[pixel]):
            for group in range(groups):
                sums[group] += light[ray * groups + group]
        total = 0.0
        for group in range(groups):
            total += sums[group] * weights[pixel, group]
        transmission[pixel] = total / rays[pixel]
        if slopes.shape[0] == 0:
            continue
        way_light[:] = 0.0
        for ray in range(rays[pixel]):
            for part in range(parts):
                way = lengths[pixel, ray, part]
                if way > 0:
                    for group in range(groups):
                        way_light[part, group] += way * light[ray * groups + group]
        for part in range(parts):
            total = 0.0
            for group in range(groups):
                total += way_light[part, group] * mac[part, group] * weights[pixel, group]
            slopes[pixel, part] = -total / rays[pixel]


@compiled
@no_type_check
def scattered(
    lengths: Float32[np.ndarray, "n s k"],
    mac: Float64[np.ndarray, "k b"],
    scattering: Float64[np.ndarray, "k b"],
    density: Float64[np.ndarray, "k"],
    weights: Float64[np.ndarray, "n b"],
    source: Float64[np.ndarray, "n"],
) -> None:
    """Write what each pixel's beam loses by scattering and nothing else: T times that depth.

    Parameters
    ----------
    lengths, mac, density, weights
        As of :func:`predict`; all rays are averaged.
    scattering
        Coherent and incoherent part of ``mac``.
    source
        Written, in shares of the open field.
    """
    parts, groups = mac.shape
    rays = lengths.shape[1]
    light, turned, scales = np.empty(groups), np.empty(groups), np.empty(groups, np.int64)
    for pixel in range(lengths.shape[0]):
        total = 0.0
        for ray in range(rays):
            light[:] = 0.0
            turned[:] = 0.0
            for part in range(parts):
                areal = lengths[pixel, ray, part] * density[part]
                if areal > 0:
                    for group in range(groups):
                        light[group] -= areal * mac[part, group]
                        turned[group] += areal * scattering[part, group]
            _raise_e(light, scales)
            for group in range(groups):
                total += weights[pixel, group] * light[group] * turned[group]
        source[pixel] = total / rays


@compiled
@no_type_check
def _behind(
    others: Float64[np.ndarray, "b r"],
    ways: Float64[np.ndarray, "r"],
    density: float,
    mac: Float64[np.ndarray, "b"],
    light: Float64[np.ndarray, "r"],
    scales: Int64[np.ndarray, "r"],
    values: Float64[np.ndarray, "r"],
    absorbed: Float64[np.ndarray, "r"],
) -> None:
    """Write the signal of each ray behind a part, and the same times its mass attenuation.

    Group by group, since sums over groups would keep the loop over rays from being vectorised.
    ``light`` and ``scales`` are room to work in.
    """
    values[:] = 0.0
    absorbed[:] = 0.0
    for group in range(len(mac)):
        for ray in range(len(ways)):
            light[ray] = -density * mac[group] * ways[ray]
        _raise_e(light, scales)
        for ray in range(len(ways)):
            light[ray] *= others[group, ray]
            values[ray] += light[ray]
            absorbed[ray] += light[ray] * mac[group]


@compiled
@no_type_check
def scan(
    others: Float64[np.ndarray, "b r"],
    ways: Float64[np.ndarray, "r"],
    ends: Int64[np.ndarray, "n"],
    measured: Float64[np.ndarray, "n"],
    at_least: Bool[np.ndarray, "n"],
    inverse_sd: Float64[np.ndarray, "n"],
    shares: Float64[np.ndarray, "n"],
    huber: float,
    macs: Float64[np.ndarray, "c b"],
    priors: Float64[np.ndarray, "c 4"],
    found: Float64[np.ndarray, "c 3"],
) -> None:
    """Find the best density of one part for each material it may be made of.

    Parameters
    ----------
    others
        Signal of each energy group along each ray behind all other parts, gain included.
    ways
        Way of each ray through this part in cm.
    ends
        Index after the last ray of each pixel; its rays are averaged.
    measured, at_least, inverse_sd
        Transmission less the other light, whether it is known from below alone, and one over its
        standard deviation.
    shares
        Of an independent observation that each pixel is worth.
    huber
        Standard deviations beyond which a residual counts linearly.
    macs, priors
        Of each candidate: mass attenuation coefficients; mean, standard deviation, least and most
        density.
    found
        Written: density, cost (minus the logarithm of likelihood times prior, constants left out)
        and its curvature.
    """
    rays = len(ways)
    light, scales = np.empty(rays), np.empty(rays, np.int64)
    values, absorbed = np.empty(rays), np.empty(rays)
    kinked = at_least.any()  # one-sided residuals begin and end: steps may go to and fro
    for candidate in range(macs.shape[0]):
        mean, sd, low, high = priors[candidate]
        density = min(max(mean, low), high)
        bottom, top = low, high
        cost, curvature = 0.0, 1.0
        for _ in range(12):
            gradient = (density - mean) / sd**2
            curvature = 1.0 / sd**2
            cost = 0.5 * (density - mean) ** 2 / sd**2
            _behind(others, ways, density, macs[candidate], light, scales, values, absorbed)
            ray = 0
            for pixel in range(measured.shape[0]):
                value, slope, count = 0.0, 0.0, ends[pixel] - ray
                while ray < ends[pixel]:
                    value += values[ray]
                    slope -= absorbed[ray] * ways[ray]
                    ray += 1
                value /= count
                slope /= count
                residual = (value - measured[pixel]) * inverse_sd[pixel]
                if at_least[pixel] and residual >= 0:
                    continue
                slope *= inverse_sd[pixel]
                size, share = abs(residual), shares[pixel]
                if size <= huber:
                    cost += 0.5 * share * residual**2
                    weight = 1.0
                else:
                    cost += share * huber * (size - 0.5 * huber)
                    weight = huber / size
                gradient += share * weight * residual * slope
                curvature += share * weight * slope**2
            step = -gradient / curvature
            # exp is convex: halve leaps that would leave the neighbourhood
            limit = 0.5 * density + sd
            step = min(max(step, -limit), limit)
            ahead = min(max(density + step, low), high)
            if gradient > 0:
                top = density
            else:
                bottom = density
            if kinked and not bottom < ahead < top:
                ahead = 0.5 * (bottom + top)
            if abs(ahead - density) < 1e-4 * density:
                break
            density = ahead
        found[candidate, 0] = density
        found[candidate, 1] = cost
        found[candidate, 2] = curvature
