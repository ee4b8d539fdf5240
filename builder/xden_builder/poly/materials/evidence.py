"""Which material a part is made of, by the evidence of both radiographs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int64

from xden_builder.fit.huber import HUBER
from xden_builder.poly.materials.candidates import CandidateTable
from xden_builder.poly.model import kernels
from xden_builder.poly.model.pixels import ViewPixels

__all__ = ["MaterialPosterior", "Radiographs", "weigh_materials"]

MOST_PIXELS: Final = 60
MOST_BLOCKS: Final = 6
"""Compared in each view; those left out lend their weight to these."""


@dataclass(frozen=True, slots=True, eq=False)
class MaterialPosterior:
    """Probability of each candidate of a part, all other parts being as they are.

    Parameters
    ----------
    probability
        Shape (candidates,).
    density_g_cm3
        Shape (candidates,): best density, if that is the material.
    seen_g_cm3, sd_g_cm3
        Shape (candidates,): density that the images see, were the coefficients the library's, and
        its standard deviation.
    """

    probability: Float64[np.ndarray, "c"]
    density_g_cm3: Float64[np.ndarray, "c"]
    seen_g_cm3: Float64[np.ndarray, "c"]
    sd_g_cm3: Float64[np.ndarray, "c"]


@dataclass(frozen=True, slots=True, eq=False)
class Radiographs:
    """Both radiographs, with everything but one part's material taken as known.

    Parameters
    ----------
    views
        Samples.
    sds
        Standard deviation of each sample.
    strays
        Stray light at each sample, gain included.
    gains
        Of each view.
    share
        Of an independent observation that a sample is worth.
    """

    views: Sequence[ViewPixels]
    sds: Sequence[Float64[np.ndarray, "_n"]]
    strays: Sequence[Float64[np.ndarray, "_n"]]
    gains: Sequence[float]
    share: float


class _Rays(NamedTuple):
    """Rays of some samples that meet a part."""

    others: Float64[np.ndarray, "r groups"]
    ways: Float64[np.ndarray, "r"]
    counts: Int64[np.ndarray, "n"]
    measured: Float64[np.ndarray, "n"]
    at_least: Bool[np.ndarray, "n"]
    inverse_sd: Float64[np.ndarray, "n"]


def weigh_materials(
    radiographs: Radiographs,
    part: int,
    density_g_cm3: Float64[np.ndarray, "k"],
    mac_cm2_g: Float64[np.ndarray, "k groups"],
    table: CandidateTable,
) -> MaterialPosterior:
    """Weigh the candidates of one part, by Laplace's approximation of each one's evidence.

    Parameters
    ----------
    radiographs
        With everything else known.
    part
        Which.
    density_g_cm3, mac_cm2_g
        Of all parts; the part's own are not used.
    table
        Its candidates. Where no ray meets the part they keep their prior probability.
    """
    rays = list(_rays(radiographs, part, density_g_cm3, mac_cm2_g))
    priors = table.seen_priors
    found = np.stack([priors[:, 0], np.zeros(len(priors)), priors[:, 1] ** -2.0])
    found = np.ascontiguousarray(found.T)
    if rays:
        others, ways, counts, measured, at_least, inverse_sd = (
            np.concatenate(column) for column in zip(*rays, strict=True)
        )
        kernels.scan(
            others,
            ways,
            np.cumsum(counts),
            measured,
            at_least,
            inverse_sd,
            radiographs.share,
            HUBER,
            table.mac_cm2_g,
            priors,
            found,
        )
    seen, cost, curvature = found.T
    log_evidence = table.log_prior - cost - np.log(priors[:, 1]) - 0.5 * np.log(curvature)
    relative = np.exp(log_evidence - log_evidence.max())
    return MaterialPosterior(
        relative / relative.sum(),
        table.densities(seen),
        np.ascontiguousarray(seen),
        curvature**-0.5,
    )


def _rays(
    radiographs: Radiographs,
    part: int,
    density_g_cm3: Float64[np.ndarray, "k"],
    mac_cm2_g: Float64[np.ndarray, "k groups"],
) -> Iterator[_Rays]:
    """Yield pixels and blocks of each view that meet the part."""
    for view, sd, stray, gain in zip(
        radiographs.views, radiographs.sds, radiographs.strays, radiographs.gains, strict=True
    ):
        meets = view.meets[:, part]
        for kind, most in ((~view.is_block, MOST_PIXELS), (view.is_block, MOST_BLOCKS)):
            mine = np.flatnonzero(meets & kind)
            if not len(mine):
                continue
            some = mine[:: -(-len(mine) // most)]
            count = int(view.rays[some[0]])
            lengths = view.lengths_cm[some, :count].astype(np.float64)
            lengths = lengths.reshape(-1, len(density_g_cm3))
            areal = lengths * density_g_cm3
            areal[:, part] = 0.0
            open_field = gain * np.repeat(view.weights[some], count, axis=0)
            yield _Rays(
                open_field * np.exp(-areal @ mac_cm2_g),
                np.ascontiguousarray(lengths[:, part]),
                np.full(len(some), count),
                view.measured[some] - stray[some],
                view.at_least[some],
                np.sqrt(len(mine) / len(some)) / sd[some],
            )
