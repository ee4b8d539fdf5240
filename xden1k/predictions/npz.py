"""Reading ``.npz`` files that strangers send, and writing them byte for byte alike.

Nothing is decompressed before its size is known from the zip directory, nothing is unpickled and
nothing is extracted to disk. Sizes, shapes and dtypes come from the directory and from the first
bytes of each member; a member is read whole only when asked for.
"""

from __future__ import annotations

import io
import re
import struct
import zipfile
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import BinaryIO, Final

import numpy as np
from jaxtyping import Shaped

from xden1k.errors import DataError

__all__ = ["BadArchiveError", "Member", "NpzReader", "check_size", "write_member"]

MAX_DIRECTORY_BYTES: Final = 2 << 20
"""Names at least 10,000 members; 35,000, the most it can, are looked at in a second or two."""
MAX_HEADER_BYTES: Final = 1024
"""NumPy's own headers of plain arrays take 128 bytes."""
MAX_DEFLATE_RATIO: Final = 1032
"""No deflate stream expands further (zlib's technical notes), so a larger claim is a lie."""

_LOCAL_HEADER_BYTES: Final = 30
"""Before each member's name and data."""
_MAGIC: Final = b"\x93NUMPY"
_HEADER: Final = re.compile(
    r"\{\s*'descr':\s*'(?P<dtype>[^']{1,20})',\s*'fortran_order':\s*(?P<fortran>True|False),"
    r"\s*'shape':\s*\((?P<shape>(?:\d{1,9}, ?){0,8}(?:\d{1,9})?)\),?\s*\}\s*"
)
_READ_ERRORS: Final = (
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
    EOFError,
    OSError,
    ValueError,
    NotImplementedError,
    RuntimeError,
)
"""What zipfile raises on files that are damaged, encrypted or forged."""


class BadArchiveError(DataError):
    """An archive, or one member of it, cannot be used.

    Parameters
    ----------
    code
        E101 to E105, E401 or E402.
    message
        What was expected and what came.
    """

    def __init__(self, code: str, message: str) -> None:
        super().__init__(message)
        self.code = code


@dataclass(frozen=True, slots=True)
class Member:
    """An array of the archive, as its header describes it.

    Parameters
    ----------
    info
        Its entry in the zip directory.
    dtype
        NumPy's code, such as ``<f4``.
    shape
        Of the array.
    fortran_order
        True if the first axis runs fastest.
    start
        Bytes before the values.
    """

    info: zipfile.ZipInfo
    dtype: str
    shape: tuple[int, ...]
    fortran_order: bool
    start: int


class NpzReader:
    """An open ``.npz`` file.

    Parameters
    ----------
    stream
        The file, open for reading, seekable. It is not closed here.

    Attributes
    ----------
    entries
        The zip directory, in file order.

    Raises
    ------
    BadArchiveError
        E101 if it is not a zip file, or not one of a plain kind, or its members overlap; E102
        if its directory is larger than 2 MiB.
    """

    def __init__(self, stream: BinaryIO) -> None:
        start = _check_directory(stream)
        try:
            self._zip = zipfile.ZipFile(stream)
        except _READ_ERRORS as err:
            raise BadArchiveError("E101", f"not a readable .npz: {str(err)[:120]}") from err
        self.entries = tuple(self._zip.infolist())
        _check_places(self.entries, start)

    def member(self, info: zipfile.ZipInfo) -> Member:
        """Describe an entry by the directory and its first bytes; see :func:`check_size`.

        Parameters
        ----------
        info
            One of ``entries``.

        Raises
        ------
        BadArchiveError
            E101 to E104.
        """
        _check_entry(info)
        return _parse_header(info, self._first_bytes(info, MAX_HEADER_BYTES))

    def read(self, member: Member) -> Shaped[np.ndarray, "..."]:
        """Read the values of a member, checked against its checksum.

        Raises
        ------
        BadArchiveError
            E101 if it is damaged or cut short.
        """
        data = self._first_bytes(member.info, member.info.file_size)
        if len(data) != member.info.file_size:
            raise BadArchiveError(
                "E101", f"cut short: {len(data)} of {member.info.file_size} bytes"
            )
        values = np.frombuffer(data, member.dtype, offset=member.start)
        return values.reshape(member.shape, order="F" if member.fortran_order else "C")

    def _first_bytes(self, info: zipfile.ZipInfo, count: int) -> bytes:
        """Decompress the start of a member; the checksum is verified at its end."""
        try:
            with self._zip.open(info) as stream:
                return stream.read(count)
        except _READ_ERRORS as err:
            raise BadArchiveError("E101", f"damaged: {str(err)[:120]}") from err


