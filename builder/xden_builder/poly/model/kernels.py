"""Compiled kernels: the polychromatic forward model and a search over materials.

For pixel p with rays s and energy groups b,
``T_p = mean_s sum_b w_pb exp(-sum_k rho_k m_kb l_psk)``.

A product may fuse with the sum it goes to, which rounds once in place of twice.
"""

import math
from typing import Final, NamedTuple, no_type_check

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int, Int32, Int64

from xden1k.errors import require

__all__ = ["predict", "scan", "scattered"]

compiled = require("numba", "build").njit(cache=True, nogil=True, fastmath={"contract"})


class Precision(NamedTuple):
    """Constants of :func:`_raise_e` in one kind of numbers.

    Parameters
    ----------
    ln2_high, ln2_low
        Logarithm of 2 in two parts: whole multiples of the first are exact.
    doublings
        In one power of e.
    whole
        Added to a number it leaves the nearest whole one in the lowest bits.
    least
        Power that those below count as.
    bias, mantissa_bits
        Of the kind of numbers.
    taylor
        Of the exponential function; what is left out is up to 2.4e-16 of it in double precision,
        8e-9 in single.
    """

    ln2_high: np.floating
    ln2_low: np.floating
    doublings: np.floating
    whole: np.floating
    least: np.floating
    bias: np.signedinteger
    mantissa_bits: np.signedinteger
    taylor: tuple[np.floating, ...]


def _precision(
    real: type[np.floating],
    integer: type[np.signedinteger],
    ln2_high: float,
    ln2_low: float,
    degree: int,
    least: float,
) -> Precision:
    kind = np.finfo(real)
    return Precision(
        real(ln2_high),
        real(ln2_low),
        real(1 / math.log(2)),
        real(1.5 * 2.0**kind.nmant),
        real(least),
        integer(kind.maxexp - 1),
        integer(kind.nmant),
        tuple(real(1 / math.factorial(power)) for power in range(degree, -1, -1)),
    )


DOUBLE: Final = _precision(
    np.float64, np.int64, float.fromhex("0x1.62e42feep-1"), 1.9082149292705877e-10, 12, -700.0
)
SINGLE: Final = _precision(np.float32, np.int32, 0.693359375, -2.1219444005469057e-4, 7, -40.0)
"""Of 4e-18 nothing is seen, and it leaves room before numbers get slow, which 1e-38 does not."""


@compiled
@no_type_check
def _raise_e(
    powers: Float[np.ndarray, "n"], scales: Int[np.ndarray, "n"], precision: Precision
) -> None:
    """Replace some powers by e raised to them, many at once where the processor can.

    A call of the library's function for each would keep the loop from being vectorised, as would
    a conversion to integers. Cody and Waite's way: p = k ln 2 + r, Taylor's series for r, and k
    written into the exponent's bits.

    Parameters
    ----------
    powers
        At most 0; those below the least count as that. Overwritten.
    scales
        Room to work in, integers as wide as the powers.
    precision
        Of the powers.
    """
    doublings = scales.view(powers.dtype)
    for i in range(len(powers)):
        power = max(powers[i], precision.least)
        whole = power * precision.doublings + precision.whole
        twos = whole - precision.whole
        rest = (power - twos * precision.ln2_high) - twos * precision.ln2_low
        series = precision.taylor[0]
        for coefficient in precision.taylor[1:]:
            series = series * rest + coefficient
        powers[i] = series
        doublings[i] = whole
    for i in range(len(powers)):
        scales[i] = (scales[i] + precision.bias) << precision.mantissa_bits
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
        _raise_e(light[:used], scales[:used], DOUBLE)
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
            _raise_e(light, scales, DOUBLE)
            for group in range(groups):
                total += weights[pixel, group] * light[group] * turned[group]
        source[pixel] = total / rays


@compiled
@no_type_check
def _behind(
    others: Float32[np.ndarray, "b r"],
    ways: Float32[np.ndarray, "r"],
    density: float,
    mac: Float64[np.ndarray, "b"],
    light: Float32[np.ndarray, "r"],
    scales: Int32[np.ndarray, "r"],
    values: Float32[np.ndarray, "r"],
    absorbed: Float32[np.ndarray, "r"],
) -> None:
    """Write the signal of each ray behind a part, and the same times its mass attenuation.

    Group by group, since sums over groups would keep the loop over rays from being vectorised.
    ``light`` and ``scales`` are room to work in.
    """
    values[:] = 0
    absorbed[:] = 0
    for group in range(len(mac)):
        attenuation, weakening = np.float32(mac[group]), np.float32(-density * mac[group])
        for ray in range(len(ways)):
            light[ray] = weakening * ways[ray]
        _raise_e(light, scales, SINGLE)
        for ray in range(len(ways)):
            light[ray] *= others[group, ray]
            values[ray] += light[ray]
            absorbed[ray] += light[ray] * attenuation


@compiled
@no_type_check
def scan(
    others: Float32[np.ndarray, "b r"],
    ways: Float32[np.ndarray, "r"],
    ends: Int64[np.ndarray, "n"],
    beside: Float64[np.ndarray, "n"],
    counts: Int64[np.ndarray, "n"],
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

    Signals are worked out in single precision, a hundred times finer than any noise.

    Parameters
    ----------
    others
        Signal of each energy group along each ray that meets the part, behind all other parts,
        gain included.
    ways
        Way of each ray through this part in cm.
    ends
        Index after the last ray of each pixel, as of the one before where none meets the part.
    beside, counts
        Of each pixel: summed signal of those of its rays that miss the part, and how many rays
        are averaged.
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
    light, scales = np.empty(rays, np.float32), np.empty(rays, np.int32)
    values, absorbed = np.empty(rays, np.float32), np.empty(rays, np.float32)
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
                value, slope = beside[pixel], 0.0
                while ray < ends[pixel]:
                    value += values[ray]
                    slope -= absorbed[ray] * ways[ray]
                    ray += 1
                value /= counts[pixel]
                slope /= counts[pixel]
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
