"""The fastest store there is: decoded samples in one file that is mapped into memory."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
import torch
from torch.utils.data import Dataset

from xden1k.access.dataset import Sample, XDen1K

__all__ = ["RawCopy"]

ALIGNMENT = 64
"""Bytes; a cache line."""


class _Place(NamedTuple):
    """Where an array lies in the file."""

    start: int
    stop: int
    dtype: np.dtype[Any]
    shape: tuple[int, ...]


class RawCopy(Dataset[Sample]):
    """The samples of a dataset as they are handed out, read through ``np.memmap``.

    Arrays are copied out of the map, so that a sample is the reader's own, as those of
    :class:`xden1k.XDen1K` are; all that is no tensor stays in memory.

    Parameters
    ----------
    source
        Whose samples to copy.
    path
        The file to make.
    """

    def __init__(self, source: XDen1K, path: Path) -> None:
        self._path = path
        with path.open("wb") as file:
            self._samples = [
                {name: _stored(value, file) for name, value in source[index].items()}
                for index in range(len(source))
            ]

    def __getstate__(self) -> dict[str, Any]:  # a map would be pickled with all that it shows
        return {name: value for name, value in self.__dict__.items() if name != "_bytes"}

    @cached_property
    def _bytes(self) -> np.memmap[Any, np.dtype[np.uint8]]:
        return np.memmap(self._path, np.uint8, "r")

    def __len__(self) -> int:
        return len(self._samples)

    def __getitem__(self, index: int) -> Sample:
        return self.read(index, list(self._samples[index]))

    def read(self, index: int, fields: Sequence[str]) -> Sample:
        """Return some fields of a sample."""
        stored = self._samples[index]
        return {name: self._value(stored[name]) for name in fields}

    def sample_bytes(self, fields: Sequence[str]) -> float:
        """Bytes of some fields of a sample, in the mean."""
        stored = (sample[name] for sample in self._samples for name in fields)
        places = [value for value in stored if isinstance(value, _Place)]
        return sum(place.stop - place.start for place in places) / len(self)

    def _value(self, stored: Any) -> Any:
        if not isinstance(stored, _Place):
            return stored
        copy = np.array(self._bytes[stored.start : stored.stop])
        return torch.from_numpy(copy.view(stored.dtype).reshape(stored.shape))


def _stored(value: Any, file: BinaryIO) -> Any:
    if not isinstance(value, torch.Tensor):
        return value
    array = value.numpy()
    file.write(bytes(-file.tell() % ALIGNMENT))
    start = file.tell()
    file.write(array.tobytes())
    return _Place(start, file.tell(), array.dtype, array.shape)
