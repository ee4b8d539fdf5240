"""Files at URLs: documents whole, Parquet files by the pieces that are asked for.

Any scheme that fsspec knows. What was read is kept in the user's cache: Parquet files by the
checksum that the manifest has of them, documents of a Hub repository by the commit. A name on the
Hub is pinned to its commit once, so that everything read afterwards is of one version.
"""

from __future__ import annotations

import bisect
import functools
import hashlib
import io
import itertools
import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from xden1k.errors import DataError, MissingExtraError
from xden1k.format.cache import PieceCache, cache_folder, cache_limit

__all__ = ["RemoteFile", "RemotePath", "is_url", "root_of"]

TAIL_BYTES: Final = 64 << 10
"""Read at first from the end of a Parquet file, in the hope that the footer is in it."""
END_BYTES: Final = 8
"""Length of the footer, four bytes, and the magic."""
SMALL_BYTES: Final = 4 << 10
"""Columns of a row below this are read together with their neighbours."""
CONNECTIONS: Final = 8
PACKAGES: Final = {
    **{"s3": "s3fs", "s3a": "s3fs", "gs": "gcsfs", "gcs": "gcsfs", "abfs": "adlfs", "az": "adlfs"},
    **{"http": "aiohttp", "https": "aiohttp", "sftp": "paramiko"},
}
"""What to install for a scheme; the other schemes say so themselves."""
HUB: Final = re.compile(
    r"hf://datasets/(?P<repo>[^/@]+/[^/@]+)"
    r"(?:@(?P<revision>refs/(?:pr|convert)/[^/]+|[^/]+))?(?P<inside>/.*)?"
)
COMMIT: Final = re.compile("[0-9a-f]{40}")


def is_url(root: object) -> bool:
    """Tell a URL from a path.

    Examples
    --------
    >>> is_url("hf://datasets/owner/name"), is_url("data/xden1k")
    (True, False)
    """
    return isinstance(root, str) and "://" in root


def root_of(root: str | Path | RemotePath) -> Path | RemotePath:
    """Return a folder as a path, or as what stands for one: of a URL, pinned to its commit.

    Raises
    ------
    DataError
        If a Hub repository or its revision is not there, or the Hub cannot be reached.
    MissingExtraError
        If the package for the scheme is not installed.
    """
    if isinstance(root, str) and re.match(r"(file|local)://", root):
        return Path(root.partition("://")[2])
    if isinstance(root, str) and is_url(root):
        return RemotePath(_pinned(root.rstrip("/")))
    return root if isinstance(root, RemotePath) else Path(root)


@dataclass(frozen=True, slots=True)
class RemotePath:
    """A folder or file at a URL: as much of a path as reading a dataset folder takes."""

    url: str

    def __str__(self) -> str:
        return self.url

    def __fspath__(self) -> str:
        return self.url

    def __truediv__(self, name: str) -> RemotePath:
        return RemotePath(f"{self.url}/{name}")

    def absolute(self) -> RemotePath:
        """Return itself."""
        return self

    @property
    def _kept_as(self) -> str:
        """Name in the cache of a file that never changes, of a commit; else empty."""
        hub = HUB.fullmatch(self.url)
        fixed = hub and hub["revision"] and COMMIT.fullmatch(hub["revision"])
        return f"documents/{hashlib.sha256(self.url.encode()).hexdigest()}" if fixed else ""

    def read_bytes(self) -> bytes:
        """Content of a document.

        Raises
        ------
        FileNotFoundError
            If there is none.
        DataError
            If it cannot be read.
        """
        kept_as = self._kept_as
        if kept_as and (kept := _cache().get(kept_as)) is not None:
            return kept
        with _told(self.url):
            fs, path = _opened(self.url)
            content = bytes(fs.cat_file(path))
        if kept_as:
            _cache().put(kept_as, content)
        return content

    def read_ranges(self, ranges: Sequence[tuple[int, int]]) -> list[bytes]:
        """Parts of a file, from the first byte of each up to the second.

        Raises
        ------
        DataError
            If it cannot be read, or is shorter.
        """
        if not ranges:
            return []
        with _told(self.url):
            fs, path = _opened(self.url)
            read = functools.partial(_read_range, fs, path)
            if len(ranges) == 1:
                parts = [read(ranges[0])]
            else:
                with ThreadPoolExecutor(min(CONNECTIONS, len(ranges))) as pool:
                    parts = list(pool.map(read, ranges))
        for (start, end), part in zip(ranges, parts, strict=True):
            if len(part) != end - start:
                raise DataError(
                    f"{self.url}: {len(part)} bytes at {start}, {end - start} wanted: cut short "
                    "or changed"
                )
        return parts

    def names(self) -> list[str]:
        """Names of what a folder holds.

        Raises
        ------
        DataError
            If it cannot be read.
        """
        with _told(self.url):
            fs, path = _opened(self.url)
            return sorted(str(name).rpartition("/")[2] for name in fs.ls(path, detail=False))


