"""``sealed-truth.xden``: an ordinary zip of one encrypted member for each private object.

::

    seal.json          schema, id of the key, checksum of the public folder's manifest
    answers/OBJECT_ID  AES-SIV (RFC 5297) of the compressed salt and answers

AES-SIV needs no nonce, so none can be used twice, and the same answers give the same file. Schema,
manifest and object id are its associated data: a member opens only as the object it was sealed as,
for the dataset it was sealed for. Objects are opened one at a time.
"""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESSIV

from xden1k.errors import DataError
from xden1k.folder import DatasetFolder
from xden1k.format.shards import Row
from xden1k.values.types import PRIVATE
from xden_bench.sealed.answers import (
    SALT_BYTES,
    answers_bytes,
    answers_row,
    commitment,
    salt_of,
)
from xden_bench.sealed.key import Key

__all__ = ["COMMITMENTS_NAME", "SealWriter", "SealedTruth"]

SCHEMA: Final = "xden-sealed/1"
COMMITMENTS_SCHEMA: Final = "xden-commitments/1"
COMMITMENTS_NAME: Final = "commitments.json"
HEADER_NAME: Final = "seal.json"
FOLDER: Final = "answers/"
MAX_MEMBER_BYTES: Final = 8 << 20
"""Two fields that nothing compresses are 1.4 MB."""
# RuntimeError: flags and methods that no file of ours has; OSError, ValueError: places not in it
_DAMAGE: Final = (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, OSError, ValueError)


class SealWriter:
    """Writes ``sealed-truth.xden``, object by object, and notes the commitments.

    Parameters
    ----------
    archive
        The zip, open for writing.
    manifest_sha256
        Checksum of the public folder's manifest.
    key
        The organiser's.
    """

    def __init__(self, archive: zipfile.ZipFile, manifest_sha256: str, key: Key) -> None:
        self._archive, self._manifest_sha256, self._key = archive, manifest_sha256, key
        self._cipher = _cipher(key)
        self._commitments: dict[str, str] = {}
        self._write(HEADER_NAME, _json(self._header(SCHEMA)))

    def add(self, row: Mapping[str, Any]) -> None:
        """Seal the answers of an encoded row."""
        object_id, answers = row["object_id"], answers_bytes(row)
        salt = salt_of(object_id, self._manifest_sha256, self._key)
        self._commitments[object_id] = commitment(salt, answers)
        bound = _associated_data(self._manifest_sha256, object_id)
        member = self._cipher.encrypt(zlib.compress(salt + answers), bound)
        self._write(FOLDER + object_id, member)

    def commitments_text(self) -> str:
        """Text of ``commitments.json``."""
        rule = "SHA-256 of the salt (64 bytes) and the answers (JSON, sorted keys)"
        return _json(
            self._header(COMMITMENTS_SCHEMA) | {"rule": rule, "objects": self._commitments}
        ).decode()

    def _header(self, schema: str) -> dict[str, Any]:
        return {
            "schema": schema,
            "split": PRIVATE,
            "key_id": self._key.id,
            "manifest_sha256": self._manifest_sha256,
        }

    def _write(self, name: str, data: bytes) -> None:
        self._archive.writestr(zipfile.ZipInfo(name), data)  # its date is fixed


