"""What a part may be made of, by the names it goes by."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from itertools import pairwise
from types import MappingProxyType
from typing import Final

import numpy as np

from xden1k.values.materials import FAMILY_WORDS, load_materials
from xden_builder.phantoms.catalogue import CATALOGUE
from xden_builder.phantoms.partnext.solids import role_of

__all__ = ["FILLERS", "RANDOM_SHARE", "draw_material", "materials_named", "usual_materials"]

RANDOM_SHARE: Final = 0.2
"""Of the kinds of parts: any material, whatever the name, lest names tell too much."""
FILLERS: Final = ("cardboard", "cotton_fabric", "foam_eps", "foam_eva_pu", "foam_organic")
"""What loosely fills a room."""
_NO_SOLID: Final = frozenset({"gas", "liquid", "tissue"})


@cache
def usual_materials() -> tuple[str, ...]:
    """Return the solid materials that simulated objects are made of, sorted."""
    named = {
        name for kind in CATALOGUE for names in kind.materials.values() for name in names.split()
    }
    known = load_materials()
    return tuple(sorted(name for name in named if known[name].family not in _NO_SOLID))


@cache
def _of_roles() -> Mapping[str, tuple[str, ...]]:
    """By role of a simulated part: every solid material that it is made of."""
    found: dict[str, set[str]] = {}
    for kind in CATALOGUE:
        for role, names in kind.materials.items():
            found.setdefault(role, set()).update(set(names.split()) & set(usual_materials()))
    return MappingProxyType({role: tuple(sorted(names)) for role, names in found.items() if names})


def materials_named(names: Sequence[str]) -> tuple[str, ...]:
    """List the materials that a part's names speak of; none where they tell nothing.

    A name speaks of a material of the library, of a family, or of a role of simulated objects, in
    this order; of the words of a name the last one that does decides, of the names the first.

    Parameters
    ----------
    names
        The part's own, then those of what it belongs to.

    Examples
    --------
    >>> materials_named(["Brass Knob", "Door"])
    ('brass',)
    >>> "wood_oak" in materials_named(["Wooden Leg"]), materials_named(["Gizmo"])
    (True, ())
    """
    for name in names:
        for told in _told_by(name):
            return told
    return ()


def _told_by(name: str) -> Iterator[tuple[str, ...]]:
    words = role_of(name).split("_")
    pairs = ["_".join(pair) for pair in pairwise(words)]
    spoken = [form for word in reversed([*words, *pairs]) for form in _forms(word)]
    known = load_materials()
    for word in spoken:
        if word in known and known[word].family not in _NO_SOLID and not known[word].grade_of:
            yield (known[word].name,)
    for word in spoken:
        family = FAMILY_WORDS.get(word, word)
        if found := tuple(one for one in usual_materials() if known[one].family == family):
            yield found
    for word in spoken:
        if word in _of_roles():
            yield _of_roles()[word]


def _forms(word: str) -> Iterator[str]:
    """Give a word, without the ending of a plural, or of what is made of something."""
    yield word
    for ending in ("s", "es", "en"):
        if len(word) > len(ending) + 2 and word.endswith(ending):
            yield word.removesuffix(ending)


def draw_material(rng: np.random.Generator, choices: Sequence[str]) -> str:
    """Draw a material of some choices, or of all usual ones: without choices, and now and then.

    The same random numbers are used up whatever comes of it.
    """
    chance, pick = rng.random(), rng.random()
    among = choices if choices and chance >= RANDOM_SHARE else usual_materials()
    return among[int(pick * len(among))]
