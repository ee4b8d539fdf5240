"""Every entry and its rank, as of now: read without a lock, computed beside the readers.

Verifying an entry and ranking a table take seconds of bootstraps. Both are done once for each
content (:mod:`xden_bench.serve.kept`), in processes of their own, and what readers see is a
:class:`Snapshot` that never changes: a new one takes its place whole.
"""

from __future__ import annotations

import logging
import multiprocessing
import multiprocessing.connection
import os
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Final

from xden1k.errors import DataError
from xden_bench.entries.leaderboard import tables
from xden_bench.entries.merging import entries_of, holds
from xden_bench.entries.ranking import Entry, ranks, trusted_metrics
from xden_bench.entries.reading import read_entry, read_sound_entries
from xden_bench.entries.result import entry_path, entry_paths
from xden_bench.entries.untrusted import read_limited, read_table
from xden_bench.serve.kept import Kept, entry_key, key_of
from xden_bench.serve.limits import be_modest

__all__ = ["Snapshot", "Standings", "Table", "place_of"]

logger = logging.getLogger(__name__)

Files = tuple[tuple[str, int, int], ...]
Compute = Callable[..., Callable[[], Any]]
"""Begins some work, given a function and what it is about; what is returned waits for its end."""

POLL_S: Final = 0.5
"""How often the folder of the results is looked at."""
_MEMORY_BYTES: Final = 2 * 10**9
"""Of a process that verifies and ranks: the files are anybody's."""
_OBJECTS: Final = "object_scores"