@dataclass(frozen=True, eq=False)
class SealedTruth:
    """The answers of a public folder's private split, opened object by object.

    Parameters
    ----------
    path
        The ``sealed-truth.xden``.
    folder
        The public dataset folder it was made with.
    key
        The organiser's.

    Raises
    ------
    OSError
        If there is no such file.
    DataError
        If the file is damaged, of another key or of another dataset, or does not hold the objects
        that the folder's commitments name.
    """

    path: Path
    folder: DatasetFolder
    key: Key

    def __post_init__(self) -> None:
        header = self._header()
        if header["key_id"] != self.key.id:
            raise DataError(
                f"{self.path} was sealed with the key {header['key_id']}, this is {self.key.id}"
            )
        self._check_manifest(self.path, header)
        members = sorted(name for name in self._archive.namelist() if name != HEADER_NAME)
        if members != sorted(FOLDER + object_id for object_id in self.commitments):
            raise DataError(
                f"{self.path}: its {len(members)} objects are not the {len(self.commitments)} of "
                f"{self.folder.root / COMMITMENTS_NAME}"
            )

    @cached_property
    def commitments(self) -> Mapping[str, str]:
        """Commitment to the answers of each private object, as published."""
        path = self.folder.path / COMMITMENTS_NAME
        if not path.is_file():
            raise DataError(f"{self.folder.root}: no {COMMITMENTS_NAME}: nothing is sealed here")
        values = _parse(path.read_bytes(), COMMITMENTS_SCHEMA, path, "manifest_sha256", "objects")
        self._check_manifest(path, values)
        objects: dict[str, str] = values["objects"]
        if set(objects) != set(self.folder.ids(PRIVATE)):
            raise DataError(f"{path}: its objects are not those of the split {PRIVATE}")
        return objects

    def answers(self, object_id: str) -> Row:
        """Open the answers of one object.

        Raises
        ------
        DataError
            If they were changed, or are not those that were committed to.
        """
        salted = zlib.decompress(self._decrypted(object_id))
        salt, answers = salted[:SALT_BYTES], salted[SALT_BYTES:]
        if commitment(salt, answers) != self.commitments[object_id]:
            raise DataError(
                f"{self.path}: the answers of {object_id} are not those committed to in "
                f"{self.folder.root / COMMITMENTS_NAME}"
            )
        return answers_row(answers)

    def _decrypted(self, object_id: str) -> bytes:
        cipher = _cipher(self.key)
        bound = _associated_data(self.folder.manifest_sha256, object_id)
        try:
            return cipher.decrypt(self._member(FOLDER + object_id), bound)
        except InvalidTag as err:
            raise DataError(f"{self.path}: {object_id} was changed after it was sealed") from err

    def _header(self) -> dict[str, Any]:
        if HEADER_NAME not in self._archive.namelist():
            raise DataError(f"{self.path}: not a sealed truth: no {HEADER_NAME}")
        data = self._member(HEADER_NAME)
        return _parse(data, SCHEMA, self.path / HEADER_NAME, "key_id", "manifest_sha256")

    def _check_manifest(self, path: Path, values: Mapping[str, Any]) -> None:
        found, here = str(values["manifest_sha256"]), self.folder.manifest_sha256
        if found != here:
            raise DataError(
                f"{path} belongs to the dataset of manifest {found[:12]}, that of "
                f"{self.folder.root} is {here[:12]}"
            )

    @cached_property
    def _archive(self) -> zipfile.ZipFile:
        with _reading(self.path):
            return zipfile.ZipFile(self.path)

    def _member(self, name: str) -> bytes:
        """Read a member, if its size is possible."""
        if (size := self._archive.getinfo(name).file_size) > MAX_MEMBER_BYTES:
            raise DataError(f"{self.path}: {name} has {size} bytes, over {MAX_MEMBER_BYTES}")
        with _reading(self.path):
            return self._archive.read(name)


def _cipher(key: Key) -> AESSIV:
    return AESSIV(key.derive("file"))  # 512 bits: AES-256 for the tag, and AES-256


def _associated_data(manifest_sha256: str, object_id: str) -> list[bytes]:
    return [SCHEMA.encode(), manifest_sha256.encode(), object_id.encode()]


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    try:
        yield
    except _DAMAGE as err:
        if isinstance(err, OSError) and err.filename is not None:  # it cannot be opened
            raise
        raise DataError(f"{path}: not a whole sealed truth: {err}") from err


def _parse(data: bytes, schema: str, where: Path, *names: str) -> dict[str, Any]:
    try:
        values: dict[str, Any] = json.loads(data)
        if values["schema"] != schema:
            raise ValueError(f"schema is {values['schema']!r}")
        return {name: values[name] for name in names}
    except (ValueError, TypeError, KeyError, RecursionError) as err:
        raise DataError(f"{where}: not of schema {schema}: {err!r}") from err


def _json(values: Mapping[str, Any]) -> bytes:
    return (json.dumps(values, indent=2) + "\n").encode()
