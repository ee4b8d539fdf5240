"""Images of a release that someone has seen and said to be radiographs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from xden1k.errors import DataError
from xden1k.values.types import DensityObject
from xden_builder.capture import read_scanner
from xden_builder.capture.calibration import calibrate
from xden_builder.capture.scanner import DATASET_VIEWS
from xden_builder.published.reading import Item

__all__ = ["with_radiographs"]

NO_RADIOGRAPHS = "no_radiographs"


def with_radiographs(obj: DensityObject, item: Item, scanner: Path) -> DensityObject:
    """Give an object its radiographs; one that has neither image stays without.

    Parameters
    ----------
    obj
        The imported object, in the frame of its mesh, cm, z up.
    item
        Where its files are.
    scanner
        A ``scanner.toml``: of each view the name of its image in the object's folder, what its
        pixels hold, and the geometry in the object's frame.

    Raises
    ------
    DataError
        If the file lacks a view, or an image is missing or not what it says.
    """
    folder = item.root / item.folder.path
    told = read_scanner(scanner, folder)
    if missing := [name for name in DATASET_VIEWS if name not in told.views]:
        raise DataError(f"{scanner}: views.{missing[0]} is missing")
    stored = {name: told.views[name] for name in DATASET_VIEWS}
    if not any((folder / view.image).is_file() for view in stored.values()):
        return obj
    read = [
        calibrate(name, view, folder, scanner.parent, told.detector)
        for name, view in stored.items()
    ]
    kept = tuple(flag for flag in obj.flags if flag != NO_RADIOGRAPHS)
    more = tuple(flag for view in read for flag in view.flags)
    pa, lat = (view.view for view in read)
    return replace(obj, views=(pa, lat), flags=(*kept, *more))
