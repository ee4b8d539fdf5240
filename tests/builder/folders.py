"""Folders as the tests compare them."""

from pathlib import Path


def contents(root: Path) -> dict[str, bytes]:
    """Bytes of every file by its relative path."""
    return {str(p.relative_to(root)): p.read_bytes() for p in root.rglob("*") if p.is_file()}
