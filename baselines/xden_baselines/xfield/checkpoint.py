"""Reading a network that was saved."""

from __future__ import annotations

import json
from pathlib import Path

from xden1k.errors import DataError
from xden_baselines.learning.checkpoint import CONFIG_FILE, check_files, load_pretrained
from xden_baselines.xfield.network import XField

__all__ = ["load_model", "saved_variant"]

KEYS = {"variant", "size", "target", "format", "unit_g_cm3", "views"}


def load_model(folder: Path, variant: str) -> XField:
    """Read a checkpoint of a variant, to the CPU.

    Raises
    ------
    DataError
        If files are missing or damaged, a key is missing or unknown, or the variant, format, size,
        unit or views are others.
    """
    if (saved := saved_variant(folder)) != variant:
        path = folder / CONFIG_FILE
        raise DataError(f"{path}: expected the variant {variant!r}, got {saved!r}")
    return load_pretrained(folder, XField).eval()


def saved_variant(folder: Path) -> str:
    """Say of which variant a checkpoint is.

    Raises
    ------
    DataError
        If files are missing, or the configuration is damaged or has other keys.
    """
    check_files(folder)
    path = folder / CONFIG_FILE
    try:
        config = json.loads(path.read_text())
    except ValueError as err:
        raise DataError(f"{path}: not JSON: {err}") from err
    if not isinstance(config, dict) or (wrong := config.keys() ^ KEYS):
        raise DataError(f"{path}: expected the keys {sorted(KEYS)}, wrong are {sorted(wrong)}")
    return str(config["variant"])
