"""Datasets that anyone makes alike: by recipe, with checksums; and copies that are disturbed."""

from xden_bench.datasets.disturbing import chosen_splits, disturb
from xden_bench.datasets.fingerprints import Difference, differences
from xden_bench.datasets.making import make_dataset
from xden_bench.datasets.recipe import DATASETS, Recipe, draw_unseen, load_recipe

__all__ = [
    "DATASETS",
    "Difference",
    "Recipe",
    "chosen_splits",
    "differences",
    "disturb",
    "draw_unseen",
    "load_recipe",
    "make_dataset",
]
