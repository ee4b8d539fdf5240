"""Compiled kernels: the forward model of Eq. 6 and sums over its Jacobian.

For pixel p with rays s, ``T_p = mean_s exp(-sum_k mu_k l_psk)``, the model is ``g T_p``, and its
derivatives are ``-g mean_s exp(.) l_psk`` by mu_k and ``T_p`` by the gain g. No Jacobian is ever
stored: each kernel adds what it needs pixel by pixel, so memory does not grow with the image.
"""

from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64, UInt8, UInt64

from xden1k.errors import require

__all__ = [
    "Ways",
    "air_sums",
    "block_scores",
    "hit_sets",
    "information",
    "met_parts",
    "normal_equations",
    "ways_of",
]

compiled = require("numba", "build").njit(cache=True, nogil=True)


class Ways(NamedTuple):
    """Path lengths of the parts that are met: of many parts a pixel's rays meet few.

    Parameters
    ----------
    begins
        Shape (n + 1,): where each pixel's parts begin, and the last one's end.
    parts
        Shape (m,): which parts the pixels meet, one after the other.
    lengths_cm
        Shape (m, rays): of a pixel's rays through each.
    """

    begins: Int64[np.ndarray, "n1"]
    parts: Int64[np.ndarray, "m"]
    lengths_cm: Float32[np.ndarray, "m rays"]


@compiled
@no_type_check
def ways_of(lengths: Float32[np.ndarray, "n s k"]) -> Ways:
    """Leave out the parts that none of a pixel's rays meets."""
    pixels, rays, parts = lengths.shape
    met = np.zeros((pixels, parts), np.bool_)
    begins = np.zeros(pixels + 1, np.int64)
    for pixel in range(pixels):
        for ray in range(rays):
            for part in range(parts):
                met[pixel, part] |= lengths[pixel, ray, part] > 0.0
        begins[pixel + 1] = begins[pixel]
        for part in range(parts):
            begins[pixel + 1] += met[pixel, part]
    found, kept = np.empty(begins[-1], np.int64), np.empty((begins[-1], rays), np.float32)
    place = 0
    for pixel in range(pixels):
        for part in range(parts):
            if met[pixel, part]:
                found[place] = part
                for ray in range(rays):
                    kept[place, ray] = lengths[pixel, ray, part]
                place += 1
    return Ways(begins, found, kept)


@compiled
@no_type_check
def _transmission(
    met: Int64[np.ndarray, "m"],
    lengths: Float32[np.ndarray, "m s"],
    begin: int,
    end: int,
    lac: Float64[np.ndarray, "k"],
    light: Float64[np.ndarray, "s"],
    weighted: Float64[np.ndarray, "k1"],
) -> float:
    """Transmission of one pixel, whose parts stand from ``begin`` to ``end``.

    ``light`` is room to work in, the first of ``weighted`` become the mean of exp(.) times each
    part's lengths. Slices of arrays would cost as much as the sums.
    """
    rays = len(light)
    light[:] = 0.0
    for place in range(begin, end):
        per_cm = lac[met[place]]
        for ray in range(rays):
            light[ray] -= per_cm * lengths[place, ray]
    total = 0.0
    for ray in range(rays):
        light[ray] = np.exp(light[ray]) / rays
        total += light[ray]
    for place in range(begin, end):
        mean = 0.0
        for ray in range(rays):
            mean += light[ray] * lengths[place, ray]
        weighted[place - begin] = mean
    return total


