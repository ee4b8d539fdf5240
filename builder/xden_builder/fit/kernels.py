"""Compiled kernels: the forward model of Eq. 6 and sums over its Jacobian.

For pixel p with rays s, ``T_p = mean_s exp(-sum_k mu_k l_psk)``, the model is ``g T_p``, and its
derivatives are ``-g mean_s exp(.) l_psk`` by mu_k and ``T_p`` by the gain g. No Jacobian is ever
stored: each kernel adds what it needs pixel by pixel, so memory does not grow with the image.
"""

from typing import no_type_check

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64, UInt8, UInt64

from xden1k.errors import require

__all__ = ["air_sums", "block_scores", "hit_sets", "information", "met_parts", "normal_equations"]

compiled = require("numba", "build").njit(cache=True, nogil=True)


@compiled
@no_type_check
def _transmission(
    lengths: Float32[np.ndarray, "n s k"],
    pixel: int,
    lac: Float64[np.ndarray, "k"],
    weighted: Float64[np.ndarray, "k1"],
) -> float:
    """Transmission of one pixel; ``weighted`` becomes the mean of exp(.) times each length."""
    rays, parts = lengths.shape[1:]
    weighted[:] = 0.0
    total = 0.0
    for ray in range(rays):
        attenuation = 0.0
        for part in range(parts):
            attenuation += lac[part] * lengths[pixel, ray, part]
        share = np.exp(-attenuation) / rays
        total += share
        for part in range(parts):
            weighted[part] += share * lengths[pixel, ray, part]
    return total


@compiled
@no_type_check
def normal_equations(
    lengths: Float32[np.ndarray, "n s k"],
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
    lengths, measured, weights
        Path lengths in cm, measured transmission, weight of its squared residual (0: left out).
    lac, gain
        Where to evaluate.
    transmission
        Result: T of every pixel, without the gain.
    gradient, hessian
        Half the gradient, Jᵀ W r, and JᵀWJ: added to.
    """
    parts = len(lac)
    row = np.zeros(parts + 1)
    hit = np.zeros(parts + 1, dtype=np.int64)
    loss = 0.0
    for pixel in range(len(measured)):
        value = _transmission(lengths, pixel, lac, row)
        transmission[pixel] = value
        weight = weights[pixel]
        if weight == 0.0:
            continue
        residual = gain * value - measured[pixel]
        loss += weight * residual * residual
        hits = 0
        for part in range(parts):
            if row[part] != 0.0:
                row[part] *= -gain
                hit[hits] = part
                hits += 1
        row[parts] = value
        hit[hits] = parts
        for i in range(hits + 1):
            scaled = weight * row[hit[i]]
            gradient[hit[i]] += scaled * residual
            for j in range(i + 1):
                hessian[hit[i], hit[j]] += scaled * row[hit[j]]
    for i in range(parts + 1):
        for j in range(i):
            hessian[j, i] = hessian[i, j]
    return loss


@compiled
@no_type_check
def block_scores(
    lengths: Float32[np.ndarray, "n s k"],
    weighted_residuals: Float64[np.ndarray, "n"],
    blocks: Int64[np.ndarray, "n"],
    lac: Float64[np.ndarray, "k"],
    gain: float,
    scores: Float64[np.ndarray, "blocks k1"],
) -> None:
    """Add Jᵀ W r of each block of pixels to its row."""
    parts = len(lac)
    row = np.zeros(parts + 1)
    for pixel in range(len(blocks)):
        value = _transmission(lengths, pixel, lac, row)
        for part in range(parts):
            scores[blocks[pixel], part] -= gain * row[part] * weighted_residuals[pixel]
        scores[blocks[pixel], parts] += value * weighted_residuals[pixel]


@compiled
@no_type_check
def information(
    lengths: Float32[np.ndarray, "n s k"],
    weights: Float64[np.ndarray, "n"],
    kinds: UInt8[np.ndarray, "n"],
    lac: Float64[np.ndarray, "k"],
    gain: float,
    totals: Float64[np.ndarray, "kinds k"],
) -> None:
    """Add each part's Fisher information, the diagonal of JᵀWJ, by kind of pixel."""
    parts = len(lac)
    row = np.zeros(parts)
    for pixel in range(len(weights)):
        _transmission(lengths, pixel, lac, row)
        for part in range(parts):
            totals[kinds[pixel], part] += weights[pixel] * (gain * row[part]) ** 2


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
def met_parts(
    lengths: Float32[np.ndarray, "n s k"],
    usable: Bool[np.ndarray, "n"],
    met: Bool[np.ndarray, "k"],
) -> None:
    """Mark the parts that a ray of a usable pixel meets."""
    pixels, rays, parts = lengths.shape
    for pixel in range(pixels):
        if usable[pixel]:
            for ray in range(rays):
                for part in range(parts):
                    met[part] |= lengths[pixel, ray, part] > 0.0


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
