"""The methods that are installed."""

from __future__ import annotations

import inspect
import re
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from xden1k.errors import DataError, did_you_mean
from xden1k.predictor import Illustrated, Method, PictureSource, Predictor, Segmenter
from xden1k.values.modality import Modality, track_of
from xden_bench.methods.running import Options, Report, run_predictor

__all__ = [
    "Listed",
    "Options",
    "Report",
    "builtin_names",
    "find_method",
    "find_pictures",
    "find_predictor",
    "list_predictors",
    "run_predictor",
]

PREDICTORS = "xden1k.predictors"
"""Entry points of this group name methods."""
PICTURES = "xden1k.pictures"
"""Of this one, sources of pictures: ``scenes`` is called with a folder, any other, such as
``flat``, without arguments."""
SCENES, DEFAULT_PICTURES = "scenes", "shaded"
_UNKNOWN_SETTING = re.compile(r"unexpected keyword argument '(\w+)'")


@dataclass(frozen=True, slots=True)
class Listed:
    """A method that is installed.

    Parameters
    ----------
    name
        What ``xden-bench baseline`` calls it.
    track
        Where it runs; ``-`` if it does not load.
    gives
        ``densities``, ``segments``, or both; ``-`` if it does not load.
    summary
        First line of its docstring, or why it does not load.
    """

    name: str
    track: str
    gives: str
    summary: str


def list_predictors() -> tuple[Listed, ...]:
    """Every installed method, by name."""
    return tuple(map(_listed, sorted(_entries(PREDICTORS))))


def _listed(name: str) -> Listed:
    try:
        method = find_method(name)
    except DataError as err:
        return Listed(name, "-", "-", str(err))
    oracle = "oracle: " if (Modality.TRUTH | Modality.MATERIALS) & method.reads else ""
    summary = (inspect.getdoc(method) or "").split("\n")[0].removeprefix("Oracle of ")
    kinds = {"densities": Predictor, "segments": Segmenter}
    gives = " and ".join(name for name, kind in kinds.items() if isinstance(method, kind))
    return Listed(name, track_of(method.reads), gives, oracle + summary)


def find_method(name: str, settings: Mapping[str, Any] | None = None) -> Predictor | Segmenter:
    """Return an installed method by the name of its entry point.

    Parameters
    ----------
    name
        Of the entry point.
    settings
        Keyword arguments it is made with.

    Raises
    ------
    DataError
        If there is none of that name, it cannot be imported or made, or it is no method.
    """
    entries = _entries(PREDICTORS)
    if name not in entries:
        near = did_you_mean(name, entries) or "; xden-bench baseline --list shows those that are"
        raise DataError(f"no method {name!r} is installed{near}")
    try:
        method = entries[name].load()(**(settings or {}))
    except DataError as err:  # what it was told does not suit it
        raise DataError(f"{name}: {str(err).removeprefix(f'{name}: ')}") from err
    except (ImportError, AttributeError, TypeError, ValueError) as err:
        if settings and (found := _UNKNOWN_SETTING.search(str(err))):
            raise DataError(f"{name} has no setting {found[1]!r}") from err
        raise DataError(f"the method {name} ({entries[name].value}) does not load: {err}") from err
    if not isinstance(method, Predictor | Segmenter):
        raise DataError(f"the method {name} ({entries[name].value}) is no xden1k Predictor")
    return method


def find_predictor(name: str, settings: Mapping[str, Any] | None = None) -> Predictor:
    """Return an installed method of densities.

    Raises
    ------
    DataError
        As :func:`find_method`, or if it gives segments alone.
    """
    method = find_method(name, settings)
    if not isinstance(method, Predictor):
        raise DataError(f"the method {name} gives segments, no densities")
    return method


def find_pictures(
    predictor: Method, views: Path | None, pictures: str | None = None
) -> PictureSource | None:
    """Return where a method's colour pictures come from; None if it reads none.

    Parameters
    ----------
    predictor
        The method.
    views
        A folder of scenes, if the pictures are there.
    pictures
        Name of an installed source that draws them. Where neither is given, the method's own
        source, or else ``DEFAULT_PICTURES``.

    Raises
    ------
    DataError
        If both are given, or one but the method reads none, the folder holds none, or no such
        source is installed.
    """
    asked = views is not None or pictures is not None
    if Modality.RGB not in predictor.reads:
        if asked:
            raise DataError(f"the method {predictor.name} reads no pictures: no views, no pictures")
        return None
    if not asked and isinstance(predictor, Illustrated):
        return predictor.pictures_of
    return _source(views, pictures)


def _source(views: Path | None, pictures: str | None) -> PictureSource:
    """Make the source of pictures that is asked for."""
    if pictures == SCENES or (views is not None and pictures is not None):
        raise DataError(
            "pictures are either those of a folder of scenes (--views) or drawn (--pictures), "
            f"got {views} and {pictures}"
        )
    name = SCENES if views is not None else pictures or DEFAULT_PICTURES
    entries = _entries(PICTURES)
    if name not in entries:
        raise DataError(f"no source of pictures {name!r} is installed; there are {sorted(entries)}")
    source: PictureSource = entries[name].load()(*([] if views is None else [views]))
    return source


def builtin_names() -> tuple[str, ...]:
    """Names of the methods that this package brings, sorted; those of plugins are their own."""
    found = _entries(PREDICTORS).values()
    return tuple(sorted(one.name for one in found if one.dist and one.dist.name == "xden1k"))


def _entries(group: str) -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in entry_points(group=group)}
