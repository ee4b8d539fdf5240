"""Damaged files: whatever a decoder raises becomes one line that names the file."""

from __future__ import annotations

import struct
import tokenize
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from xden1k.errors import DataError, XDenError

__all__ = ["decoding"]

# Decoders trust their input: each of these was raised by one of them on a file with a wrong byte.
_DAMAGE = (
    ArithmeticError,
    AttributeError,
    EOFError,
    LookupError,
    MemoryError,
    NameError,
    OSError,
    RuntimeError,
    SyntaxError,
    TypeError,
    ValueError,
    struct.error,
    tokenize.TokenError,
    zipfile.BadZipFile,
    zlib.error,
)


@contextmanager
def decoding(path: Path, expected: str, *errors: type[Exception]) -> Iterator[None]:
    """Turn what a decoder raises in this block into a DataError.

    Parameters
    ----------
    path
        The file that is decoded.
    expected
        What it should have been, such as ``a PNG image``.
    errors
        The decoder's own exceptions.

    Raises
    ------
    DataError
        In place of what the decoder raised; deliberate errors pass.
    """
    damage: tuple[type[Exception], ...] = (*_DAMAGE, *errors)
    try:
        yield
    except XDenError:
        raise
    except damage as err:
        reason = " ".join(str(err).split()) or type(err).__name__
        raise DataError(f"{path}: not {expected} that can be read: {reason}") from err
