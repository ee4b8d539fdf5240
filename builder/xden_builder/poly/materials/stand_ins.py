"""What each part is taken for while the rest is fitted: one material, or a mixture of several."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float64

from xden1k.values.materials import load_materials
from xden_builder.physics.groups import EnergyGroups
from xden_builder.poly.materials.candidates import CandidateTable
from xden_builder.poly.materials.evidence import MaterialPosterior

__all__ = ["StandIns", "certain", "coefficients", "loosened", "mixtures", "regrouped"]

CLEAR: Final = 0.5
"""A material more probable than this is likelier than all others together."""
NEGLIGIBLE: Final = 0.02
"""Candidates less probable than this share of the best are left out of a mixture."""


@dataclass(frozen=True, slots=True, eq=False)
class StandIns:
    """Coefficients and prior densities of what the parts are taken for.

    Parameters
    ----------
    shares
        Of each part: materials that its coefficients are mixed of, and in which shares of mass.
    mac_cm2_g, scattering_cm2_g
        Shape (K, groups).
    composition_sd
        Shape (K,): of the coefficients, as a share of them.
    mean_g_cm3, sd_g_cm3, low_g_cm3, high_g_cm3
        Shape (K,): density to be expected, and its bounds.
    """

    shares: Sequence[Mapping[str, float]]
    mac_cm2_g: Float64[np.ndarray, "k groups"]
    scattering_cm2_g: Float64[np.ndarray, "k groups"]
    composition_sd: Float64[np.ndarray, "k"]
    mean_g_cm3: Float64[np.ndarray, "k"]
    sd_g_cm3: Float64[np.ndarray, "k"]
    low_g_cm3: Float64[np.ndarray, "k"]
    high_g_cm3: Float64[np.ndarray, "k"]


def certain(tables: Sequence[CandidateTable], choice: Sequence[int]) -> StandIns:
    """Take each part for one of its candidates."""
    pairs = list(zip(tables, choice, strict=True))
    priors = np.stack([table.priors[index] for table, index in pairs])
    return StandIns(
        [{table.candidates[index].material: 1.0} for table, index in pairs],
        np.stack([table.mac_cm2_g[index] for table, index in pairs]),
        np.stack([table.scattering_cm2_g[index] for table, index in pairs]),
        np.array([table.composition_sd[index] for table, index in pairs]),
        *(np.ascontiguousarray(column) for column in priors.T),
    )


def loosened(stand_ins: StandIns) -> StandIns:
    """Let densities leave their materials' ranges, so that a wrong material shows itself."""
    return StandIns(
        stand_ins.shares,
        stand_ins.mac_cm2_g,
        stand_ins.scattering_cm2_g,
        stand_ins.composition_sd,
        stand_ins.mean_g_cm3,
        stand_ins.mean_g_cm3,
        0.05 * stand_ins.mean_g_cm3,
        5.0 * stand_ins.high_g_cm3,
    )


def regrouped(stand_ins: StandIns, groups: EnergyGroups) -> StandIns:
    """Return the same materials before another beam."""
    return replace(
        stand_ins,
        mac_cm2_g=coefficients(stand_ins.shares, groups, scattering=False),
        scattering_cm2_g=coefficients(stand_ins.shares, groups, scattering=True),
    )


def coefficients(
    shares: Sequence[Mapping[str, float]], groups: EnergyGroups, *, scattering: bool
) -> Float64[np.ndarray, "k groups"]:
    """Mix the coefficients of materials by their shares of mass: all of it, or scattering alone."""
    of = groups.scattering_cm2_g if scattering else groups.mac_cm2_g
    library = load_materials()
    return np.stack(
        [
            np.sum([share * of(library[name].composition) for name, share in each.items()], axis=0)
            for each in shares
        ]
    )


def mixtures(
    tables: Sequence[CandidateTable],
    posteriors: Sequence[MaterialPosterior],
    mixture_share: float,
) -> StandIns:
    """Take each part for all candidates that are still possible, in proportion.

    Where one is certain that is the material itself. Where nothing decides, it is a point on the
    line through the materials: density and attenuation of the mixture.

    Parameters
    ----------
    tables, posteriors
        Of each part: its candidates, and how probable each is.
    mixture_share
        Of the variance between the materials that remain: the images have told them apart, and may
        move a density by no more than this.
    """
    pairs = list(zip(tables, posteriors, strict=True))
    shares = [_shares(posterior) for _, posterior in pairs]
    priors = np.stack(
        [
            _prior(table, share, posterior.density_g_cm3, mixture_share)
            for (table, posterior), share in zip(pairs, shares, strict=True)
        ]
    )
    weights = [
        share * posterior.density_g_cm3 / (share @ posterior.density_g_cm3)
        for (_, posterior), share in zip(pairs, shares, strict=True)
    ]
    return StandIns(
        [_by_material(table, weight) for table, weight in zip(tables, weights, strict=True)],
        np.stack([weight @ table.mac_cm2_g for table, weight in zip(tables, weights, strict=True)]),
        np.stack(
            [weight @ table.scattering_cm2_g for table, weight in zip(tables, weights, strict=True)]
        ),
        np.array(
            [weight @ table.composition_sd for table, weight in zip(tables, weights, strict=True)]
        ),
        *(np.ascontiguousarray(column) for column in priors.T),
    )


def _shares(posterior: MaterialPosterior) -> Float64[np.ndarray, "c"]:
    """Probability of each candidate that is still possible; they add up to 1."""
    chance = posterior.probability
    kept = np.where(chance > NEGLIGIBLE * chance.max(), chance, 0.0)
    return np.asarray(kept / kept.sum())


def _prior(
    table: CandidateTable,
    share: Float64[np.ndarray, "c"],
    by_images_g_cm3: Float64[np.ndarray, "c"],
    mixture_share: float,
) -> Float64[np.ndarray, "4"]:
    """Mean, standard deviation, least and most density of a mixture.

    A solid is expected to be as dense as it usually is: what the images say of that they will say
    when densities are fitted, and must not say twice. A body with pores or a cavity has no usual
    density (the middle of its wide range says nothing), and is expected where the images put it.

    A material that is likelier than all others together keeps it within its range: that of the
    solid, or of a body with pores too where that is possible. Where none is, it is the median of
    what remains, one of these: between steel and aluminium there is nothing to be.
    """
    usual, sds, lows, highs = table.priors.T
    solid = np.array([each.solid for each in table.candidates])
    expected = np.where(solid, usual, by_images_g_cm3)
    names = np.array([each.material for each in table.candidates])
    possible = share > 0
    likely = possible & np.array([share[names == name].sum() > CLEAR for name in names])
    clear = bool(likely.any())
    mean = float(share @ expected) if clear else _median(expected, share)
    sd = float(np.sqrt(share @ (sds**2 + mixture_share * (expected - mean) ** 2)))
    kept = likely if clear else possible
    low, high = float(lows[kept].min()), float(highs[kept].max())
    return np.array([min(max(mean, low), high), sd, low, high])


def _median(values: Float64[np.ndarray, "c"], share: Float64[np.ndarray, "c"]) -> float:
    """Return the least value that is not below half of the shares."""
    order = np.argsort(values, kind="stable")
    return float(values[order][np.searchsorted(np.cumsum(share[order]), 0.5)])


def _by_material(table: CandidateTable, weight: Float64[np.ndarray, "c"]) -> dict[str, float]:
    """Add up what the candidates of each material weigh."""
    total: dict[str, float] = {}
    for candidate, share in zip(table.candidates, weight.tolist(), strict=True):
        if share:
            total[candidate.material] = total.get(candidate.material, 0.0) + share
    return total
