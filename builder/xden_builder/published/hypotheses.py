"""What a part of which nothing but its name is known may be, and how dense: before any X-ray."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from types import MappingProxyType
from typing import Final

import numpy as np
from jaxtyping import Float64, Int64

from xden1k.values.materials import load_materials
from xden_builder.poly.materials.candidates import Candidate, candidates

__all__ = ["Hypotheses", "families_of", "hypotheses", "log_prior", "usual_families"]

FAMILY_SHARES: Final = MappingProxyType(
    {
        "polymer": 0.34,
        "metal": 0.24,
        "elastomer": 0.07,
        "wood": 0.07,
        "composite": 0.05,
        "glass": 0.05,
        "ceramic": 0.05,
        "paper": 0.03,
        "textile": 0.03,
        "foam": 0.03,
        "liquid": 0.03,
        "mineral": 0.01,
    }
)
"""Of the parts of everyday things (assumed); families that are not here are not tried."""
USUAL: Final = MappingProxyType(
    {
        **dict.fromkeys(("steel", "stainless_steel_304", "aluminium"), 6.0),
        **dict.fromkeys(("brass", "zamak_3"), 3.0),
        **dict.fromkeys(("pp", "pe", "hdpe", "ps", "abs", "pvc_soft", "pvc_rigid"), 3.0),
    }
)
"""What everyday things of metal and plastic are made of most, and its weight beside 1 of the others
of its family (assumed)."""
USUAL_G: Final = 1000.0
LIGHTER: Final = 2.0
"""Mass from which parts of what people own and scan become rarer, and the power with which they do
(Lomax's distribution without its norm; assumed): a large body is rather foam or water than steel,
whose attenuation looks alike where hardly a ray comes through, but a kettlebell is possible."""
METAL_ALONE: Final = frozenset({"metal"})
"""Families of a name, or else of a category, whose parts are not taken for lighter ones for being
heavy."""
USUAL_CM3: Final = 20.0
SMALL_DENSER: Final = 0.1
"""Power of volume with which density falls (assumed): small parts are rather screws, springs and
contacts, large ones rather wood and cloth."""
AGAINST: Final = 0.12
AGAINST_CLEAR: Final = 0.03
"""Weight of a family that a part's name speaks against, beside 1; the second where the name speaks
for one family alone."""
IN_CATEGORY: Final = 5.0
"""Weight of a family that an object's category is often made of, beside 1 (assumed)."""
NODES_NARROW: Final = 3
NODES_WIDE: Final = 7
"""Densities that stand for a candidate's range."""
NARROW: Final = 0.06
"""Standard deviation, as a share, up to which three densities do."""
WIDTH_SD: Final = 1.5
"""How far from the mean they reach, in standard deviations."""


@dataclass(frozen=True, slots=True, eq=False)
class Hypotheses:
    """Pairs of a material and a density.

    Parameters
    ----------
    names
        Materials.
    material
        Shape (h,): index of each hypothesis's material.
    density_g_cm3
        Shape (h,).
    log_prior
        Shape (h,): logarithm of its share.
    lighter
        Power with which heavier parts become rarer.
    """

    names: tuple[str, ...]
    material: Int64[np.ndarray, "h"]
    density_g_cm3: Float64[np.ndarray, "h"]
    log_prior: Float64[np.ndarray, "h"]
    lighter: float = LIGHTER


@cache
def hypotheses(
    families: frozenset[str] = frozenset(), usual: frozenset[str] = frozenset()
) -> Hypotheses:
    """List what a part may be.

    Parameters
    ----------
    families
        That its name speaks for; empty: it says nothing.
    usual
        That things of the object's category are often made of.

    Examples
    --------
    >>> round(float(np.exp(hypotheses().log_prior).sum()), 6)
    1.0
    """
    library = load_materials()
    tried = [each for each in candidates("") if library[each.material].family in FAMILY_SHARES]
    of_family: dict[str, float] = dict.fromkeys(FAMILY_SHARES, 0.0)
    for each in tried:
        of_family[library[each.material].family] += _share(each)
    names = tuple(dict.fromkeys(each.material for each in tried))
    rows = []
    against = AGAINST_CLEAR if len(families) == 1 else AGAINST
    for each in tried:
        family = library[each.material].family
        weight = against if families and family not in families else 1.0
        weight *= IN_CATEGORY if family in usual else 1.0
        share = weight * FAMILY_SHARES[family] * _share(each) / of_family[family]
        rows += [(names.index(each.material), rho, share * part) for rho, part in _nodes(each)]
    material, density, share = np.array(rows).T
    return Hypotheses(
        names,
        material.astype(np.int64),
        density,
        np.log(share / share.sum()),
        lighter=0.0 if (families or usual) == METAL_ALONE else LIGHTER,
    )


def _share(candidate: Candidate) -> float:
    """Share of a candidate among those of its family, up to a factor."""
    return math.exp(candidate.log_prior) * USUAL.get(candidate.material, 1.0)


def log_prior(tried: Hypotheses, volume_cm3: float) -> Float64[np.ndarray, "h"]:
    """Logarithm of the share of each hypothesis among parts of a volume.

    Examples
    --------
    >>> tried = hypotheses()
    >>> means = [np.exp(log_prior(tried, cm3)) @ tried.density_g_cm3 for cm3 in (1.0, 1000.0)]
    >>> bool(means[0] > means[1])
    True
    """
    mass_g = tried.density_g_cm3 * volume_cm3
    heavier = tried.lighter * np.log1p(mass_g / USUAL_G)
    denser = SMALL_DENSER * np.log(tried.density_g_cm3) * np.log(volume_cm3 / USUAL_CM3)
    weight = tried.log_prior - heavier - denser
    return np.asarray(weight - np.logaddexp.reduce(weight))


def _nodes(candidate: Candidate) -> list[tuple[float, float]]:
    """Densities of a candidate, with their shares of it."""
    narrow = candidate.sd_g_cm3 < NARROW * candidate.mean_g_cm3
    steps = np.linspace(-WIDTH_SD, WIDTH_SD, NODES_NARROW if narrow else NODES_WIDE)
    densities = candidate.mean_g_cm3 + candidate.sd_g_cm3 * steps
    densities = densities.clip(candidate.low_g_cm3, candidate.high_g_cm3)
    weights = np.exp(-(steps**2) / 2)
    return list(zip(densities.tolist(), (weights / weights.sum()).tolist(), strict=True))


@cache
def _words(table: str) -> Mapping[str, frozenset[str]]:
    text = (files(__package__) / table).read_text(encoding="utf-8")
    rows = csv.DictReader(text.splitlines())
    return {row["word"]: frozenset(row["families"].split()) for row in rows}


def families_of(name: str) -> frozenset[str]:
    """Families that the words of a part's name speak for: ``words.csv``; none if it says nothing.

    Examples
    --------
    >>> sorted(families_of("Saw_Blade-2")), sorted(families_of("part_3"))
    (['metal'], [])
    """
    return _families(name, "words.csv")


def usual_families(category: str) -> frozenset[str]:
    """Families that things of a category are often made of, in whole or in part.

    Read from ``categories.csv``; none where it says nothing.

    Examples
    --------
    >>> sorted(usual_families("kettlebell")), sorted(usual_families("power_bank"))
    (['metal'], ['composite'])
    """
    return _families(category, "categories.csv")


def _families(name: str, table: str) -> frozenset[str]:
    """Families of all words of a name, of which several may be meant.

    Examples
    --------
    >>> sorted(_families("blades", "words.csv")), sorted(_families("glass", "words.csv"))
    (['metal'], ['glass', 'polymer'])
    """
    known = _words(table)
    words = re.findall("[a-z]+", name.lower())
    return frozenset().union(
        *(known.get(word, known.get(word.removesuffix("s"), ())) for word in words)
    )