def write_member(archive: zipfile.ZipFile, name: str, values: Shaped[np.ndarray, "..."]) -> None:
    """Append an array as ``name.npy``, deflated, without time stamp or platform.

    Parameters
    ----------
    archive
        Open for writing.
    name
        Of the member, without ``.npy``.
    values
        No objects.
    """
    info = zipfile.ZipInfo(f"{name}.npy", date_time=(1980, 1, 1, 0, 0, 0))
    info.compress_type = zipfile.ZIP_DEFLATED
    info.create_system = 3
    info.external_attr = 0o644 << 16
    buffer = io.BytesIO()
    np.lib.format.write_array(buffer, values, version=(1, 0), allow_pickle=False)
    archive.writestr(info, buffer.getvalue())


def _check_directory(stream: BinaryIO) -> int:
    """Find where the directory starts; refuse what the end record of a plain archive cannot say.

    The record is read by hand because zipfile reads the whole directory at once, however large,
    and follows a zip64 record whether or not it is needed.
    """
    size = stream.seek(0, io.SEEK_END)
    stream.seek(max(0, size - 42))
    tail = stream.read(42)
    end = tail[-22:]
    stream.seek(0)
    if stream.read(4) not in (b"PK\x03\x04", b"PK\x05\x06"):
        raise BadArchiveError("E101", "not a readable .npz: it does not start as a zip file")
    if len(end) < 22 or end[:4] != b"PK\x05\x06" or end[20:] != b"\0\0":
        raise BadArchiveError(
            "E101", "not a readable .npz: no zip directory at the end of the file"
        )
    if tail[:-22].startswith(b"PK\x06\x07"):
        raise BadArchiveError("E101", "not a readable .npz: zip64 directories are not accepted")
    directory_bytes, start = struct.unpack("<LL", end[12:20])
    if directory_bytes > MAX_DIRECTORY_BYTES:
        raise BadArchiveError(
            "E102",
            f"the zip directory takes {directory_bytes} bytes, at most {MAX_DIRECTORY_BYTES}",
        )
    if start + directory_bytes + 22 != size:
        raise BadArchiveError(
            "E101", f"not a readable .npz: its directory is not at byte {start}, as it says"
        )
    return int(start)


def _check_places(entries: Iterable[zipfile.ZipInfo], end: int) -> None:
    """Refuse members that share bytes: a small file could then be made to be read for ever."""
    free = 0
    for info in sorted(entries, key=lambda info: info.header_offset):
        if info.header_offset < free:
            raise BadArchiveError("E101", "not a readable .npz: members overlap")
        free = info.header_offset + _LOCAL_HEADER_BYTES + info.compress_size
    if free > end:
        raise BadArchiveError("E101", "not a readable .npz: a member reaches beyond the directory")


def _check_entry(info: zipfile.ZipInfo) -> None:
    """Refuse an entry by what the zip directory says of it."""
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise BadArchiveError(
            "E101", f"compression method {info.compress_type}, must be stored or deflated"
        )
    if info.flag_bits & 0x1:
        raise BadArchiveError("E101", "encrypted")
    if info.file_size > MAX_DEFLATE_RATIO * info.compress_size:
        raise BadArchiveError(
            "E102", f"declares {info.file_size} bytes from {info.compress_size} compressed ones"
        )


def _parse_header(info: zipfile.ZipInfo, head: bytes) -> Member:
    """Read an ``.npy`` header without evaluating it as Python."""
    if not head.startswith(_MAGIC) or len(head) < 12 or head[6] not in (1, 2, 3):
        raise BadArchiveError("E104", "not an .npy array")
    length, first = (
        (struct.unpack("<H", head[8:10])[0], 10)
        if head[6] == 1
        else (struct.unpack("<L", head[8:12])[0], 12)
    )
    found = _HEADER.fullmatch(head[first : first + length].decode("latin-1"))
    if first + length > len(head) or found is None:
        raise BadArchiveError("E104", "its .npy header is not that of a plain array")
    shape = tuple(int(edge) for edge in found["shape"].split(",") if edge.strip())
    dtype = found["dtype"]
    if dtype.endswith("O"):
        raise BadArchiveError("E103", "an object array, which would have to be unpickled")
    return Member(info, dtype, shape, found["fortran"] == "True", first + length)


def check_size(member: Member, max_bytes: int, dtypes: str, in_words: str) -> None:
    """Refuse a dtype that is not a plain one, and values too many or too few for the member.

    Parameters
    ----------
    member
        Of an archive.
    max_bytes
        The most its values may take.
    dtypes
        Pattern of the dtypes that it may have.
    in_words
        The same for people.

    Raises
    ------
    BadArchiveError
        E101, E102, E401.
    """
    if not re.fullmatch(dtypes, member.dtype):
        raise BadArchiveError("E401", f"dtype must be {in_words}, got {member.dtype!a}")
    if (size := member.info.file_size) > (most := max_bytes + MAX_HEADER_BYTES):
        raise BadArchiveError("E102", f"declares {size} bytes, at most {most}")
    count = 1
    for edge in member.shape:
        count *= edge
    expected = member.start + count * np.dtype(member.dtype).itemsize
    if expected != member.info.file_size:
        raise BadArchiveError(
            "E101",
            f"shape {member.shape} of {member.dtype} needs {expected} bytes, "
            f"the member has {member.info.file_size}",
        )
