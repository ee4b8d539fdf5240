"""Pixels that a person masked: a table, a holder, a number of lead on the panel."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from xden1k.errors import DataError
from xden1k.values.views import XRayView
from xden_builder.capture.calibration import CalibratedView, read_sized

__all__ = ["ignore_name", "masks", "refuse_other_masks", "without_ignored"]


def ignore_name(view: str) -> str:
    """Name of the mask of a view, beside its radiograph.

    Examples
    --------
    >>> ignore_name("pa")
    'ignore_pa.png'
    """
    return f"ignore_{view}.png"


def without_ignored(seen: CalibratedView, path: Path) -> CalibratedView:
    """Make the pixels that a mask marks invalid, as dead ones are.

    Parameters
    ----------
    seen
        The view.
    path
        Of an image of the radiograph's shape, not 0 where it is not to be looked at; need not
        exist.

    Raises
    ------
    DataError
        If it has another shape, or marks every pixel.
    """
    if not path.is_file():
        return seen
    view = seen.view
    marked = read_sized(path, view.geometry.shape, ", as the radiograph has").pixels != 0
    if not (view.valid & ~marked).any():
        raise DataError(f"{path}: marks every pixel; expected 0 where the radiograph is looked at")
    nothing = np.float32(np.nan)
    left = XRayView(
        view.name,
        np.where(marked, nothing, view.transmission),
        view.valid & ~marked,
        view.geometry,
    )
    at_least = seen.at_least
    if at_least is not None:
        at_least = np.where(marked, nothing, at_least)
        at_least = None if np.isnan(at_least).all() else at_least
    return replace(seen, view=left, at_least=at_least)


def masks(folder: Path) -> list[Path]:
    """Everything in an object's folder that is named as a mask, in any case."""
    return sorted(folder.glob("[iI][gG][nN][oO][rR][eE]_*"))


def refuse_other_masks(folder: Path, views: Iterable[str]) -> None:
    """Refuse a mask that nobody would look at, for its name, its format, or because it is no file.

    Parameters
    ----------
    folder
        Of an object.
    views
        Names of all that may have a mask.

    Raises
    ------
    DataError
        Naming the file, and what was expected.
    """
    names = [ignore_name(view) for view in views]
    for path in masks(folder):
        if path.name not in names:
            raise DataError(f"{path}: expected the name {_or(names, path.name)}")
        if not path.is_file():
            raise DataError(f"{path}: expected a file, got a folder or a broken link")


def _or(names: Sequence[str], like: str) -> str:
    """Return the name that differs in capitals alone, else all."""
    return next((name for name in names if name == like.lower()), " or ".join(names))
