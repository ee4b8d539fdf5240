"""Where CLIP's weights lie, if there are any."""

from __future__ import annotations

import os
from pathlib import Path

from xden1k.errors import DataError
from xden_baselines.features.encoder import PatchEncoder

__all__ = [
    "CLIP_VARIABLE",
    "HOW_TO_NAME_CLIP",
    "clip_folder",
    "clip_sha256",
    "clip_source",
    "open_clip",
]

CLIP_VARIABLE = "XDEN_CLIP"
"""Environment variable that names a folder with CLIP's weights."""
HOW_TO_NAME_CLIP = f"name the folder of its weights by {CLIP_VARIABLE} or by --set clip=FOLDER"


def clip_folder(given: object) -> str:
    """Return the folder that a method was given, else the environment's; empty for none.

    Raises
    ------
    DataError
        If what was given is no text: ``--set clip=7`` is a number.
    """
    if given is not None and not isinstance(given, str):
        raise DataError(f"clip must be the name of a folder, got {given!r}: write ./{given}")
    return os.environ.get(CLIP_VARIABLE, "") if given is None else given


def open_clip(folder: str, device: str = "cpu") -> PatchEncoder:
    """Load CLIP; its features are kept in the user's cache.

    Raises
    ------
    DataError
        If the folder holds none, or there is no such device.
    MissingExtraError
        If ``transformers`` is not installed.
    """
    from xden_baselines.features.clip import ClipEncoder
    from xden_baselines.features.kept import KeptFeatures, feature_cache

    return KeptFeatures(ClipEncoder(Path(folder), device=device), feature_cache())


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


def clip_source(folder: str) -> str:
    """Return what a row calls the weights in a folder.

    Raises
    ------
    DataError
        If the folder holds none.
    """
    return f"CLIP {Path(folder).name} {clip_sha256(folder)[:12]}"
