"""Archetypes: how each kind of object is built, one module for each family.

A module gives those it knows in its own ``ARCHETYPES``; a new module is found by being here.
"""

import pkgutil
from collections.abc import Mapping
from importlib import import_module
from typing import Final

from xden1k.errors import DataError
from xden_builder.phantoms.pieces import Archetype

__all__ = ["ARCHETYPES"]


def _of_all_modules() -> dict[str, Archetype]:
    found: dict[str, Archetype] = {}
    for module in pkgutil.iter_modules(__path__, f"{__name__}."):
        archetypes = import_module(module.name).ARCHETYPES
        if twice := sorted(found.keys() & archetypes.keys()):
            raise DataError(f"{module.name}: archetypes {twice} are in another module too")
        found |= archetypes
    return found


ARCHETYPES: Final[Mapping[str, Archetype]] = _of_all_modules()
"""By name; what follows a colon in a name is a variant, such as ``striker:mallet``."""
