"""Files of a capture folder, as simulators write them."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt16

from xden1k.errors import require
from xden1k.values.arrays import Image

__all__ = ["write_image", "write_json", "write_table"]


def write_image(path: Path, image: UInt16[np.ndarray, "rows columns"] | Image) -> None:
    """Write a TIFF: counts, or transmission."""
    require("tifffile", "build").imwrite(path, image, compression="zlib", metadata=None)


def write_json(path: Path, values: Mapping[str, Any]) -> None:
    """Write values of JSON's types, to be read by people too."""
    path.write_text(json.dumps(values, indent=2) + "\n", encoding="utf-8")


def write_table(path: Path, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Write a CSV table."""
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([header, *rows])
