"""Names of materials as vectors: near for names that share letters or a family.

A stand-in for a language model's text features. Names that the material library knows take its
spelling and its family, so ``Polypropylene`` and ``pp`` are one; any other name still gets a
vector, from its letters.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import cache

import numpy as np
from jaxtyping import Float32

from xden1k.values.materials import families, load_materials

__all__ = ["NAME_FEATURES", "embed_names"]

NAME_FEATURES = 128
FAMILY_WEIGHT = 0.65
"""Two materials of one family whose names have nothing in common are 0.3 apart in cosine from
strangers: 0.65² / (1 + 0.65²)."""


def embed_names(names: Sequence[str]) -> Float32[np.ndarray, "names 128"]:
    """Return a unit vector for each name.

    Examples
    --------
    >>> pp, same, pet, oak = embed_names(["pp", "Polypropylene", "pet", "oak wood"])
    >>> float(pp @ same) > 0.999, bool(pp @ pet > pp @ oak)
    (True, True)
    """
    return np.stack([_embed(name) for name in names])


@cache
def _embed(name: str) -> Float32[np.ndarray, "128"]:
    spelt, family = _in_library("_".join(name.lower().replace("-", " ").split()))
    padded = f"_{spelt}_"
    letters = sum(_hashed(padded[at : at + 3]) for at in range(len(padded) - 2))
    vector = np.asarray(letters) / np.linalg.norm(letters)
    if family:
        vector = vector + FAMILY_WEIGHT * _hashed(f"family {family}")
    return np.asarray(vector / np.linalg.norm(vector), dtype=np.float32)


def _in_library(name: str) -> tuple[str, str]:
    """Return the library's spelling of a name and its family; empty if it has none."""
    library = load_materials()
    if name in library:
        return library[name].name, library[name].family
    return name, name if name in families() else ""


@cache
def _hashed(token: str) -> np.ndarray:
    """Return a unit vector of random signs that any machine draws alike."""
    bits = hashlib.blake2b(token.encode(), digest_size=NAME_FEATURES // 8).digest()
    signs = 2.0 * np.unpackbits(np.frombuffer(bits, dtype=np.uint8)) - 1
    return np.asarray(signs / np.sqrt(NAME_FEATURES))
