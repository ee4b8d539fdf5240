"""Settings: a TOML file into a frozen dataclass, unknown keys refused."""

from __future__ import annotations

import dataclasses
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from xden1k.errors import DataError

__all__ = ["load_settings", "read_toml", "settings_of"]

Settings = TypeVar("Settings")


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file.

    Raises
    ------
    DataError
        If it is not TOML, or not UTF-8.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as err:
        raise DataError(f"{path}: not valid TOML: {err}") from err


def load_settings(cls: type[Settings], path: Path) -> Settings:
    """Read a TOML file into a settings dataclass.

    Raises
    ------
    DataError
        If the file is not TOML, has an unknown key, or lacks a needed one.
    """
    return settings_of(cls, read_toml(path), str(path))


def settings_of(cls: type[Settings], values: Mapping[str, Any], where: str) -> Settings:
    """Make a settings dataclass of a table.

    Parameters
    ----------
    cls
        The dataclass.
    values
        By key.
    where
        What the message of an error begins with: the file, and the table in it.

    Raises
    ------
    DataError
        If there is an unknown key, or a needed one is missing.
    """
    known = {field.name for field in dataclasses.fields(cls)}  # type: ignore[arg-type]
    if unknown := sorted(values.keys() - known):
        raise DataError(f"{where}: unknown keys {unknown}; known keys are {sorted(known)}")
    try:
        return cls(**values)
    except TypeError as err:
        raise DataError(f"{where}: {err}") from err
