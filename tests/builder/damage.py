"""Damaged image files: what any reader of them owes its user."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from xden1k.errors import DataError
from xden_builder.capture import read_image


def assert_an_image_or_one_error(
    path: Path, whole: bytes, changes: Mapping[int, int], cut: int | None
) -> None:
    """Damage a file: reading it gives an image, or one line that names the file."""
    content = bytearray(whole)
    for place, value in changes.items():
        content[place % len(content)] = value
    path.write_bytes(content[:cut])
    message = str(path)
    try:
        read_image(path)
    except DataError as err:
        message = str(err)
    assert str(path) in message
    assert "\n" not in message
