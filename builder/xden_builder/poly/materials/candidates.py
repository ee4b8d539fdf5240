"""What a part may be made of, how likely each is before any X-ray, and how dense it can be."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import Final

import numpy as np
from jaxtyping import Float64

from xden1k.values.materials import Material, families, load_materials
from xden_builder.capture import CapturePart
from xden_builder.physics.groups import EnergyGroups
from xden_builder.poly.materials.composition import composition_sd

__all__ = ["Candidate", "CandidateTable", "candidate_table", "candidates"]

LABEL_RIGHT: Final = 0.92
SAME_FAMILY: Final = 0.06
"""Share of labels that name the material, and another one of its family: annotators err in about
one of twenty. The rest is spread over all."""
POROUS_SHARE: Final = 0.15
"""Of mouldings, castings and other bodies that are foamed or have pores."""
POROUS_MEAN: Final = 0.68
POROUS_SD: Final = 0.19
POROUS_LEAST: Final = 0.2
"""Density of a porous body as shares of the solid's: structural foam has a third and more of it."""
HOLLOW_MEAN: Final = 0.8
HOLLOW_SD: Final = 0.35
HOLLOW_LEAST: Final = 0.05
"""Of a part annotated as hollow, whose mesh holds more space than material."""
LEAST_SD_SHARE: Final = 0.01
"""The densities of no material are known better."""
NEVER_POROUS: Final = frozenset({"metal", "glass", "liquid", "foam", "gas", "composite", "textile"})
"""Families whose range covers their pores already, or that have none."""
RARE: Final = MappingProxyType(
    dict.fromkeys(
        [
            "antimony",
            "bismuth",
            "cobalt",
            "gold",
            "indium",
            "lithium",
            "manganese",
            "mercury",
            "molybdenum",
            "platinum",
            "tantalum",
            "tungsten",
            "chromium",
            "air",
            "bone_cortical",
            "soft_tissue",
            "dentine",
            "enamel",
        ],
        0.01,
    )
    | dict.fromkeys(
        [
            "silver",
            "lead",
            "tin",
            "magnesium",
            "nickel",
            "zinc",
            "tungsten_carbide",
            "solder_sac305",
            "solder_tin_lead",
            "magnet_ndfeb",
            "ferrite",
            "glass_lead",
            "zirconia",
            "titanium",
            "titanium_6al_4v",
            "magnesium_az91",
            "silicon",
            "peek",
            "alumina",
            "glass_quartz",
        ],
        0.1,
    )
)
"""Materials that everyday things are seldom made of, and their weight beside the usual 1."""


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
        Shape (candidates,): of the coefficients, as a share of them.
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


def candidate_table(part: CapturePart, groups: EnergyGroups) -> CandidateTable:
    """Tabulate the candidates of a part; one table for all parts of the same label."""
    return _table(part.material, part.hollow, groups)


@lru_cache(maxsize=256)
def _table(label: str, hollow: bool, groups: EnergyGroups) -> CandidateTable:
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
        np.array([composition_sd(each) for each in materials]),
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
    >>> first, second = candidates("abs")[:2]
    >>> first.material, first.solid, second.material, second.solid
    ('abs', True, 'abs', False)
    >>> round(sum(math.exp(each.log_prior) for each in candidates("metal")), 6)
    1.0
    """
    found = []
    for name, share in _shares(label).items():
        material = load_materials()[name]
        if hollow:
            found.append(_hollow(material, share))
        elif material.family in NEVER_POROUS:
            found.append(_solid(material, share))
        else:
            found.append(_solid(material, share * (1 - POROUS_SHARE)))
            found.append(_porous(material, share * POROUS_SHARE))
    return tuple(sorted(found, key=lambda each: -each.log_prior))


def _shares(label: str) -> Mapping[str, float]:
    """Share of each material before any X-ray, by Bayes' rule; they add up to 1."""
    library = load_materials()
    usual = {name: RARE.get(name, 1.0) for name in library}
    weights = {name: usual[name] * _said(label, library[name]) for name in library}
    total = sum(weights.values())
    return {name: weight / total for name, weight in weights.items()}


@lru_cache(maxsize=1)
def _family_sizes() -> Mapping[str, int]:
    return Counter(material.family for material in load_materials().values())


def _said(label: str, material: Material) -> float:
    """Probability that an annotator says this label of this material."""
    if not label:
        return 1.0
    astray = (1 - LABEL_RIGHT - SAME_FAMILY) / len(load_materials())
    if label in families():
        return (LABEL_RIGHT + SAME_FAMILY) * (label == material.family) + astray
    if label == material.name:
        return LABEL_RIGHT
    alike = load_materials()[label].family == material.family
    return astray + alike * SAME_FAMILY / max(_family_sizes()[material.family] - 1, 1)


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
        HOLLOW_MEAN * nominal,
        HOLLOW_SD * nominal,
        HOLLOW_LEAST * nominal,
        material.density_high_g_cm3,
    )
