"""Reading the network of a trained method."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from xden1k.errors import DataError
from xden_baselines.learning.checkpoint import load_pretrained
from xden_baselines.pixie.model import VoxelModel

__all__ = ["load_model"]


def load_model(folder: Path, names: Sequence[str]) -> VoxelModel:
    """Read a checkpoint of a network that sees these channels, to the CPU.

    Raises
    ------
    DataError
        If files are missing or damaged, or its network sees other channels.
    """
    model = load_pretrained(folder, VoxelModel)
    if model.channels != tuple(names):
        raise DataError(
            f"{folder}: its network sees {list(model.channels)}, expected {list(names)}"
        )
    return model.eval()
