"""What the two processes say to each other, over a pair of pipes.

Towards the method go pickles. From it come lines of JSON, so that nothing it sends is run here.
"""

from __future__ import annotations

import json
import pickle
from collections.abc import Iterator, Mapping
from typing import IO, Any, Final

from xden1k.errors import (
    DataError,
    MissingExtraError,
    MissingObjectError,
    ObjectError,
    XDenError,
)
from xden1k.values.modality import ModalityError

__all__ = ["read_pickle", "read_requests", "told", "untold", "write_pickle", "write_request"]

_TOLD: Final = (DataError, MissingExtraError, MissingObjectError, ModalityError, ObjectError)
_KINDS: Final = {kind.__name__: kind for kind in _TOLD}


def write_pickle(stream: IO[bytes], value: object) -> None:
    """Send a value towards the method."""
    pickle.dump(value, stream, protocol=pickle.HIGHEST_PROTOCOL)
    stream.flush()


def read_pickle(stream: IO[bytes]) -> Any:
    """Receive a value, in the method's process.

    Raises
    ------
    EOFError
        If the other process is gone.
    """
    return pickle.load(stream)  # noqa: S301, from the process that started this one


def write_request(stream: IO[bytes], values: Mapping[str, Any]) -> None:
    """Send a line from the method's process."""
    stream.write(json.dumps(values).encode() + b"\n")
    stream.flush()


def read_requests(stream: IO[bytes]) -> Iterator[dict[str, Any]]:
    """Receive lines until the method's process is gone.

    Raises
    ------
    DataError
        If one is no JSON object.
    """
    for line in stream:
        try:
            values = json.loads(line)
        except ValueError as err:
            raise DataError(f"the method's process sent no JSON: {line[:60]!r}") from err
        if not isinstance(values, dict):
            raise DataError(f"the method's process sent no JSON object: {line[:60]!r}")
        yield values


def told(error: XDenError) -> tuple[str, str]:
    """Return kind and message of an error, for the other process."""
    return type(error).__name__, str(error)


def untold(kind: str, message: str) -> XDenError:
    """Return the error that the other process told of."""
    return _KINDS.get(kind, DataError)(message)
