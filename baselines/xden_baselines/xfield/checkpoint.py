"""Reading a network that was saved."""

from __future__ import annotations

import json
from pathlib import Path

import torch

from xden1k.errors import DataError
from xden_baselines.learning.checkpoint import (
    CONFIG_FILE,
    WEIGHTS_FILE,
    check_files,
    load_pretrained,
)
from xden_baselines.xfield.network import XField

__all__ = ["load_model", "saved_variant"]

KEYS = {"variant", "size", "target", "format", "unit_g_cm3", "views"}


def load_model(folder: Path, variant: str) -> XField:
    """Read a checkpoint of a variant, to the CPU.

    Raises
    ------
    DataError
        If files are missing or damaged, a key is missing or unknown, the variant, format, size,
        unit or views are others, or a weight is no finite number.
    """
    if (saved := saved_variant(folder)) != variant:
        path = folder / CONFIG_FILE
        raise DataError(f"{path}: expected the variant {variant!r}, got {saved!r}")
    model = load_pretrained(folder, XField).eval()
    for name, weights in model.state_dict().items():
        if not torch.isfinite(weights).all():
            path = folder / WEIGHTS_FILE
            raise DataError(f"{path}: expected finite numbers, {name} has others")
    return model


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
    except (ValueError, RecursionError) as err:
        raise DataError(f"{path}: not JSON: {err}") from err
    if not isinstance(config, dict):
        raise DataError(f"{path}: expected the keys {sorted(KEYS)}, got {config!r:.60}")
    if wrong := config.keys() ^ KEYS:
        raise DataError(f"{path}: expected the keys {sorted(KEYS)}, wrong are {sorted(wrong)}")
    return str(config["variant"])
