"""How likely each material is before any X-ray: by its label, its rarity and the usual grades."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Mapping
from functools import cache, lru_cache
from importlib.resources import files
from types import MappingProxyType
from typing import Final

from xden1k.values.materials import Material, families, load_materials

__all__ = ["grade_shares", "material_shares"]

LABEL_RIGHT: Final = 0.92
SAME_FAMILY: Final = 0.06
"""Share of labels that name the material, and another one of its family: annotators err in about
one of twenty. The rest is spread over all."""
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


@lru_cache(maxsize=256)
def material_shares(label: str) -> Mapping[str, float]:
    """Share of each material among the parts of a label, by Bayes' rule; they add up to 1.

    Annotators write the base of a grade as they write any base, so that the label decides between
    the bases, and :func:`grade_shares` within each. A material of another family stands for its
    grades: what is improbable already is not divided further.

    Parameters
    ----------
    label
        A name of the library, a family, or empty; annotators err, so that no base is out.

    Examples
    --------
    >>> shares = material_shares("brass")
    >>> shares["brass"] > shares["brass_leaded"] > 10 * shares["bronze"]
    True
    """
    library = load_materials()
    said = library[label].base if label in library else label
    weights = {
        each.name: RARE.get(each.name, 1.0) * _said(said, each) for each in library.bases.values()
    }
    total = sum(weights.values())
    return MappingProxyType(
        {
            name: weight / total * share
            for base, weight in weights.items()
            for name, share in _divided(base, label).items()
        }
    )


@cache
def grade_shares() -> Mapping[str, Mapping[str, float]]:
    """Share of each base and its grades in everyday things, by base: ``grade_shares.csv``.

    Each row gives its reason. A base stands for all that no row describes: what the grades leave is
    its own.

    Examples
    --------
    >>> {name: round(share, 2) for name, share in grade_shares()["brass"].items()}
    {'brass': 0.65, 'brass_leaded': 0.35}
    >>> grade_shares()["gold"]
    {'gold': 1.0}
    """
    text = (files(__package__) / "grade_shares.csv").read_text(encoding="utf-8")
    found = {name: {name: 1.0} for name in load_materials().bases}
    for row in csv.DictReader(text.splitlines()):
        base, share = load_materials()[row["grade"]].base, float(row["share"])
        found[base][row["grade"]] = share
        found[base][base] -= share
    return found


def _divided(base: str, label: str) -> Mapping[str, float]:
    """Share of each grade that a base is told apart into, for a label."""
    library, shares = load_materials(), grade_shares()[base]
    if label and library[base].family != _family(label):
        return {base: 1.0}
    if label in shares and label != base:  # who writes a grade knows it
        return {
            name: (1 - LABEL_RIGHT) * share + LABEL_RIGHT * (name == label)
            for name, share in shares.items()
        }
    return shares


def _family(label: str) -> str:
    return label if label in families() else load_materials()[label].family


@lru_cache(maxsize=1)
def _family_sizes() -> Mapping[str, int]:
    return Counter(material.family for material in load_materials().bases.values())


def _said(label: str, material: Material) -> float:
    """Probability that an annotator says this label, which is no grade, of this base."""
    if not label:
        return 1.0
    astray = (1 - LABEL_RIGHT - SAME_FAMILY) / len(load_materials().bases)
    if label in families():
        return (LABEL_RIGHT + SAME_FAMILY) * (label == material.family) + astray
    if label == material.name:
        return LABEL_RIGHT
    alike = load_materials()[label].family == material.family
    return astray + alike * SAME_FAMILY / max(_family_sizes()[material.family] - 1, 1)
