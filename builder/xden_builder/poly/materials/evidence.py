"""Which material a part is made of, by the evidence of both radiographs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64

from xden_builder.fit.huber import HUBER
from xden_builder.poly.materials.candidates import CandidateTable
from xden_builder.poly.model import kernels
from xden_builder.poly.model.pixels import ViewPixels

__all__ = ["MaterialPosterior", "Radiographs", "weigh_materials"]

NEGLIGIBLE: Final = 1e-3
"""Candidates that cannot be as probable as this share of the best, whatever they looked like, are
not tried."""
FAINTEST: Final = 1e-18
"""Of the open field; less is none, and products stay clear of numbers that are slow."""
MOST_PIXELS: Final = 120
MOST_BLOCKS: Final = 15
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

    @property
    def between_g_cm3(self) -> float:
        """Standard deviation of the best densities."""
        return float(np.sqrt(np.cov(self.density_g_cm3, aweights=self.probability, ddof=0)))


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
    """Some samples and those of their rays that meet a part.

    Of each sample so many rays are ``meeting`` of ``counts`` that are averaged, and ``beside`` is
    the summed signal of the others.
    """

    others: Float32[np.ndarray, "groups r"]
    ways: Float32[np.ndarray, "r"]
    meeting: Int64[np.ndarray, "n"]
    beside: Float64[np.ndarray, "n"]
    counts: Int64[np.ndarray, "n"]
    measured: Float64[np.ndarray, "n"]
    at_least: Bool[np.ndarray, "n"]
    inverse_sd: Float64[np.ndarray, "n"]
    shares: Float64[np.ndarray, "n"]


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
        Its candidates. Where no ray meets the part they keep their prior probability; what cannot
        reach :data:`NEGLIGIBLE` has none.
    """
    rays = list(_rays(radiographs, part, density_g_cm3, mac_cm2_g))
    if not rays:
        mean, sd = table.seen_priors[:, 0], table.seen_priors[:, 1]
        return _posterior(table, np.column_stack([mean, table.log_prior, sd**-2.0]))
    others, *columns = zip(*rays, strict=True)
    seen = _Rays(np.concatenate(others, axis=1), *map(np.concatenate, columns))
    return _posterior(table, _weighed(seen, table))


def _weighed(seen: _Rays, table: CandidateTable) -> Float64[np.ndarray, "c 3"]:
    """Best density of each candidate, logarithm of its evidence, and curvature.

    Evidence is prior probability times at most 1, so that what cannot come near the best any more
    is not tried: first those with a chance before the images, then those with one beside the best.
    """
    mean, sd, _, _ = table.seen_priors.T
    found = np.column_stack([mean, np.full(len(mean), -np.inf), sd**-2.0])
    best = table.log_prior.max()
    for _ in range(2):
        possible = table.log_prior > best + math.log(NEGLIGIBLE)
        untried = possible & np.isneginf(found[:, 1])
        found[untried] = _scanned(seen, table, untried)
        best = found[:, 1].max()
    return found


def _scanned(
    seen: _Rays, table: CandidateTable, which: Bool[np.ndarray, "c"]
) -> Float64[np.ndarray, "n 3"]:
    """Do so for some of the candidates, by Laplace's approximation."""
    priors, found = table.seen_priors[which], np.empty((int(which.sum()), 3))
    kernels.scan(
        seen.others,
        seen.ways,
        np.cumsum(seen.meeting),
        seen.beside,
        seen.counts,
        seen.measured,
        seen.at_least,
        seen.inverse_sd,
        seen.shares,
        HUBER,
        table.mac_cm2_g[which],
        priors,
        found,
    )
    _, cost, curvature = found.T
    found[:, 1] = table.log_prior[which] - cost - np.log(priors[:, 1]) - 0.5 * np.log(curvature)
    return found


def _posterior(table: CandidateTable, found: Float64[np.ndarray, "c 3"]) -> MaterialPosterior:
    seen, log_evidence, curvature = (np.ascontiguousarray(column) for column in found.T)
    relative = np.exp(log_evidence - log_evidence.max())
    chance = relative / relative.sum()
    return MaterialPosterior(chance, table.densities(seen), seen, curvature**-0.5)


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
        behind = view.lengths_cm[:, :, part].any(axis=1)
        for kind, most in ((~view.is_block, MOST_PIXELS), (view.is_block, MOST_BLOCKS)):
            mine = np.flatnonzero(behind & kind)
            if not len(mine):
                continue
            some = mine[:: -(-len(mine) // most)]
            count = int(view.rays[some[0]])
            lengths = view.lengths_cm[some, :count].astype(np.float64)
            areal = lengths * density_g_cm3
            areal[:, :, part] = 0.0
            open_field = gain * view.weights[some, None]
            others = open_field * np.exp(-areal @ mac_cm2_g)
            others[others < FAINTEST] = 0.0
            meeting = lengths[:, :, part] > 0
            yield _Rays(
                np.ascontiguousarray(others[meeting].T, np.float32),
                view.lengths_cm[some, :count, part][meeting],
                meeting.sum(axis=1),
                others.sum(axis=2, where=~meeting[:, :, None]).sum(axis=1),
                np.full(len(some), count),
                view.measured[some] - stray[some],
                view.at_least[some],
                1 / sd[some],
                np.full(len(some), radiographs.share * len(mine) / len(some)),
            )
