"""Make a dataset of the benchmark by whatever package has its maker."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Final, Protocol, cast, runtime_checkable

from xden1k.errors import MissingExtraError, install_command
from xden_bench.datasets.recipe import Recipe

__all__ = ["MAKERS", "Maker", "make_dataset"]

MAKERS: Final = "xden1k.makers"
"""Entry points of this group make datasets."""
EXTRA: Final = "build"
"""What the maker of phantoms needs beyond this package."""


@runtime_checkable
class Maker(Protocol):
    """Makes a dataset folder, which appears complete or not at all; resumable."""

    def __call__(
        self,
        settings: Mapping[str, Any],
        out: Path,
        *,
        workers: int,
        objects: slice,
        on_done: Callable[[str], None],
    ) -> None:
        """Make the folder; ``on_done`` is called with the id of each object that is there."""


def make_dataset(
    recipe: Recipe,
    out: Path,
    *,
    workers: int,
    objects: slice = slice(None),
    on_done: Callable[[str], None] = lambda _: None,
) -> None:
    """Make a dataset folder by its recipe.

    Parameters
    ----------
    recipe
        Of the dataset.
    out
        The folder; an older dataset folder is replaced as a whole.
    workers
        Number of processes.
    objects
        Only these, in the order in which they are drawn.
    on_done
        Called with the id of each object that is there.

    Raises
    ------
    MissingExtraError
        If no installed package has its maker, or that does not load.
    DataError
        If ``out`` is something else than a dataset folder.
    """
    settings = {**recipe.settings, "unseen": recipe.unseen}
    _maker(recipe)(settings, out, workers=workers, objects=objects, on_done=on_done)


def _maker(recipe: Recipe) -> Maker:
    found = {entry.name: entry for entry in entry_points(group=MAKERS)}
    try:
        return cast(Maker, found[recipe.maker].load())
    except (KeyError, ImportError) as err:
        raise MissingExtraError(
            f"making {recipe.name} needs the maker {recipe.maker}, which does not load ({err}): "
            f"{install_command(EXTRA)}"
        ) from err
