"""Signatures of teams and maintainers under what they enter: Ed25519 (RFC 8032) over JSON."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

from xden1k.errors import DataError
from xden1k.values.settings import read_toml
from xden_bench.sealed.secret_file import read_secret, write_secret

__all__ = [
    "MAINTAINERS",
    "SigningKey",
    "is_public_key",
    "is_signed",
    "read_maintainers",
    "read_signing_key",
    "write_signing_key",
]

MAINTAINERS: Final = "maintainers.toml"
"""Beside the results: the public keys whose notes count."""
MAX_NAME: Final = 80
_LINE: Final = re.compile(rb"xden-signing-key/1 ([0-9a-f]{64}) ([ -~]{1,80})\n?")
_PUBLIC: Final = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True, slots=True)
class SigningKey:
    """The private key of a team or a maintainer.

    Parameters
    ----------
    name
        Of its holder, as it is printed.
    private
        Never printed.
    """

    name: str
    private: Ed25519PrivateKey = field(repr=False)

    @property
    def public_key(self) -> str:
        """64 hexadecimal digits, by which everyone checks what it signed."""
        return self.private.public_key().public_bytes_raw().hex()

    @property
    def team(self) -> dict[str, str]:
        """Name and public key, as an entry states them."""
        return {"name": self.name, "public_key": self.public_key}

    def signed(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the values with their ``signature``.

        It is of all other keys as JSON: sorted, without spaces, UTF-8. A ``schema`` must be among
        them, so that what is signed for one purpose serves no other.
        """
        return {**values, "signature": self.private.sign(_message(values)).hex()}


def is_signed(values: Mapping[str, Any], public_key: str) -> bool:
    """Whether values carry a key's signature over all else that they hold."""
    if not is_public_key(public_key) or not isinstance(values.get("signature"), str):
        return False
    try:
        signature = bytes.fromhex(values["signature"])
        Ed25519PublicKey.from_public_bytes(bytes.fromhex(public_key)).verify(
            signature, _message(values)
        )
    except (InvalidSignature, ValueError):
        return False
    return True


def is_public_key(value: object) -> bool:
    """Whether a value is written as a public key."""
    return isinstance(value, str) and bool(_PUBLIC.fullmatch(value))


def write_signing_key(path: Path, name: str) -> SigningKey:
    """Draw a key and write it to a new file, which its owner alone may read.

    Raises
    ------
    DataError
        If the name is not 1 to 80 printable characters of ASCII, or there is a file already.
    """
    if not (name.strip() and len(name) <= MAX_NAME and name.isascii() and name.isprintable()):
        expected = f"1 to {MAX_NAME} printable characters of ASCII"
        raise DataError(f"the name of a key's holder must be {expected}, got {name[:100]!a}")
    key = SigningKey(name, Ed25519PrivateKey.generate())
    write_secret(path, f"xden-signing-key/1 {key.private.private_bytes_raw().hex()} {name}")
    return key


def read_signing_key(path: Path) -> SigningKey:
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
        expected = "a line 'xden-signing-key/1 HEX NAME'"
        raise DataError(f"{path}: not a key of xden-bench keygen --team, {expected}")
    secret = bytes.fromhex(line[1].decode("ascii"))
    return SigningKey(line[2].decode("ascii"), Ed25519PrivateKey.from_private_bytes(secret))


def read_maintainers(results: Path) -> dict[str, str]:
    """Read whose notes count: name by public key; nobody's where there is no such file.

    Parameters
    ----------
    results
        Folder of all entries, which may hold ``maintainers.toml``: a table ``keys``, a line
        ``"NAME" = "PUBLIC KEY"`` for each.

    Raises
    ------
    DataError
        If it is another file, or a key is none.
    """
    path = results / MAINTAINERS
    if not path.exists():
        return {}
    values = read_toml(path)
    keys = values.pop("keys", {})
    if values or not isinstance(keys, dict) or not all(map(is_public_key, keys.values())):
        expected = 'one table [keys], each line "NAME" = "64 hexadecimal digits"'
        raise DataError(f"{path}: must hold {expected}")
    return {key: name for name, key in keys.items()}


def _message(values: Mapping[str, Any]) -> bytes:
    signed = {key: value for key, value in values.items() if key != "signature"}
    return json.dumps(
        signed, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False
    ).encode()
