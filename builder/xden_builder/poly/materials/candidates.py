"""What a part may be made of, how likely each is before any X-ray, and how dense it can be."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

import numpy as np
from jaxtyping import Bool, Float64

from xden1k.values.materials import Material, load_materials
from xden_builder.capture import CapturePart
from xden_builder.fit.density import HOLLOW_LEAST, HOLLOW_SD, HOLLOW_USUAL
from xden_builder.physics.groups import EnergyGroups
from xden_builder.poly.materials.composition import composition_sd
from xden_builder.poly.materials.shares import material_shares

__all__ = ["Candidate", "CandidateTable", "candidate_table", "candidates"]

POROUS_SHARE: Final = 0.15
"""Of mouldings, castings and other bodies that are foamed or have pores."""
POROUS_MEAN: Final = 0.68
POROUS_SD: Final = 0.19
POROUS_LEAST: Final = 0.2
"""Density of a porous body as shares of the solid's: structural foam has a third and more of it."""
LEAST_SD_SHARE: Final = 0.01
"""The densities of no material are known better."""
NEVER_POROUS: Final = frozenset({"metal", "glass", "liquid", "foam", "gas", "composite", "textile"})
"""Families whose range covers their pores already, or that have none."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """One answer to what a part is.

    Parameters
    ----------
    material
        A name of the library.
    solid
        False for a body with pores or cavities that the mesh does not show.
    log_prior
        Logarithm of its share before any X-ray.
    mean_g_cm3, sd_g_cm3, low_g_cm3, high_g_cm3
        Density to be expected, and its bounds.
    """

    material: str
    solid: bool
    log_prior: float
    mean_g_cm3: float
    sd_g_cm3: float
    low_g_cm3: float
    high_g_cm3: float


@dataclass(frozen=True, slots=True, eq=False)
class CandidateTable:
    """Candidates of one part and their coefficients.

    Parameters
    ----------
    candidates
        The likeliest first.
    mac_cm2_g, scattering_cm2_g
        Shape (candidates, groups): attenuation, and the coherent and incoherent part of it.
    priors
        Shape (candidates, 4): mean, standard deviation, least and most density in g/cm³.
    log_prior
        Shape (candidates,).
    composition_sd
        Shape (candidates,): of the coefficients times the ways through the part, as a share.
    """

    candidates: tuple[Candidate, ...]
    mac_cm2_g: Float64[np.ndarray, "c groups"]
    scattering_cm2_g: Float64[np.ndarray, "c groups"]
    priors: Float64[np.ndarray, "c 4"]
    log_prior: Float64[np.ndarray, "c"]
    composition_sd: Float64[np.ndarray, "c"]

    @property
    def seen_priors(self) -> Float64[np.ndarray, "c 4"]:
        """Shape (candidates, 4): of the density that the images see, with coefficients that err."""
        mean, sd, low, high = self.priors.T
        off = self.composition_sd
        seen_sd = np.hypot(sd, off * mean)
        return np.stack([mean, seen_sd, low * (1 - 2 * off), high * (1 + 2 * off)], axis=1)

    def densities(self, seen_g_cm3: Float64[np.ndarray, "c"]) -> Float64[np.ndarray, "c"]:
        """Return the best density of each candidate of which the images see so much.

        What is seen off the usual density is shared out between density and coefficients by how
        far either scatters.
        """
        mean, sd, low, high = self.priors.T
        share = (sd / self.seen_priors[:, 1]) ** 2
        return np.asarray((mean + share * (seen_g_cm3 - mean)).clip(low, high))

    def density_sds(self, seen_sd_g_cm3: Float64[np.ndarray, "c"]) -> Float64[np.ndarray, "c"]:
        """Return how sure those are, if what the images see of each is as sure as told."""
        _, sd, _, _ = self.priors.T
        share = (sd / self.seen_priors[:, 1]) ** 2
        return np.asarray(np.sqrt(sd**2 * (1 - share) + (share * seen_sd_g_cm3) ** 2))

    def with_ways(self, way_sd: float) -> CandidateTable:
        """Return the same candidates of a part whose ways are off by such a share as well."""
        return replace(self, composition_sd=np.hypot(self.composition_sd, way_sd))

    @property
    def leading(self) -> Bool[np.ndarray, "c"]:
        """Which candidates are grades of the first one's base, solid or not as it is."""
        library, first = load_materials(), self.candidates[0]
        base = library[first.material].base
        return np.array(
            [
                library[each.material].base == base and each.solid == first.solid
                for each in self.candidates
            ]
        )