@dataclass(frozen=True, eq=False)
class Table:
    """Rows that are compared with each other.

    Parameters
    ----------
    rows
        The best first, without the scores of their objects.
    ranks
        Of each row, as :func:`xden_bench.entries.ranking.ranks` gives them.
    """

    rows: tuple[Entry, ...]
    ranks: tuple[int | None, ...]

    def rank_of(self, row: Entry) -> int | None:
        """Rank of one of the rows."""
        return self.ranks[self.rows.index(row)]


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The results at one moment.

    Parameters
    ----------
    entries
        Every entry, sorted by path, without the scores of its objects.
    tables
        The same entries as tables.
    is_current
        Whether this is what the files say; they may have been spoilt since.
    """

    entries: tuple[Entry, ...] = ()
    tables: tuple[Table, ...] = ()
    is_current: bool = True

    def row_of(self, place: str) -> tuple[Table, Entry] | None:
        """Return the row that is made of an entry, given its place among the results."""
        path = Path(f"{place}.json")
        found = ((table, row) for table in self.tables for row in table.rows if holds(row, path))
        return next(found, None)


class Standings:
    """Keeps :attr:`now` up to date. Use it as a context manager.

    Parameters
    ----------
    results
        Folder of the entries.
    kept
        Folder for what was verified and ranked.
    workers
        Processes that verify and rank; 0 = none, in the thread that watches.
    """

    def __init__(self, results: Path, kept: Path, *, workers: int | None = None) -> None:
        self.results = results
        self.now = Snapshot()
        self._kept = Kept(kept)
        self._workers = (os.cpu_count() or 1) if workers is None else workers
        self._files: Files | None = None
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="standings", daemon=True)

    def refresh(self) -> None:
        """Read what has changed, if anything has; returns when :attr:`now` has it.

        An entry that cannot be trusted is left out, with a line in the log; a folder that cannot be
        read leaves the entries as they were.
        """
        files = _files(self.results)
        if files == self._files:
            return
        try:
            self.now = self._snapshot()
        except BrokenExecutor as err:
            logger.error("a process that verifies entries ended, another will try: %s", err)
            return
        except (DataError, OSError) as err:
            logger.error("the results cannot be read: %s", err)
            self.now = replace(self.now, is_current=False)
        except Exception:
            logger.exception("the results cannot be ranked: the tables stay as they were")
            self.now = replace(self.now, is_current=False)
        self._files = files

    def __enter__(self) -> Standings:
        """Begin to watch the folder."""
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stopping.set()
        self._thread.join()

    def _watch(self) -> None:
        while not self._stopping.wait(POLL_S):
            self.refresh()

    def _snapshot(self) -> Snapshot:
        keys: dict[Path, str] = {}
        with self._computing() as compute:
            paths = entry_paths(self.results, strict=False)
            waiting = {path: self._entry(path, keys, compute) for path in paths}

            def read(path: Path, _: Path) -> Any:
                return (waiting.get(path) or self._entry(path, keys, compute))()

            entries, problems = read_sound_entries(self.results, read)
            for problem in problems:
                logger.error("left out: %s", problem)
            whole = [{**one, _OBJECTS: _objects(one, self.results)} for one in entries]
            ranked = [self._table(rows, keys, compute) for rows in tables(whole)]
        self._kept.keep_only([*keys.values(), *(key for key, _ in ranked)])
        return Snapshot(entries, tuple(table for _, table in ranked))

    def _entry(self, path: Path, keys: dict[Path, str], compute: Compute) -> Callable[[], Any]:
        """Begin to verify an entry, unless it was; what is returned waits for it."""
        try:
            key = keys[path] = entry_key(path, self.results)
        except OSError as err:
            return partial(_fail, err)
        if key in self._kept:
            return lambda: self._kept[key]
        finish = compute(_verified, path, self.results)

        def entry() -> Any:
            found = finish()
            if entry_key(path, self.results) == key:  # else it was changed meanwhile
                self._kept[key] = found
            return found

        return entry

    def _table(
        self, rows: Sequence[Entry], keys: Mapping[Path, str], compute: Compute
    ) -> tuple[str, Table]:
        """Rank a table, or find how it was ranked."""
        parts = [one for row in rows for one in entries_of(row)]
        key = key_of("ranks", *(keys[self.results / entry_path(one)] for one in parts))
        if key not in self._kept:
            self._kept[key] = compute(ranks, rows)()
        return key, Table(tuple(map(_light, rows)), tuple(self._kept[key]))

    @contextmanager
    def _computing(self) -> Iterator[Compute]:
        """Give what computes something beside this thread; nothing is started before it is used."""
        if not self._workers:
            yield lambda work, *about: lambda: work(*about)
            return
        spawn = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(self._workers, mp_context=spawn, initializer=_begin) as pool:
            yield lambda work, *about: _submitted(pool, work, *about)


def _fail(error: OSError) -> Any:
    raise error


def place_of(row: Entry) -> str:
    """Where an entry lies among the results, without its suffix: the name of a row in links."""
    return entry_path(row).with_suffix("").as_posix()


def _begin() -> None:
    """Let the web server go first, take little memory, and end with it, however it ends."""
    be_modest(_MEMORY_BYTES)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    multiprocessing.connection.wait([parent.sentinel])
    os._exit(1)


def _submitted(pool: Executor, work: Callable[..., Any], *about: Any) -> Callable[[], Any]:
    return pool.submit(work, *about).result


def _verified(path: Path, results: Path) -> Entry:
    """Read an entry, all of it checked, without the scores of its objects."""
    try:
        return _light(read_entry(path, results))
    except MemoryError as err:  # what a file says of its size is not to be believed
        raise DataError(f"{path}: takes more memory than an entry may") from err


def _objects(row: Entry, results: Path) -> dict[str, list[Any]]:
    data = read_limited((results / entry_path(row)).with_suffix(".parquet"))
    columns: dict[str, list[Any]] = read_table(data).to_pydict()
    return columns


def _light(entry: Entry) -> Entry:
    """Return an entry without the scores of its objects and without intervals that cover less."""
    light = {key: value for key, value in entry.items() if key != _OBJECTS}
    light["metrics"] = trusted_metrics(entry)
    return light | ({"seeds": [*map(_light, entry["seeds"])]} if "seeds" in entry else {})


def _files(results: Path) -> Files:
    """Name, time and size of every file of the results."""
    found = []
    for folder, _, names in os.walk(results):  # what cannot be listed is not there
        for path in (Path(folder, name) for name in names):
            if path.suffix in (".json", ".parquet", ".toml"):
                with suppress(OSError):  # it was removed meanwhile, or is a link to nothing
                    stat = path.stat()
                    found.append((str(path), stat.st_mtime_ns, stat.st_size))
    return tuple(sorted(found))
