"""A submission's archive, whatever it holds: its directory, its meta data, and what is wrong."""

from __future__ import annotations

import hashlib
import io
import re
import zipfile
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Any, ClassVar, Final, Generic, TypeVar

from xden1k.predictions.meta import Form, parse_meta
from xden1k.predictions.npz import BadArchiveError, Member, NpzReader, check_size
from xden1k.predictions.problems import Problem, listed, raise_errors, shortened

__all__ = ["OBJECT_ID", "Named", "SubmissionArchive", "open_flawless"]

OBJECT_ID: Final = r"[A-Za-z0-9._-]{1,128}"
MAX_META_BYTES: Final = 256 << 10
_META_NAME: Final = "__meta__.npy"
_TEXT: Final = (r"<U[1-9]\d{0,6}", "a string")

Archive = TypeVar("Archive", bound="SubmissionArchive[Any]")
Named = Mapping[str, Mapping[str, str]]
"""Kind of each member, by slot and object id: an object has one member in each slot."""


class SubmissionArchive(ABC, Generic[Form]):
    """An open submission. Opening reads the directory, the headers and the meta data only.

    Use it as a context manager.

    Parameters
    ----------
    path
        The file.

    Attributes
    ----------
    problems
        Everything wrong that shows without reading an array.
    meta
        What the file says about itself; None if that is not readable.
    named_ids
        Every object the file names, readable or not.

    Raises
    ------
    OSError
        If there is no such file. Whatever is wrong inside it is a problem, not an error.
    """

    form: type[Form]
    """What ``__meta__`` must say."""
    key: ClassVar[re.Pattern[str]]
    """Names of members, with the groups ``kind`` and ``id``."""
    keys: ClassVar[str]
    """The same in words."""
    main: ClassVar[str]
    """The slot that every object has a member in."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.meta: Form | None = None
        self.named_ids: frozenset[str] = frozenset()
        self._members: dict[str, Member] = {}
        # a named pipe would keep its reader waiting for ever
        is_special = path.exists() and not path.is_file()
        self._stream: io.BufferedReader | io.BytesIO = (
            io.BytesIO() if is_special else path.open("rb")
        )
        try:
            self._archive = NpzReader(self._stream)
        except BadArchiveError as err:
            self._stream.close()
            self.problems: tuple[Problem, ...] = (Problem(err.code, None, str(err)),)
        else:
            self.problems = tuple(shortened(self._examine_directory()))

    def __enter__(self: Archive) -> Archive:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._stream.close()

    @property
    def ids(self) -> tuple[str, ...]:
        """Objects whose arrays can be read, sorted."""
        return tuple(sorted(self._members))

    @cached_property
    def sha256(self) -> str:
        """Checksum of the file as it was opened."""
        self._stream.seek(0)
        return hashlib.file_digest(self._stream, "sha256").hexdigest()

    def __contains__(self, object_id: object) -> bool:
        return object_id in self._members

    @abstractmethod
    def _slot(self, found: re.Match[str]) -> str:
        """Return which of the members that an object has a name is of."""

    @abstractmethod
    def _examine_member(self, info: zipfile.ZipInfo, found: re.Match[str]) -> Iterator[Problem]:
        """Take an object's member in by its header."""

    @abstractmethod
    def _slot_problems(self, named: Named) -> Iterator[Problem]:
        """Compare what objects have in one slot with what they have in another."""

    def _examine_directory(self) -> Iterator[Problem]:
        """Sort the members into meta data and objects; every problem on the way."""
        named: dict[str, dict[str, str]] = {}
        twice: list[str] = []
        unknown: list[str] = []
        for info in self._archive.entries:
            name = info.orig_filename  # filename is cut at a NUL byte
            found = self.key.fullmatch(name)
            if not found and name != _META_NAME:
                unknown.append(name)
                continue
            slot, key, kind = (
                (self._slot(found), found["id"], found["kind"]) if found else (name, name, "")
            )
            if key in named.setdefault(slot, {}):
                twice.append(name)
                continue
            named[slot][key] = kind
            yield from self._examine_member(info, found) if found else self._read_meta(info)
        has_meta = named.pop(_META_NAME, None)
        self.named_ids = frozenset(named.get(self.main, {}))
        if not has_meta:
            yield Problem("E201", None, "__meta__ is missing: a 0-d string array holding JSON")
        yield from _name_problems(self.keys, unknown, twice)
        yield from self._slot_problems(named)

    def _read_meta(self, info: zipfile.ZipInfo) -> list[Problem]:
        try:
            member = self._archive.member(info)
            check_size(member, MAX_META_BYTES, *_TEXT)
            values = self._archive.read(member)
        except BadArchiveError as err:
            code = "E201" if err.code == "E401" else err.code
            return [Problem(code, None, f"__meta__: {err}")]
        if member.shape != ():
            found = f"{member.dtype} {member.shape}"
            return [Problem("E201", None, f"__meta__ must be a 0-d string array, got {found}")]
        try:
            text = values.tobytes().decode("utf-32-le").rstrip("\0")
        except UnicodeDecodeError as err:
            return [Problem("E201", None, f"__meta__ is not text: {err}")]
        self.meta, problems = parse_meta(text, self.form)
        return problems


def open_flawless(archive: Archive, named: bool = False) -> Archive:
    """Return an archive that must be without a flaw as far as its headers and meta data show.

    Parameters
    ----------
    archive
        As it was opened.
    named
        Whether each problem names the file.

    Raises
    ------
    SubmissionError
        With every problem found; the file is closed then.
    """
    try:
        raise_errors(archive.problems, archive.path if named else None)
    except BaseException:
        archive.close()
        raise
    return archive


def _name_problems(
    keys: str, unknown: Collection[str], twice: Collection[str]
) -> Iterator[Problem]:
    """Tell of names that are no keys, and of keys that came before."""
    if unknown:
        yield Problem("E104", None, f"keys must be {keys}; others {listed(unknown)}")
    if twice:
        yield Problem("E105", None, f"an object may come once; repeated members {listed(twice)}")
