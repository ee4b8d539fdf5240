"""How a method stands to its original: run as that is, from outside models alone, or not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from xden1k.errors import DataError
from xden_baselines.chat.settings import ChatSettings

__all__ = ["is_zero_shot", "lacking", "zero_shot_chat", "zero_shot_name"]


def is_zero_shot(setting: object) -> bool:
    """Return the setting ``zero_shot`` of a method.

    Raises
    ------
    DataError
        If it is neither true nor false.
    """
    if not isinstance(setting, bool):
        raise DataError(f"zero_shot must be true or false, got {setting!r}")
    return setting


def zero_shot_name(name: str) -> str:
    """Return the name of a method's rows in zero-shot mode.

    Examples
    --------
    >>> zero_shot_name("nerf2physics-style-thickness")
    'nerf2physics-zero-shot-thickness'
    """
    return name.replace("-style", "-zero-shot")


def zero_shot_chat(name: str, chat: ChatSettings) -> ChatSettings:
    """Return the chat model's settings with nobody who answers in its place.

    Raises
    ------
    DataError
        If no chat model is set.
    """
    if chat.mode == "off":
        raise DataError(f"{name}: zero_shot asks a chat model: set XDEN_VLM_MODE and what it needs")
    return replace(chat, fallback="none")


def lacking(original: str, parts: Mapping[str, bool]) -> str:
    """Say in a row's footnote which parts of its original a method lacks.

    Examples
    --------
    >>> lacking("NeRF2Physics", {"its NeRF": True, "CLIP": False, "captions": True})
    'NeRF2Physics without its NeRF, captions'
    """
    return f"{original} without {', '.join(part for part, lacks in parts.items() if lacks)}"
