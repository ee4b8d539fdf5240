"""Reading what a trained method was saved as, with every damage a DataError."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from contextlib import redirect_stdout
from pathlib import Path

from safetensors import SafetensorError

from xden1k.errors import DataError
from xden_baselines.pixie.model import VoxelModel
from xden_baselines.pixie.training import FitReport

__all__ = ["check_files", "load_model", "load_report"]

FILES = ("config.json", "model.safetensors")


def check_files(folder: Path) -> None:
    """Refuse a folder without a checkpoint; the Hub's mixin would take it for a repository's name.

    Raises
    ------
    DataError
        If a file is missing.
    """
    if missing := [name for name in FILES if not (folder / name).is_file()]:
        raise DataError(f"{folder}: no checkpoint there, {' and '.join(missing)} missing")


def load_model(folder: Path, names: Sequence[str]) -> VoxelModel:
    """Read a checkpoint of a network that sees these channels, to the CPU.

    Raises
    ------
    DataError
        If files are missing or damaged, or its network sees other channels.
    """
    check_files(folder)
    try:
        with redirect_stdout(io.StringIO()):  # the Hub's mixin tells whence it loads
            model = VoxelModel.from_pretrained(folder, map_location="cpu", strict=True)
    except (SafetensorError, RuntimeError, TypeError, ValueError) as err:
        raise DataError(f"{folder}: the checkpoint cannot be read: {err}") from err
    if model.channels != tuple(names):
        raise DataError(
            f"{folder}: its network sees {list(model.channels)}, expected {list(names)}"
        )
    return model.eval()


def load_report(path: Path) -> FitReport:
    """Read how the training went.

    Raises
    ------
    DataError
        If the file is missing or damaged.
    """
    try:
        values = json.loads(path.read_text())
        curve = tuple(values.pop("held_out_mae_g_cm3"))
        return FitReport(**values, held_out_mae_g_cm3=curve)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as err:
        raise DataError(f"{path}: no training report: {err}") from err
