"""Taking up whichever variant a folder holds. torch is imported by what needs it, not here."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from xden1k.errors import DataError
from xden_baselines.xfield.methods import Predicting

__all__ = ["saved_method"]


def saved_method(folder: Path, **settings: Any) -> Predicting:
    """Take up whichever variant a folder holds.

    Parameters
    ----------
    folder
        Written by ``save``.
    settings
        ``threads`` and ``device`` of :class:`Settings`.

    Raises
    ------
    DataError
        If the folder holds no checkpoint, or one of a variant that gives no densities.
    """
    from xden_baselines.xfield.checkpoint import saved_variant

    predicting = {kind.variant: kind for kind in Predicting.__subclasses__()}
    variant = saved_variant(folder)
    if variant not in predicting:
        raise DataError(
            f"{folder}: expected a variant that gives densities ({', '.join(sorted(predicting))}), "
            f"got {variant!r}"
        )
    method = predicting[variant](**settings)
    method.load(folder)
    return method
