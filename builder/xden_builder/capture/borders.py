"""Outermost pixels of a radiograph, where air is if it is in the picture at all."""

from __future__ import annotations

from typing import Final

__all__ = ["BORDERS"]

BORDERS: Final = {
    "top": (slice(None, 2), slice(None)),
    "bottom": (slice(-2, None), slice(None)),
    "left": (slice(None), slice(None, 2)),
    "right": (slice(None), slice(-2, None)),
}
"""What takes them out of an array of shape (rows, columns), by name."""
