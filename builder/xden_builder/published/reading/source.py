"""Where a release lies: a folder here, or a repository of the Hub."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Final, Protocol, runtime_checkable

from xden1k.errors import DataError
from xden1k.format.cache import cache_folder

__all__ = ["FolderSource", "HubSource", "Listed", "Source", "find_source"]

REPO_ID: Final = re.compile(r"[\w.-]+/[\w.-]+")
HIDDEN: Final = "."


@dataclass(frozen=True, slots=True)
class Listed:
    """One file of a release, relative to it, and how large it is."""

    path: PurePosixPath
    bytes: int


@runtime_checkable
class Source(Protocol):
    """Files of a release, listed without being read."""

    @property
    def name(self) -> str:
        """What a person calls it."""

    @property
    def commit(self) -> str:
        """Of a repository; empty for a folder."""

    def listing(self) -> Sequence[Listed]:
        """All files."""

    def read(self, path: PurePosixPath) -> bytes:
        """Content of one small file."""

    def fetch(self, paths: Sequence[PurePosixPath]) -> Path:
        """Bring files to this machine, and return the folder they are relative to."""


@dataclass(frozen=True, slots=True)
class FolderSource:
    """A release in a folder of this machine."""

    root: Path

    @property
    def name(self) -> str:
        """Its path."""
        return str(self.root)

    @property
    def commit(self) -> str:
        """Unknown."""
        return ""

    def listing(self) -> Sequence[Listed]:
        """All files, except those of hidden folders, where downloads keep their notes."""
        found = []
        for path in sorted(self.root.rglob("*")):
            inside = path.relative_to(self.root)
            hidden = any(part.startswith(HIDDEN) for part in inside.parts[:-1])
            if path.is_file() and not hidden:
                found.append(Listed(PurePosixPath(inside.as_posix()), path.stat().st_size))
        return found

    def read(self, path: PurePosixPath) -> bytes:
        """Content of one file."""
        return (self.root / path).read_bytes()

    def fetch(self, paths: Sequence[PurePosixPath]) -> Path:
        """Return the folder: all is there."""
        return self.root


@dataclass(frozen=True, slots=True)
class HubSource:
    """A release in a dataset repository of the Hub, at one commit."""

    repo_id: str
    commit: str

    @property
    def name(self) -> str:
        """Its id."""
        return self.repo_id

    def listing(self) -> Sequence[Listed]:
        """All files; nothing is downloaded."""
        import huggingface_hub

        with _telling(self.repo_id):
            tree = huggingface_hub.HfApi().list_repo_tree(
                self.repo_id, revision=self.commit, repo_type="dataset", recursive=True
            )
            return [
                Listed(PurePosixPath(each.path), each.size)
                for each in tree
                if isinstance(each, huggingface_hub.RepoFile)
            ]

    def read(self, path: PurePosixPath) -> bytes:
        """Content of one small file, which is kept in the cache."""
        return (self.fetch([path]) / path).read_bytes()

    def fetch(self, paths: Sequence[PurePosixPath]) -> Path:
        """Download what is not in the cache yet; what was cut off is resumed."""
        import huggingface_hub

        folder = self.cached
        with _telling(self.repo_id):
            huggingface_hub.snapshot_download(
                self.repo_id,
                repo_type="dataset",
                revision=self.commit,
                local_dir=folder,
                allow_patterns=[_literal(path) for path in paths],
                max_workers=4,
            )
        return folder

    @property
    def cached(self) -> Path:
        """Where its files are kept."""
        return cache_folder() / "published" / self.commit

    def missing_bytes(self, files: Sequence[Listed]) -> int:
        """How much is still to be downloaded of some files."""
        return sum(
            file.bytes
            for file in files
            if not (here := self.cached / file.path).is_file() or here.stat().st_size != file.bytes
        )

    def free_bytes(self) -> int:
        """Room on the disk of the cache."""
        at = self.cached
        while not at.exists():
            at = at.parent
        return shutil.disk_usage(at).free


def find_source(told: str, revision: str | None) -> FolderSource | HubSource:
    """Find a folder, or else the repository of that name.

    Parameters
    ----------
    told
        A path, or ``owner/name``.
    revision
        Tag, branch or commit of a repository; None = the newest.

    Raises
    ------
    DataError
        If it is neither, a revision is given for a folder, or the Hub has no such repository.
    """
    if Path(told).is_dir():
        if revision is not None:
            raise DataError(f"{told} is a folder, which has no revision {revision}")
        return FolderSource(Path(told))
    if not REPO_ID.fullmatch(told):
        raise DataError(f"{told}: expected a folder, or a repository of the Hub as owner/name")
    import huggingface_hub

    with _telling(told):
        info = huggingface_hub.HfApi().dataset_info(told, revision=revision)
    return HubSource(told, str(info.sha))


def _literal(path: PurePosixPath) -> str:
    """Spell a path so that it matches itself alone."""
    return re.sub(r"([*?\[])", r"[\1]", str(path))


@contextmanager
def _telling(repo_id: str) -> Iterator[None]:
    """Turn what the Hub's client raises into one line."""
    from huggingface_hub.errors import HfHubHTTPError, HFValidationError

    # The bases of the Hub's own error are OSError and the error of whichever HTTP client it has.
    failures: tuple[type[BaseException], ...] = (*HfHubHTTPError.__bases__, HFValidationError)
    try:
        yield
    except failures as err:
        reason: Any = next(iter(str(err).strip().splitlines()), "") or type(err).__name__
        raise DataError(f"{repo_id}: the Hub does not give it: {reason}") from err
