"""The documents of a dataset folder and their checksums."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Mapping
from pathlib import Path

from xden1k.documents.card import citation_text, eval_text, readme_text
from xden1k.documents.croissant import croissant_text
from xden1k.documents.datasheet import datasheet_text
from xden1k.documents.facts import Facts, read_facts
from xden1k.documents.maintainer import ANSWERS_NAME, Answers
from xden1k.errors import DataError
from xden1k.format.checksums import CHECKSUMS_NAME, file_sha256, listed_sums
from xden1k.format.manifest import MANIFEST_NAME, Manifest

__all__ = ["folder_facts", "renew_datasheet", "write_documents"]


def write_documents(root: Path, facts: Facts, more: Callable[[str], Mapping[str, str]]) -> None:
    """Write every document of a new folder, and the list of checksums.

    Parameters
    ----------
    root
        The folder, with its Parquet files.
    facts
        What the documents say.
    more
        Gives further documents, name and text, for the checksum of the manifest.
    """
    manifest = facts.manifest
    manifest_text = manifest.to_json()
    documents = {
        MANIFEST_NAME: manifest_text,
        "README.md": readme_text(manifest),
        "CITATION.cff": citation_text(manifest),
        "eval.yaml": eval_text(),
        **_told_by_the_maintainer(facts),
        **more(hashlib.sha256(manifest_text.encode()).hexdigest()),
    }
    for name, text in documents.items():
        _write(root / name, text)
    checksums = {name: file_sha256(root / name) for name in documents}
    checksums |= {file.path: file.sha256 for file in manifest.files}
    _write(root / CHECKSUMS_NAME, _sums_text(checksums))


def folder_facts(root: Path, answers: Answers) -> Facts:
    """Read the facts of a dataset folder.

    Raises
    ------
    DataError
        If it is none, or a file of it is missing or damaged.
    """
    manifest = Manifest.read(root)
    manifest.check_files(root)
    return read_facts(root, manifest, answers)


def renew_datasheet(root: Path, answers: Answers) -> Facts:
    """Write the datasheet of a dataset folder anew, and what goes with it.

    The Croissant document and the list of checksums change with it; the data, the manifest and the
    card do not. One file after the other is replaced, checksums last: after a kill in between
    `xden verify` names what does not match, and the same call mends it.

    Parameters
    ----------
    root
        The dataset folder.
    answers
        What the maintainer says; kept in the folder.

    Returns
    -------
    Facts
        What the documents now say.

    Raises
    ------
    DataError
        If it is no dataset folder, has no list of checksums, or a file of it is missing.
    """
    facts = folder_facts(root, answers)
    if not (sums := listed_sums(root)):
        raise DataError(f"{root}: no {CHECKSUMS_NAME}: not a whole dataset folder")
    if not answers.text:
        sums.pop(ANSWERS_NAME, None)
        (root / ANSWERS_NAME).unlink(missing_ok=True)
    for name, text in _told_by_the_maintainer(facts).items():
        _replace(root / name, text)
        sums[name] = file_sha256(root / name)
    _replace(root / CHECKSUMS_NAME, _sums_text(sums))
    return facts


def _told_by_the_maintainer(facts: Facts) -> dict[str, str]:
    """Give the documents in which a maintainer's answers are."""
    own = {ANSWERS_NAME: facts.answers.text} if facts.answers.text else {}
    return {"DATASHEET.md": datasheet_text(facts), "croissant.json": croissant_text(facts)} | own


def _sums_text(sums: Mapping[str, str]) -> str:
    return "".join(f"{digest}  {name}\n" for name, digest in sorted(sums.items()))


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="\n")


def _replace(path: Path, text: str) -> None:
    fresh = path.with_name(f".{path.name}.partial")
    _write(fresh, text)
    os.replace(fresh, path)
