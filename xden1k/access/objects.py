"""One object by its name, in one line."""

from __future__ import annotations

import os

from xden1k.access.hub import data_root
from xden1k.folder import open_folder
from xden1k.values.types import DensityObject

__all__ = ["open_object"]


def open_object(object_id: str, root: str | os.PathLike[str] | None = None) -> DensityObject:
    """Object of a dataset folder: views, parts with their meshes, fields.

    Whoever opens many objects does so faster with :func:`xden1k.open_folder`, whose files stay
    open.

    Parameters
    ----------
    object_id
        Its name, of any split; ``xden list`` shows all.
    root
        A dataset folder or a URL; None = as :func:`xden1k.data_root` finds it.

    Raises
    ------
    MissingObjectError
        If there is no such object; the nearest names are given.
    DataError
        If there is no such folder, or the object's row breaks the format.
    """
    return open_folder(data_root(root)).object(object_id)