def candidate_table(
    part: CapturePart, groups: EnergyGroups, composition: float = 1.0
) -> CandidateTable:
    """Tabulate the candidates of a part; one table for all parts of the same label.

    Parameters
    ----------
    part
        With its label.
    groups
        Of energy.
    composition
        How far compositions may be off, as a multiple of what is usual.
    """
    return _table(part.material, part.hollow, groups, composition)


@lru_cache(maxsize=256)
def _table(label: str, hollow: bool, groups: EnergyGroups, composition: float) -> CandidateTable:
    found = candidates(label, hollow=hollow)
    materials = [load_materials()[each.material] for each in found]
    compositions = [each.composition for each in materials]
    return CandidateTable(
        found,
        np.stack([groups.mac_cm2_g(each) for each in compositions]),
        np.stack([groups.scattering_cm2_g(each) for each in compositions]),
        np.array(
            [(each.mean_g_cm3, each.sd_g_cm3, each.low_g_cm3, each.high_g_cm3) for each in found]
        ),
        np.array([each.log_prior for each in found]),
        composition * np.array([composition_sd(each) for each in materials]),
    )


@lru_cache(maxsize=256)
def candidates(label: str, *, hollow: bool = False) -> tuple[Candidate, ...]:
    """List what a part may be, the likeliest first.

    Parameters
    ----------
    label
        A name of the library, a family, or empty; annotators err, so that no material is out.
    hollow
        Whether the part was annotated so.

    Examples
    --------
    >>> first, second = candidates("peek")[:2]
    >>> first.material, first.solid, second.material, second.solid
    ('peek', True, 'peek', False)
    >>> round(sum(math.exp(each.log_prior) for each in candidates("metal")), 6)
    1.0
    """
    found = []
    for name, share in material_shares(label).items():
        material = load_materials()[name]
        if hollow:
            found.append(_hollow(material, share))
        elif material.family in NEVER_POROUS:
            found.append(_solid(material, share))
        else:
            found.append(_solid(material, share * (1 - POROUS_SHARE)))
            found.append(_porous(material, share * POROUS_SHARE))
    return tuple(sorted(found, key=lambda each: -each.log_prior))


def _solid(material: Material, share: float) -> Candidate:
    nominal = material.density_nominal_g_cm3
    sd = max(material.density_sd_g_cm3, LEAST_SD_SHARE * nominal)
    return Candidate(
        material.name,
        True,
        math.log(share),
        nominal,
        sd,
        max(material.density_low_g_cm3 - sd, 1e-4),
        material.density_high_g_cm3 + sd,
    )


def _porous(material: Material, share: float) -> Candidate:
    nominal = material.density_nominal_g_cm3
    return Candidate(
        material.name,
        False,
        math.log(share),
        POROUS_MEAN * nominal,
        POROUS_SD * nominal,
        POROUS_LEAST * nominal,
        nominal,
    )


def _hollow(material: Material, share: float) -> Candidate:
    nominal = material.density_nominal_g_cm3
    return Candidate(
        material.name,
        False,
        math.log(share),
        HOLLOW_USUAL * nominal,
        HOLLOW_SD * nominal,
        HOLLOW_LEAST * nominal,
        material.density_high_g_cm3,
    )
