"""Pictures of several objects on one page: what a person looks at before a method does."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from xden1k.errors import DataError
from xden1k.folder import DatasetFolder
from xden_baselines.views.source import RenderedPhantoms

__all__ = ["page_of", "write_page"]

QUALITY = 85
"""Of JPEG."""


def page_of(
    folder: DatasetFolder, object_ids: Sequence[str], source: RenderedPhantoms
) -> UInt8[np.ndarray, "rows columns 3"]:
    """Return one row for each object, all its views side by side.

    Raises
    ------
    DataError
        If no object is named, or one cannot be drawn.
    MissingObjectError
        If there is no such object.
    """
    if not object_ids:
        raise DataError("a page needs at least one object, got none")
    rows = [np.hstack(list(source(folder, name).colors)) for name in object_ids]
    return np.vstack(rows)


def write_page(page: UInt8[np.ndarray, "rows columns 3"], path: Path, *, width_px: int) -> None:
    """Write a page as a picture of this width, of the kind that its name says.

    Raises
    ------
    DataError
        If the name says none, the file cannot be written, or the width is no width.
    """
    height_px = round(page.shape[0] * width_px / page.shape[1])
    try:
        shrunk = Image.fromarray(page).resize((width_px, height_px), Image.Resampling.LANCZOS)
        shrunk.save(path, quality=QUALITY)
    except (OSError, ValueError) as err:
        raise DataError(f"{path}: {err}") from err
