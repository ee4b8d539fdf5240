"""Reading a release: tolerant about the names of files, strict about what is in them.

Reading order: ``roles`` (what a file is for, by its name), ``layout`` (which folder is an object),
``metadata`` (category and size), ``table`` (attenuation of parts), ``volume``, ``mesh``,
``item`` (one object as it is told), ``source`` (a folder, or the Hub), ``release`` (all objects).
"""

from xden_builder.published.reading.item import Item, read_item
from xden_builder.published.reading.release import (
    UNITS,
    Release,
    Unit,
    chosen_folders,
    open_release,
    unit_of,
)
from xden_builder.published.reading.roles import Roles, read_roles
from xden_builder.published.reading.source import FolderSource, HubSource, find_source

__all__ = [
    "UNITS",
    "FolderSource",
    "HubSource",
    "Item",
    "Release",
    "Roles",
    "Unit",
    "chosen_folders",
    "find_source",
    "open_release",
    "read_item",
    "read_roles",
    "unit_of",
]
