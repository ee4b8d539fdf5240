"""Places of captures, work files and datasets: a path is used as it is, a URL through fsspec.

A :class:`~pathlib.Path` is seen by every process. Of a URL (``s3://...``, ``gs://...``,
``file://...``) the files of one object are copied into a temporary folder, and what is finished
is copied back.
"""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path

from fsspec.core import url_to_fs

from xden1k.errors import DataError
from xden1k.folder import refuse_to_replace_others
from xden1k.format.manifest import MANIFEST_NAME
from xden_builder.capture import CaptureFolder, ObjectRow, read_scanner

__all__ = [
    "FULL",
    "UNFINISHED",
    "Place",
    "absolute",
    "beside",
    "dataset_path",
    "inside",
    "make_folder",
    "object_capture",
    "object_rows",
    "place",
    "read_bytes",
    "refuse_other_folders",
    "room_for",
    "size_of",
    "write_bytes",
]

Place = Path | str
"""A path, or an fsspec URL."""

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Error numbers of a disk, a quota or a file that takes no more."""

UNREAD = ("ct.npz", "truth.json")
"""Files of an object that a rebuild does not open."""
UNFINISHED = ".partial"
"""Ending of files that are being written."""
TEMPORARY = "xden-build-"
"""Prefix of temporary folders."""


def place(text: str) -> Place:
    """Tell a URL from a path.

    Examples
    --------
    >>> place("s3://bucket/captures"), place("captures").name
    ('s3://bucket/captures', 'captures')
    """
    return text if "://" in text else Path(text)


def absolute(folder: Place) -> Place:
    """Name a folder so that a process in another working folder finds it."""
    return folder.absolute() if isinstance(folder, Path) else folder


def inside(folder: Place, name: str) -> Place:
    """Name a file of a folder."""
    return folder / name if isinstance(folder, Path) else f"{folder.rstrip('/')}/{name}"


def beside(folder: Place, ending: str) -> Place:
    """Name a folder beside another: the same name with an ending.

    Examples
    --------
    >>> beside("s3://bucket/dataset/", ".work")
    's3://bucket/dataset.work'
    """
    if isinstance(folder, Path):
        return folder.with_name(f"{folder.name}{ending}")
    return f"{folder.rstrip('/')}{ending}"


def make_folder(folder: Place) -> None:
    """Make a folder and its parents where they are missing."""
    if isinstance(folder, Path):
        folder.mkdir(parents=True, exist_ok=True)
    else:
        fs, root = url_to_fs(folder)
        fs.makedirs(root, exist_ok=True)


def size_of(folder: Place) -> int:
    """Bytes of the files in a folder."""
    if isinstance(folder, Path):
        return sum(path.stat().st_size for path in folder.iterdir())
    fs, root = url_to_fs(folder)
    return int(fs.du(root))


def read_bytes(file: Place) -> bytes | None:
    """Content of a file; None if there is none."""
    try:
        if isinstance(file, Path):
            return file.read_bytes()
        fs, path = url_to_fs(file)
        return bytes(fs.cat_file(path))
    except FileNotFoundError:
        return None


def write_bytes(file: Place, content: bytes) -> None:
    """Write a file; at a path it is there whole or not at all.

    Raises
    ------
    OSError
        If that fails; of a full disk it says what is missing.
    """
    if not isinstance(file, Path):
        fs, path = url_to_fs(file)
        fs.pipe_file(path, content)
        return
    unfinished = file.with_name(f"{file.name}.{uuid.uuid4().hex}{UNFINISHED}")
    with room_for(file.name, file.parent, lambda: len(content)):
        try:
            unfinished.write_bytes(content)
            os.replace(unfinished, file)
        finally:
            unfinished.unlink(missing_ok=True)


@contextmanager
def room_for(what: str, folder: Path, size: Callable[[], int]) -> Iterator[None]:
    """Turn the error of a full disk into one line that says what to do.

    Parameters
    ----------
    what
        Is being written.
    folder
        Where to; it must exist.
    size
        Gives the bytes that takes.

    Raises
    ------
    OSError
        The one that came, of a full disk with our message.
    """
    try:
        yield
    except OSError as err:
        if err.errno not in FULL:
            raise
        needed, free = size() / 1e6, shutil.disk_usage(folder).free / 1e6
        told = (
            f"{os.strerror(err.errno)}: {what} takes about {needed:.1f} MB, {free:.1f} MB are "
            "free; make room and run again, finished objects are kept"
        )
        raise OSError(err.errno, told, str(folder)) from err


def object_rows(captures: Place) -> Mapping[str, ObjectRow]:
    """Rows of ``objects.csv`` by object id.

    Raises
    ------
    DataError
        If it is missing or wrong.
    """
    with _on_this_machine(captures, lambda url, root: _copy(url, ["objects.csv"], root)) as root:
        return CaptureFolder(root).rows


@contextmanager
def object_capture(captures: Place, parts: Place | None, row: ObjectRow) -> Iterator[CaptureFolder]:
    """Give the capture folder of one object on this machine, with its other part meshes if any.

    Raises
    ------
    DataError
        If its ``scanner.toml``, which says what else to copy, is wrong. What the caller's block
        says of a temporary copy is said of the URL.
    """
    rows = {row.object_id: row}
    with ExitStack() as stack:
        copy = partial(_copy_object, row.object_id)
        root = stack.enter_context(_on_this_machine(captures, copy))
        other = stack.enter_context(_on_this_machine(parts, copy)) if parts is not None else None
        yield CaptureFolder(root, other, rows)


def refuse_other_folders(out: Place) -> None:
    """Check that a dataset folder may be written at a place: nothing is there, or an older one.

    Raises
    ------
    DataError
        If something else is there.
    """
    if isinstance(out, Path):
        refuse_to_replace_others(out)
        return
    fs, root = url_to_fs(out)
    if fs.exists(root) and fs.find(root) and not fs.exists(f"{root}/{MANIFEST_NAME}"):
        raise DataError(f"{out} is not a dataset folder: remove it yourself, or choose another")


@contextmanager
def dataset_path(out: Place) -> Iterator[Path]:
    """Give the path to write a dataset folder at; for a URL it is then copied there.

    A URL cannot appear at once: its ``manifest.json``, without which a folder is no dataset, is
    empty from before the first file until after the last.
    """
    if isinstance(out, Path):
        yield out
        return
    with tempfile.TemporaryDirectory(prefix=TEMPORARY) as temporary:
        folder = Path(temporary) / "dataset"
        yield folder
        _put_dataset(folder, out)


def _put_dataset(folder: Path, url: str) -> None:
    fs, root = url_to_fs(url)
    files = [path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()]
    targets = {f"{root}/{name}": str(folder / name) for name in files}
    manifest = f"{root}/{MANIFEST_NAME}"
    for parent in sorted({path.rpartition("/")[0] for path in targets}):
        fs.makedirs(parent, exist_ok=True)
    fs.pipe_file(manifest, b"")
    for stale in set(fs.find(root)) - set(targets):
        fs.rm_file(stale)
    for path in sorted(set(targets) - {manifest}):
        fs.put_file(targets[path], path)
    fs.put_file(targets[manifest], manifest)


@contextmanager
def _on_this_machine(folder: Place, copy: Callable[[str, Path], None]) -> Iterator[Path]:
    """Give the path itself, or for a URL a temporary folder that is filled from it."""
    if isinstance(folder, Path):
        yield folder
        return
    with tempfile.TemporaryDirectory(prefix=TEMPORARY) as root:
        try:
            copy(folder, Path(root))
            yield Path(root)
        except DataError as err:
            raise DataError(str(err).replace(root, folder.rstrip("/"))) from err


def _copy_object(object_id: str, url: str, root: Path) -> None:
    """Copy what a rebuild of one object may open."""
    fs, base = url_to_fs(url)
    names = [path.removeprefix(f"{base}/") for path in fs.find(inside(base, object_id))]
    read = [name for name in names if name.rpartition("/")[2] not in UNREAD]
    _copy(url, [*read, "scanner.toml"], root)
    for scanner in (root / object_id / "scanner.toml", root / "scanner.toml"):
        if scanner.is_file():
            views = read_scanner(scanner, root / object_id).views.values()
            sources = {source for view in views for source in (view.flat, view.dark)}
            _copy(url, [source for source in sources if isinstance(source, str)], root)
            return


def _copy(url: str, names: Iterable[str], root: Path) -> None:
    """Copy the files that are there; whoever reads says which he misses."""
    for name in names:
        content = read_bytes(inside(url, name))
        if content is not None:
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            write_bytes(root / name, content)
