"""What is pushed of a dataset folder: its files, and two documents that say where they will be."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from typing import Final

from xden1k.documents.croissant import croissant_text
from xden1k.documents.facts import Facts
from xden1k.documents.maintainer import ANSWERS_NAME
from xden1k.errors import DataError
from xden1k.format.checksums import CHECKSUMS_NAME, listed_sums
from xden1k.format.manifest import MANIFEST_NAME, Manifest

__all__ = ["CROISSANT_NAME", "FILE_BYTES", "FOLDER_FILES", "Parcel", "published_on", "read_folder"]

CROISSANT_NAME: Final = "croissant.json"
FILE_BYTES: Final = 200 * 10**9
FOLDER_FILES: Final = 10_000
"""Largest file, and files in one folder, that the Hub takes."""


@dataclass(frozen=True)
class Parcel:
    """The files of one version as they will be on the Hub.

    Parameters
    ----------
    root
        The dataset folder.
    manifest
        Its manifest.
    sums
        Checksum of each file, by name, without that of the list of checksums itself.
    made
        Documents that differ from those in the folder, by name.
    """

    root: Path
    manifest: Manifest
    sums: dict[str, str]
    made: dict[str, bytes]

    @classmethod
    def of(cls, root: Path, facts: Facts, base_url: str, date: str) -> Parcel:
        """Fill one: the Croissant document with addresses and date, and checksums to match.

        Parameters
        ----------
        root
            The dataset folder.
        facts
            What is known of it.
        base_url
            Where the files will be, ending in a slash.
        date
            Day on which the version is published.
        """
        croissant = croissant_text(facts, base_url, date).encode()
        sums = listed_sums(root) | {CROISSANT_NAME: hashlib.sha256(croissant).hexdigest()}
        lines = [f"{digest}  {name}\n" for name, digest in sorted(sums.items())]
        made = {CROISSANT_NAME: croissant, CHECKSUMS_NAME: "".join(lines).encode()}
        return cls(root, facts.manifest, sums, made)

    @property
    def names(self) -> list[str]:
        """Names of all files, sorted."""
        return sorted({*self.sums, *self.made})

    def size(self, name: str) -> int:
        """Bytes of one file."""
        return len(self.made[name]) if name in self.made else (self.root / name).stat().st_size

    def sha256(self, name: str) -> str:
        """Checksum of one file, as the list has it."""
        return self.sums.get(name) or hashlib.sha256(self.made[name]).hexdigest()

    def git_oid(self, name: str) -> str:
        """Git's name of one file, read whole: for small ones."""
        content = self.made[name] if name in self.made else (self.root / name).read_bytes()
        blob = b"blob %d\0%s" % (len(content), content)
        return hashlib.sha1(blob, usedforsecurity=False).hexdigest()


def published_on(croissant: bytes) -> str:
    """Date in a published Croissant document; empty if there is none."""
    try:
        return str(json.loads(croissant)["datePublished"])
    except (ValueError, KeyError, TypeError):
        return ""


def read_folder(root: Path) -> Manifest:
    """Read the manifest of a folder that is to be pushed, and look for what needs no reading.

    Raises
    ------
    DataError
        If it is no dataset folder, holds files that its checksums do not list, or the Hub takes
        no file so large or no folder so full.
    """
    _refuse_work_files(root)
    manifest = Manifest.read(root)
    names = {path.relative_to(root).as_posix() for path in root.rglob("*") if path.is_file()}
    if ANSWERS_NAME in names - listed_sums(root).keys():
        raise DataError(
            f"{root / ANSWERS_NAME} is not in the datasheet yet: "
            f"`xden-build datasheet {quote(str(root))}`"
        )
    if others := sorted(names - listed_sums(root).keys() - {CHECKSUMS_NAME}):
        raise DataError(
            f"{root} holds {len(others)} files that {CHECKSUMS_NAME} does not list ({_few(others)})"
            ": only what is listed and verified is pushed; remove them"
        )
    if missing := sorted(listed_sums(root).keys() - names):
        raise DataError(f"{root / missing[0]} is missing: {CHECKSUMS_NAME} lists it")
    for file in manifest.files:
        if file.bytes > FILE_BYTES:
            raise DataError(
                f"{root / file.path}: {file.bytes / 1e9:.1f} GB, the Hub takes no file above "
                f"{FILE_BYTES / 1e9:.0f} GB: write smaller shards"
            )
    if len(manifest.files) > FOLDER_FILES:
        raise DataError(f"{root}: {len(manifest.files)} shards, the Hub takes {FOLDER_FILES}")
    return manifest


def _few(names: list[str]) -> str:
    return ", ".join(names[:3]) + (" ..." if len(names) > 3 else "")


def _refuse_work_files(root: Path) -> None:
    if (root / MANIFEST_NAME).is_file() or not root.name.endswith(".work"):
        return
    dataset = root.with_name(root.name.removesuffix(".work"))
    raise DataError(
        f"{root} is where `xden-build run` keeps its work, not a dataset folder: push {dataset}"
    )
