"""The organiser's key: 256 random bits in a file that only its owner can read."""

from __future__ import annotations

import hmac
import re
import secrets
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from xden1k.errors import DataError
from xden_bench.sealed.secret_file import read_secret, write_secret

__all__ = ["Key", "read_key", "write_key"]

SECRET_BYTES: Final = 32
_LINE: Final = re.compile(rb"xden-key/1 ([0-9a-f]{64})\n?")


@dataclass(frozen=True, slots=True)
class Key:
    """A key, from which every secret of a sealed dataset follows.

    Parameters
    ----------
    secret
        32 bytes. Never printed.

    Raises
    ------
    DataError
        If it is of another length.
    """

    secret: bytes = field(repr=False)

    def __post_init__(self) -> None:
        if len(self.secret) != SECRET_BYTES:
            raise DataError(f"a key has {SECRET_BYTES} bytes, got {len(self.secret)}")

    @property
    def id(self) -> str:
        """16 hexadecimal digits that tell keys apart and nothing of the secret."""
        return self.derive("id")[:8].hex()

    def derive(self, purpose: str, *parts: str) -> bytes:
        """Return 64 bytes for one purpose, HMAC-SHA-512 of its name and of what it is about.

        Nobody without the key can tell them from random ones, and those of one purpose tell
        nothing of another's.

        Examples
        --------
        >>> key = Key(bytes(32))
        >>> key.derive("salt", "a", "bc") == key.derive("salt", "ab", "c")
        False
        """
        # No part contains the separator, so that two lists of parts never join to one text.
        return hmac.digest(self.secret, "\0".join((purpose, *parts)).encode(), "sha512")


def write_key(path: Path) -> Key:
    """Draw a key and write it to a new file, which its owner alone may read.

    Raises
    ------
    DataError
        If there is a file already: a key that is lost is lost for good.
    """
    key = Key(secrets.token_bytes(SECRET_BYTES))
    write_secret(path, f"xden-key/1 {key.secret.hex()}")
    return key


def read_key(path: Path) -> Key:
    """Read a key.

    Raises
    ------
    OSError
        If there is no such file.
    DataError
        If it is no key, or others than its owner may read it.
    """
    line = _LINE.fullmatch(read_secret(path))
    if line is None:
        raise DataError(f"{path}: not a key of xden-bench keygen, a line 'xden-key/1 HEX'")
    return Key(bytes.fromhex(line[1].decode("ascii")))
