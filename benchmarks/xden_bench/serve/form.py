"""A form with one file, as a browser sends it, taken apart as it comes."""

from __future__ import annotations

from typing import IO, Final

from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header

from xden_bench.serve.tickets import TurnedAwayError

__all__ = ["FORM_BYTES", "Form", "no_file"]

FORM_BYTES: Final = 8192
"""The most that a form has beside its file."""


class Form:
    """Takes ``multipart/form-data`` apart.

    Parameters
    ----------
    content_type
        Of the request.
    file
        Where the form's file is written.

    Attributes
    ----------
    filename : str
        As the sender calls the file; empty until it comes.
    fields : dict of str to str
        Everything else.

    Raises
    ------
    TurnedAwayError
        If it is no such form.
    """

    def __init__(self, content_type: str, file: IO[bytes]) -> None:
        kind, options = parse_options_header(content_type)
        if kind != b"multipart/form-data" or not options.get(b"boundary"):
            raise no_file()
        self.filename, self.fields = "", dict[str, str]()
        self._file, self._beside = file, 0
        self._header, self._headers = b"", dict[bytes, bytes]()
        self._name: str | None = None
        self._parser = MultipartParser(
            options[b"boundary"],
            {
                "on_part_begin": self._begin,
                "on_header_field": self._header_name,
                "on_header_value": self._header_value,
                "on_header_end": self._header_end,
                "on_headers_finished": self._part,
                "on_part_data": self._data,
            },
        )

    def write(self, piece: bytes) -> None:
        """Take the next piece of the request.

        Raises
        ------
        TurnedAwayError
            If it is no such form, or has more than one file.
        """
        try:
            self._parser.write(piece)
        except FormParserError as err:
            raise no_file() from err

    def _begin(self) -> None:
        self._headers = {}

    def _header_name(self, data: bytes, start: int, end: int) -> None:
        self._count(end - start)
        self._header += data[start:end].lower()

    def _header_value(self, data: bytes, start: int, end: int) -> None:
        self._count(end - start)
        self._headers[self._header] = self._headers.get(self._header, b"") + data[start:end]

    def _header_end(self) -> None:
        self._header = b""

    def _part(self) -> None:
        """Begin a field, or the file."""
        _, options = parse_options_header(self._headers.get(b"content-disposition"))
        if (filename := options.get(b"filename")) is None:
            self._name = _text(options.get(b"name", b""))
            self.fields[self._name] = ""
            return
        if self._file.tell():
            raise no_file()
        self._name, self.filename = None, _text(filename)

    def _data(self, data: bytes, start: int, end: int) -> None:
        if self._name is None:
            self._file.write(data[start:end])
            return
        self._count(end - start)
        self.fields[self._name] += _text(data[start:end])

    def _count(self, size: int) -> None:
        """Bound what is kept in memory."""
        self._beside += size
        if self._beside > FORM_BYTES:
            raise no_file()


def no_file() -> TurnedAwayError:
    """Return what is said to a form without a file."""
    return TurnedAwayError("no_file", "choose one file first")


def _text(data: bytes) -> str:
    return data.decode("utf-8", errors="replace")