class RemoteFile(io.RawIOBase):
    """A Parquet file at a URL, of which only the pieces are fetched that are read.

    A piece is one column of one row group, or a run of small ones. Its footer is compared with
    the manifest's; pages have checksums of their own. For one thread.

    Parameters
    ----------
    path
        The file.
    size, sha256, footer_sha256
        Of it, as the manifest has them.

    Raises
    ------
    DataError
        If it cannot be read, or is not the manifest's.
    """

    def __init__(self, path: RemotePath, size: int, sha256: str, footer_sha256: str) -> None:
        super().__init__()
        self._path, self._size, self._sha256, self._at = path, size, sha256, 0
        footer = self._read_footer()
        if footer_sha256 and hashlib.sha256(footer).hexdigest() != footer_sha256:
            self._drop([self._tail, (self._footer_start, self._tail[0])])
            raise DataError(f"{path}: its footer is not the manifest's: damaged or changed")
        try:
            self.metadata = pq.read_metadata(pa.BufferReader(b"PAR1" + footer))
        except (pa.ArrowException, OSError) as err:
            raise DataError(f"{path}: not a whole Parquet file: {err}") from err
        count = self.metadata.num_row_groups
        self._starts = [_extent(self.metadata.row_group(i).column(0))[0] for i in range(count)]
        self._held: dict[tuple[int, int], bytes] = {}
        self._layouts: dict[int, list[tuple[int, int, set[str]]]] = {}

    @property
    def _tail(self) -> tuple[int, int]:
        return max(self._size - TAIL_BYTES, 0), self._size

    def _read_footer(self) -> bytes:
        start, end = self._tail
        (tail,) = self._pieces([(start, end)])
        length = int.from_bytes(tail[-END_BYTES:-4], "little") + END_BYTES
        if tail[-4:] != b"PAR1" or length > self._size:
            self._drop([(start, end)])
            raise DataError(f"{self._path}: does not end as a Parquet file: cut short or changed")
        self._footer_start = end - length
        if self._footer_start < start:
            (before,) = self._pieces([(self._footer_start, start)])
            tail = before + tail
        self._footer = tail[-length:]
        return self._footer

    @contextmanager
    def holding(self, group: int, columns: Iterable[str] | None = None) -> Iterator[None]:
        """Fetch what one row group has of some columns, or of all, and hold it for the block."""
        wanted = None if columns is None else set(columns)
        pieces = [
            (start, end)
            for start, end, names in self._layout(group)
            if wanted is None or names & wanted
        ]
        self._held = dict(zip(pieces, self._pieces(pieces), strict=True))
        try:
            yield
        finally:
            self._held = {}

    def forget(self, group: int) -> None:
        """Forget what was kept of a row group that turned out damaged."""
        self._drop([(start, end) for start, end, _ in self._layout(group)])

    def readable(self) -> bool:
        """Whether it can be read: yes."""
        return True

    def seekable(self) -> bool:
        """Whether it can be read anywhere: yes."""
        return True

    def tell(self) -> int:
        """Where the next byte is read."""
        return self._at

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Go somewhere, and say where that is."""
        base = {io.SEEK_SET: 0, io.SEEK_CUR: self._at, io.SEEK_END: self._size}[whence]
        self._at = base + offset
        return self._at

    def readinto(self, buffer: Any) -> int:
        """Read as many bytes as fit."""
        end = min(self._at + len(buffer), self._size)
        content = self._between(self._at, end)
        buffer[: len(content)] = content
        self._at += len(content)
        return len(content)

    def read(self, size: int = -1) -> bytes:
        """Read some bytes, or all that follow."""
        end = self._size if size < 0 else min(self._at + size, self._size)
        content = self._between(self._at, end)
        self._at += len(content)
        return content

    def _between(self, start: int, end: int) -> bytes:
        if start >= end:
            return b""
        if start >= self._footer_start:
            return self._footer[start - self._footer_start : end - self._footer_start]
        for (first, last), piece in self._held.items():
            if first <= start and end <= last:
                return piece[start - first : end - first]
        # Not what is held: whatever pieces it lies in.
        groups = range(max(bisect.bisect_right(self._starts, start) - 1, 0), len(self._starts))
        near = [(a, b) for i in groups if self._starts[i] < end for a, b, _ in self._layout(i)]
        pieces = [(a, b) for a, b in near if a < end and b > start]
        if not pieces or pieces[0][0] > start or pieces[-1][1] < end:
            return self._path.read_ranges([(start, end)])[0]
        first = pieces[0][0]
        return b"".join(self._pieces(pieces))[start - first : end - first]

    def _layout(self, group: int) -> list[tuple[int, int, set[str]]]:
        """Start, end and column names of each piece of a row group, in order."""
        if group not in self._layouts:
            self._layouts[group] = self._laid_out(group)
        return self._layouts[group]

    def _laid_out(self, group: int) -> list[tuple[int, int, set[str]]]:
        row = self.metadata.row_group(group)
        layout: list[tuple[int, int, set[str]]] = []
        for chunk in (row.column(i) for i in range(row.num_columns)):
            start, end = _extent(chunk)
            name = chunk.path_in_schema.partition(".")[0]
            if layout and end - start < SMALL_BYTES and end - layout[-1][0] < SMALL_BYTES:
                layout[-1] = (layout[-1][0], end, layout[-1][2] | {name})
            else:
                layout.append((start, end, {name}))
        return layout

    def _pieces(self, wanted: Sequence[tuple[int, int]]) -> list[bytes]:
        """Content of pieces: from the cache, and the missing ones in as few requests as can be."""
        cache = _cache()
        found = {each: cache.get(self._kept_as(each)) for each in wanted}
        missing = sorted(each for each, piece in found.items() if piece is None)
        runs: list[list[tuple[int, int]]] = []
        for each in missing:
            if runs and runs[-1][-1][1] == each[0]:
                runs[-1].append(each)
            else:
                runs.append([each])
        contents = self._path.read_ranges([(run[0][0], run[-1][1]) for run in runs])
        for run, content in zip(runs, contents, strict=True):
            for start, end in run:
                piece = content[start - run[0][0] : end - run[0][0]]
                found[start, end] = piece
                cache.put(self._kept_as((start, end)), piece)
        return [piece for piece in found.values() if piece is not None]

    def _drop(self, pieces: Iterable[tuple[int, int]]) -> None:
        for each in pieces:
            _cache().drop(self._kept_as(each))

    def _kept_as(self, piece: tuple[int, int]) -> str:
        return f"shards/{self._sha256}/{piece[0]}-{piece[1]}"


def _extent(chunk: pq.ColumnChunkMetaData) -> tuple[int, int]:
    start = chunk.dictionary_page_offset or chunk.data_page_offset
    return start, start + chunk.total_compressed_size


def _cache() -> PieceCache:
    return _cache_at(cache_folder() / "remote", cache_limit())


@functools.cache
def _cache_at(folder: Path, limit_bytes: int) -> PieceCache:
    return PieceCache(folder, limit_bytes)


def _opened(url: str) -> tuple[Any, str]:
    """Return the file system of a URL, and the path in it."""
    from fsspec.core import url_to_fs

    scheme = url.partition("://")[0]
    try:
        fs, path = url_to_fs(url)
    except ImportError as err:
        command = f"pip install {PACKAGES[scheme]}" if scheme in PACKAGES else str(err)
        raise MissingExtraError(f"{url}: reading {scheme}:// needs more: {command}") from err
    except ValueError as err:
        raise DataError(f"{url}: {err}") from err
    return fs, str(path)


def _read_range(fs: Any, path: str, wanted: tuple[int, int]) -> bytes:
    start, end = wanted
    if fs.protocol == "hf":  # its own way to read a range fetches 5 MB more
        with fs.open(path, "rb", cache_type="none") as file:
            file.seek(start)
            return bytes(file.read(end - start))
    return bytes(fs.cat_file(path, start=start, end=end))


@contextmanager
def _told(what: str) -> Iterator[None]:
    """Turn what the file systems raise into one line; a file that is missing stays that."""
    try:
        yield
    except (FileNotFoundError, DataError, MissingExtraError):
        raise
    except _failures() as err:
        said = next(iter(str(err).strip().splitlines()), "") or type(err).__name__
        raise DataError(f"cannot read {what}: {said}") from err


def _failures() -> tuple[type[BaseException], ...]:
    """Return what file systems raise; those whose packages are not loaded raise nothing."""
    known: list[type[BaseException]] = [OSError]
    if errors := sys.modules.get("huggingface_hub.errors"):
        known += [*errors.HfHubHTTPError.__bases__, errors.HFValidationError]
    if client := sys.modules.get("aiohttp"):
        known.append(client.ClientError)
    return tuple(known)


def _pinned(url: str) -> str:
    """Replace the revision of a Hub repository by its commit; other URLs stay."""
    hub = HUB.fullmatch(url)
    if hub is None:
        if url.startswith("hf://datasets/"):
            raise DataError(f"{url}: wanted hf://datasets/OWNER/NAME, with @REVISION if not main")
        _opened(url)
        return url
    revision = hub["revision"] or "main"
    if not COMMIT.fullmatch(revision):
        revision = _commit(hub["repo"], revision)
    return f"hf://datasets/{hub['repo']}@{revision}{hub['inside'] or ''}"


def _commit(repo_id: str, revision: str) -> str:
    from huggingface_hub import HfApi, constants
    from huggingface_hub.errors import RepositoryNotFoundError, RevisionNotFoundError

    kept_as = f"refs/{hashlib.sha256(f'{repo_id}@{revision}'.encode()).hexdigest()}"
    where = f"{repo_id} at {revision}"
    if constants.HF_HUB_OFFLINE:
        if (kept := _cache().get(kept_as)) is None:
            raise DataError(f"HF_HUB_OFFLINE is set, and {where} is not in the cache")
        return kept.decode()
    api = HfApi()
    try:
        with _told(where):
            commit = str(api.dataset_info(repo_id, revision=revision.replace("%2F", "/")).sha)
    except DataError as err:
        if isinstance(err.__cause__, RepositoryNotFoundError):
            message = f"the Hub has no dataset {repo_id}, or shows it to other tokens only"
            raise DataError(message) from err
        if isinstance(err.__cause__, RevisionNotFoundError):
            refs = api.list_repo_refs(repo_id, repo_type="dataset")
            names = [ref.name for ref in itertools.chain(refs.branches, refs.tags)]
            raise DataError(f"{repo_id} has no revision {revision}; it has {names}") from err
        raise
    _cache().put(kept_as, commit.encode())
    return commit
