"""Datasets of the benchmark that anyone makes alike: recipes, and checksums of what they give."""

from xden_bench.datasets.fingerprints import Difference, differences
from xden_bench.datasets.making import make_dataset
from xden_bench.datasets.recipe import DATASETS, Recipe, draw_unseen, load_recipe

__all__ = [
    "DATASETS",
    "Difference",
    "Recipe",
    "differences",
    "draw_unseen",
    "load_recipe",
    "make_dataset",
]
