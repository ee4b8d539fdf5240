"""Where CLIP's weights lie, if there are any."""

from __future__ import annotations

import os
from pathlib import Path

from xden_baselines.features.encoder import PatchEncoder

__all__ = ["CLIP_VARIABLE", "clip_folder", "clip_sha256", "open_clip"]

CLIP_VARIABLE = "XDEN_CLIP"
"""Environment variable that names a folder with CLIP's weights."""


def clip_folder(given: str | None) -> str:
    """Return the folder that a method was given, else the environment's; empty for none."""
    return os.environ.get(CLIP_VARIABLE, "") if given is None else given


def open_clip(folder: str, device: str = "cpu") -> PatchEncoder:
    """Load CLIP.

    Raises
    ------
    DataError
        If the folder holds none.
    MissingExtraError
        If ``transformers`` is not installed.
    """
    from xden_baselines.features.clip import ClipEncoder

    return ClipEncoder(Path(folder), device=device)


def clip_sha256(folder: str) -> str:
    """SHA-256 of the weights; empty for none.

    Raises
    ------
    DataError
        If the folder holds none.
    """
    if not folder:
        return ""
    from xden_baselines.features.clip import weights_sha256

    return weights_sha256(Path(folder))
