"""How a dataset of the benchmark is made, and what comes of it, read from a frozen file."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any, Final

from xden1k.errors import DataError, did_you_mean
from xden1k.values.settings import load_settings
from xden_bench.scoring.protocol import load_protocol

__all__ = ["DATASETS", "Recipe", "draw_unseen", "load_recipe"]

DATASETS: Final = ("XDen-P2000",)
"""Every dataset there is."""


@dataclass(frozen=True, slots=True)
class Recipe:
    """How a dataset is made.

    Parameters
    ----------
    name
        Of the dataset.
    protocol
        The rules it is for, which name the categories of its split ``unseen``.
    maker
        Entry point of the group ``xden1k.makers``.
    settings
        Of the maker, but for those categories.
    splits
        Objects in each split.
    gigabytes
        Of the finished folder.
    seconds_an_object
        Processor time it takes to make one, as measured.
    versions
        Of the packages with which the checksums were made.
    manifest_sha256
        Checksum of its manifest; empty until it is known.
    """

    name: str
    protocol: str
    maker: str
    settings: Mapping[str, Any]
    splits: Mapping[str, int]
    gigabytes: float
    seconds_an_object: float
    versions: Mapping[str, str] = field(default_factory=dict)
    manifest_sha256: str = ""

    @property
    def objects(self) -> int:
        """How many there are."""
        return sum(self.splits.values())

    @property
    def unseen(self) -> tuple[str, ...]:
        """Categories that are in no split but ``unseen``."""
        return tuple(load_protocol(self.protocol).unseen_categories)


def load_recipe(name: str) -> Recipe:
    """Return a recipe by the name of its dataset.

    Raises
    ------
    DataError
        If there is none of that name.

    Examples
    --------
    >>> load_recipe("XDen-P2000").objects
    2000
    """
    if name not in DATASETS:
        raise DataError(
            f"no dataset {name!r}; there are {', '.join(DATASETS)}{did_you_mean(name, DATASETS)}"
        )
    with resources.as_file(resources.files(__package__ or "") / f"{name}.toml") as path:
        return load_settings(Recipe, Path(path))


def draw_unseen(dataset: str, categories: Iterable[str], count: int) -> tuple[str, ...]:
    """Draw the categories that are left out of training, in alphabetical order.

    Those whose SHA-256 of ``DATASET/CATEGORY`` is least: nobody chose them, and anyone draws them
    again.

    Examples
    --------
    >>> draw_unseen("XDen-P2000", ["fork", "hammer", "mug", "pot"], 2)
    ('fork', 'pot')
    """

    def checksum(category: str) -> bytes:
        return hashlib.sha256(f"{dataset}/{category}".encode()).digest()

    return tuple(sorted(sorted(categories, key=checksum)[:count]))
