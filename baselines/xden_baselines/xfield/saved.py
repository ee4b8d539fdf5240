"""Variants by name, and by what a folder holds. torch is imported by what needs it, not here."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from xden1k.errors import DataError
from xden_baselines.xfield import methods
from xden_baselines.xfield.methods import Predicting, Segmenting

__all__ = ["method_of", "saved_method"]


def method_of(name: str, **settings: Any) -> Segmenting:
    """Return a variant by its method's name.

    Parameters
    ----------
    name
        As ``xden-bench baseline`` takes it.
    settings
        Of the method.

    Raises
    ------
    DataError
        If there is none of that name, or a setting is unknown or out of its range.
    """
    kinds: dict[str, type[Segmenting]] = {
        kind.name: kind for kind in (getattr(methods, one) for one in methods.__all__)
    }
    if name not in kinds:
        raise DataError(f"no variant of X-Field {name!r}: expected one of {sorted(kinds)}")
    try:
        return kinds[name](**settings)
    except TypeError as err:
        raise DataError(f"{name}: {err}") from err


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
