"""Divide a dataset folder: what is published, and what is sealed."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from xden1k.documents.maintainer import Answers
from xden1k.errors import DataError
from xden1k.folder import DatasetFolder, write_rows
from xden1k.folder.place import publish, staging
from xden1k.folder.withheld import withhold
from xden1k.values.types import PRIVATE
from xden_bench.scoring.submission import Progress
from xden_bench.sealed.container import COMMITMENTS_NAME, SealWriter
from xden_bench.sealed.division import private_ids
from xden_bench.sealed.key import Key

__all__ = ["PUBLIC_NAME", "SEALED_NAME", "Sealing", "seal"]

PUBLIC_NAME = "public"
SEALED_NAME = "sealed-truth.xden"
DIVIDED = "test"
"""The split that is divided."""


@dataclass(frozen=True, slots=True)
class Sealing:
    """What was made.

    Parameters
    ----------
    private_ids, test_ids
        Objects whose answers are sealed, and those of the test split that stay open.
    manifest_sha256
        Checksum of the public folder's manifest.
    key_id
        Of the key that opens the answers.
    simulated
        Private objects that a simulator drew.
    """

    private_ids: tuple[str, ...]
    test_ids: tuple[str, ...]
    manifest_sha256: str
    key_id: str
    simulated: int


def seal(
    folder: DatasetFolder, key: Key, out: Path, *, share: float = 0.5, progress: Progress = iter
) -> Sealing:
    """Write a public dataset folder and the sealed answers of its private split.

    ``out`` gets ``public/``, in which a share of the test split has become the split ``private``
    without answers, and ``sealed-truth.xden``. It appears whole or not at all. The same folder
    and key give the same bytes. Everything in ``out`` may be published; the key may not, until
    the answers may.

    Simulated objects follow from a seed, so this and the checksum of the settings, which would
    tell a guessed seed from a wrong one, are left out of every public row.

    Parameters
    ----------
    folder
        The dataset with its answers.
    key
        The organiser's: it draws the private objects and seals their answers.
    out
        The folder to make.
    share
        Of the test split that becomes private; each category gives its part.
    progress
        Goes through the object ids.

    Raises
    ------
    DataError
        If the folder has no test split, is sealed already or a disturbed copy, the share is not
        between 0 and 1, or there is something at ``out``.
    """
    if PRIVATE in folder.manifest.splits:
        raise DataError(f"{folder.root}: it has a split {PRIVATE} already")
    if folder.manifest.disturbed:
        raise DataError(f"{folder.root}: its radiographs {folder.manifest.disturbed.radiographs}")
    out = out.resolve()
    if out.exists():
        raise DataError(f"{out} exists: remove it yourself, or choose another")
    categories = {one: folder.row(one, ["category"])["category"] for one in folder.ids(DIVIDED)}
    private = sorted(private_ids(categories, share, key))
    out.parent.mkdir(parents=True, exist_ok=True)
    with staging(out) as beside:
        root = beside / "folder"
        root.mkdir()
        _write(folder, root, private, key, progress)
        manifest_sha256 = DatasetFolder(root / PUBLIC_NAME).manifest_sha256
        publish(root, out)
    sources = [folder.row(one, ["source"])["source"] for one in private]
    return Sealing(
        private_ids=tuple(private),
        test_ids=tuple(sorted(categories.keys() - set(private))),
        manifest_sha256=manifest_sha256,
        key_id=key.id,
        simulated=sources.count("phantom"),
    )


def _write(
    folder: DatasetFolder, root: Path, private: Sequence[str], key: Key, progress: Progress
) -> None:
    def seal_answers(manifest_sha256: str) -> Mapping[str, str]:
        with zipfile.ZipFile(root / SEALED_NAME, "w") as archive:
            writer = SealWriter(archive, manifest_sha256, key)
            for object_id in private:
                writer.add(folder.row(object_id))
        return {COMMITMENTS_NAME: writer.commitments_text()}

    manifest = folder.manifest
    write_rows(
        _public_rows(folder, frozenset(private), progress),
        root / PUBLIC_NAME,
        version=manifest.version,
        builder=manifest.builder,
        config_sha256="" if "phantom" in manifest.sources else manifest.config_sha256,
        answers=Answers.of_folder(folder.root),
        more=seal_answers,
    )


def _public_rows(
    folder: DatasetFolder, private: frozenset[str], progress: Progress
) -> Iterator[Mapping[str, Any]]:
    for object_id in progress(sorted(folder.ids())):
        row = folder.row(object_id)
        yield withhold(row) if object_id in private else _without_seed(row)


def _without_seed(row: Mapping[str, Any]) -> Mapping[str, Any]:
    if row["source"] != "phantom":
        return row
    meta = json.loads(row["meta_json"])
    meta.pop("seed", None)
    return {**row, "meta_json": json.dumps(meta, sort_keys=True, ensure_ascii=False)}