@compiled
@no_type_check
def normal_equations(
    ways: Ways,
    measured: Float64[np.ndarray, "n"],
    weights: Float64[np.ndarray, "n"],
    lac: Float64[np.ndarray, "k"],
    gain: float,
    transmission: Float64[np.ndarray, "n"],
    gradient: Float64[np.ndarray, "k1"],
    hessian: Float64[np.ndarray, "k1 k1"],
) -> float:
    """Return the sum of w r² and add to the rest, of which the last row is the gain's.

    Parameters
    ----------
    ways
        Of the pixels.
    measured, weights
        Measured transmission, weight of its squared residual (0: left out).
    lac, gain
        Where to evaluate.
    transmission
        Result: T of every pixel, without the gain.
    gradient, hessian
        Half the gradient, Jᵀ W r, and JᵀWJ: added to.
    """
    parts = len(lac)
    begins, met, lengths = ways
    row, light = np.zeros(parts + 1), np.zeros(lengths.shape[1])
    hit = np.zeros(parts + 1, dtype=np.int64)
    loss = 0.0
    for pixel in range(len(measured)):
        begin, end = begins[pixel], begins[pixel + 1]
        value = _transmission(met, lengths, begin, end, lac, light, row)
        transmission[pixel] = value
        weight = weights[pixel]
        if weight == 0.0:
            continue
        residual = gain * value - measured[pixel]
        loss += weight * residual * residual
        hits = end - begin
        for i in range(hits):
            row[i] *= -gain
            hit[i] = met[begin + i]
        row[hits] = value
        hit[hits] = parts
        for i in range(hits + 1):
            scaled = weight * row[i]
            gradient[hit[i]] += scaled * residual
            for j in range(i + 1):
                hessian[hit[i], hit[j]] += scaled * row[j]
    for i in range(parts + 1):
        for j in range(i):
            hessian[j, i] = hessian[i, j]
    return loss


@compiled
@no_type_check
def block_scores(
    ways: Ways,
    weighted_residuals: Float64[np.ndarray, "n"],
    blocks: Int64[np.ndarray, "n"],
    lac: Float64[np.ndarray, "k"],
    gain: float,
    scores: Float64[np.ndarray, "blocks k1"],
) -> None:
    """Add Jᵀ W r of each block of pixels to its row."""
    parts = len(lac)
    begins, met, lengths = ways
    row, light = np.zeros(parts), np.zeros(lengths.shape[1])
    for pixel in range(len(blocks)):
        begin, end = begins[pixel], begins[pixel + 1]
        value = _transmission(met, lengths, begin, end, lac, light, row)
        for i in range(end - begin):
            scores[blocks[pixel], met[begin + i]] -= gain * row[i] * weighted_residuals[pixel]
        scores[blocks[pixel], parts] += value * weighted_residuals[pixel]


@compiled
@no_type_check
def information(
    ways: Ways,
    weights: Float64[np.ndarray, "n"],
    kinds: UInt8[np.ndarray, "n"],
    lac: Float64[np.ndarray, "k"],
    gain: float,
    totals: Float64[np.ndarray, "kinds k"],
) -> None:
    """Add each part's Fisher information, the diagonal of JᵀWJ, by kind of pixel."""
    begins, met, lengths = ways
    row, light = np.zeros(len(lac)), np.zeros(lengths.shape[1])
    for pixel in range(len(weights)):
        begin, end = begins[pixel], begins[pixel + 1]
        _transmission(met, lengths, begin, end, lac, light, row)
        for i in range(end - begin):
            totals[kinds[pixel], met[begin + i]] += weights[pixel] * (gain * row[i]) ** 2


@compiled
@no_type_check
def hit_sets(
    lengths: Float32[np.ndarray, "n s k"],
    keys: UInt64[np.ndarray, "k"],
    sets: UInt64[np.ndarray, "n"],
) -> None:
    """Give every pixel one number for the set of parts its rays meet: the keys of these, xor."""
    rays, parts = lengths.shape[1:]
    for pixel in range(len(sets)):
        for part in range(parts):
            for ray in range(rays):
                if lengths[pixel, ray, part] > 0.0:
                    sets[pixel] ^= keys[part]
                    break


@compiled
@no_type_check
def met_parts(ways: Ways, usable: Bool[np.ndarray, "n"], met: Bool[np.ndarray, "k"]) -> None:
    """Mark the parts that a ray of a usable pixel meets."""
    begins, parts, _ = ways
    for pixel in range(len(usable)):
        if usable[pixel]:
            for place in range(begins[pixel], begins[pixel + 1]):
                met[parts[place]] = True


@compiled
@no_type_check
def air_sums(
    transmission: Float32[np.ndarray, "pixels"],
    chosen: Bool[np.ndarray, "pixels"],
    centre: float,
    reach: float,
) -> tuple[int, float, float]:
    """Count the chosen pixels within reach of the centre; sum their offsets, and the squares."""
    count, total, squares = 0, 0.0, 0.0
    for pixel in range(len(transmission)):
        if chosen[pixel]:
            off = transmission[pixel] - centre
            if abs(off) <= reach:
                count += 1
                total += off
                squares += off * off
    return count, total, squares
