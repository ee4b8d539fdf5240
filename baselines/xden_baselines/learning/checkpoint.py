"""Reading what a trained method was saved as, with every damage a DataError."""

from __future__ import annotations

import io
import json
from contextlib import redirect_stdout
from pathlib import Path
from typing import TypeVar

from huggingface_hub import PyTorchModelHubMixin
from safetensors import SafetensorError

from xden1k.errors import DataError

__all__ = ["CONFIG_FILE", "WEIGHTS_FILE", "check_files", "load_pretrained", "load_report"]

CONFIG_FILE = "config.json"
WEIGHTS_FILE = "model.safetensors"
FILES = (CONFIG_FILE, WEIGHTS_FILE)

Model = TypeVar("Model", bound=PyTorchModelHubMixin)
Report = TypeVar("Report")


def check_files(folder: Path) -> None:
    """Refuse a folder without a checkpoint; the Hub's mixin would take it for a repository's name.

    Raises
    ------
    DataError
        If a file is missing.
    """
    if missing := [name for name in FILES if not (folder / name).is_file()]:
        raise DataError(f"{folder}: no checkpoint there, {' and '.join(missing)} missing")


def load_pretrained(folder: Path, kind: type[Model]) -> Model:
    """Read a network and its weights, to the CPU.

    Raises
    ------
    DataError
        If files are missing or damaged.
    """
    check_files(folder)
    try:
        with redirect_stdout(io.StringIO()):  # the Hub's mixin tells whence it loads
            return kind.from_pretrained(folder, map_location="cpu", strict=True)
    except (SafetensorError, RuntimeError, TypeError, ValueError) as err:
        raise DataError(f"{folder}: the checkpoint cannot be read: {_one_line(err)}") from err


def load_report(path: Path, kind: type[Report], what: str = "training report") -> Report:
    """Read how the training went, or what else was saved of a dataclass.

    Parameters
    ----------
    path
        The fields of the report as JSON.
    kind
        A dataclass.
    what
        What the file should be, for the message.

    Raises
    ------
    DataError
        If the file is missing or damaged.
    """
    try:
        values = json.loads(path.read_text())
        lists = {name: tuple(one) for name, one in values.items() if isinstance(one, list)}
        return kind(**{**values, **lists})
    except (OSError, ValueError, TypeError, AttributeError) as err:
        raise DataError(f"{path}: no {what}: {err}") from err


def _one_line(err: Exception) -> str:
    """Return the first of what torch lists, and how much more there is."""
    first, *rest = [line.strip() for line in str(err).splitlines()] or [""]
    more = f" (and {len(rest) - 1} more)" if len(rest) > 1 else ""
    return " ".join([first, *rest[:1]]) + more
