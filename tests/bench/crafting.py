"""Tools to craft submissions that are not what they seem, and the register of those there are."""

from __future__ import annotations

import io
import json
import os
import struct
import warnings
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from tests.phantoms import BAR, box_object
from xden1k.folder import write_folder

__all__ = ["CASES", "LANDMINE", "Case", "Sound", "npy", "raw_npy", "two_bars", "zipped"]

LANDMINE = "xden1k-landmine"
"""The file that every payload here tries to make, in the folder that it is run in."""
Members = Sequence[tuple[str, bytes]]


def npy(values: np.ndarray, *, allow_pickle: bool = False) -> bytes:
    """An array as an ``.npy`` file."""
    buffer = io.BytesIO()
    np.lib.format.write_array(buffer, values, allow_pickle=allow_pickle)
    return buffer.getvalue()


def raw_npy(header: str, data: bytes = b"", version: int = 1) -> bytes:
    """An ``.npy`` file with any header at all."""
    text = header.encode("utf-8") + b"\n"
    length = struct.pack("<H" if version == 1 else "<L", len(text))
    return b"\x93NUMPY" + bytes([version, 0]) + length + text + data


def header_of(shape: str = "(64, 64, 64)", dtype: str = "'<f4'", fortran: str = "False") -> str:
    """The text of a header, each entry as Python would write it."""
    return f"{{'descr': {dtype}, 'fortran_order': {fortran}, 'shape': {shape}, }}"


def zipped(members: Members, method: int = zipfile.ZIP_DEFLATED) -> bytes:
    """A zip file, repeated names included."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", method) as out, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name, data in members:
            info = zipfile.ZipInfo(name)
            info.filename = name  # not cut at a NUL byte
            info.compress_type = method
            out.writestr(info, data)
    return buffer.getvalue()


class Trap:
    """Makes the landmine if it is ever unpickled."""

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (Path(LANDMINE),)


def two_bars(root: Path) -> Path:
    """Write a dataset of two objects: one for what is wrong, one beside it."""
    bars = [box_object(name, BAR, split="test", category="bar") for name in ("bar-1", "bar-2")]
    write_folder(bars, root, version="0.1.0", builder="tests")
    return root


@dataclass(frozen=True)
class Sound:
    """A submission without a flaw, to be spoilt.

    Parameters
    ----------
    meta
        Its meta data.
    grids
        Object id and prediction, float16.
    """

    meta: dict[str, Any]
    grids: dict[str, np.ndarray]

    @property
    def first(self) -> str:
        """The object that is tampered with."""
        return next(iter(self.grids))

    @property
    def grid(self) -> np.ndarray:
        """Its prediction."""
        return self.grids[self.first]

    def members(
        self, data: bytes | None = None, name: str | None = None, **meta: Any
    ) -> list[tuple[str, bytes]]:
        """Name and content of every member: the first object's replaced, the meta data changed."""
        values = {key: one for key, one in {**self.meta, **meta}.items() if one is not None}
        arrays = [(f"density/{key}.npy", npy(grid)) for key, grid in self.grids.items()]
        arrays[0] = (name or arrays[0][0], arrays[0][1] if data is None else data)
        return [("__meta__.npy", npy(np.array(json.dumps(values)))), *arrays]

    def with_meta(self, data: bytes) -> bytes:
        """The file with other content in ``__meta__``."""
        return zipped([("__meta__.npy", data), *self.members()[1:]])

    def with_text(self, text: str) -> bytes:
        """The file with another text in ``__meta__``."""
        return self.with_meta(npy(np.array(text)))

    def with_value(self, value: float | np.ndarray, dtype: str = "<f4", **meta: Any) -> bytes:
        """The file with one voxel of the first object changed, outside the object."""
        grid = self.grid.astype(dtype)
        grid[0, 1, 2] = value
        return zipped(self.members(npy(grid), **meta))

    def with_bits(self, bits: int) -> bytes:
        """The same, the value given by its float32 bits."""
        grid = self.grid.astype("<f4")
        grid.view("<u4")[0, 1, 2] = bits
        return zipped(self.members(npy(grid)))

    def scaled(self, factor: float, dtype: str = "<f4", **meta: Any) -> bytes:
        """The file with every value times a factor."""
        with np.errstate(over="ignore"):
            grids = {
                key: (grid.astype("<f8") * factor).astype(dtype) for key, grid in self.grids.items()
            }
        return zipped(Sound(self.meta, grids).members(**meta))

    @cached_property
    def bytes(self) -> bytes:
        """The file as it should be."""
        return zipped(self.members())


Maker = Callable[[Sound], bytes]


@dataclass(frozen=True)
class Case:
    """One hostile submission.

    Parameters
    ----------
    codes
        All that must be told of it; empty if it looks strange and is sound.
    make
        Its bytes, from a sound submission.
    is_variant
        Whether it is left to the slow tests: of those told the same, three of four are.
    """

    codes: frozenset[str]
    make: Maker
    is_variant: bool = False

    @property
    def is_refused(self) -> bool:
        """True if an error must be told."""
        return any(code.startswith("E") for code in self.codes)

    def write(self, sound: Sound, path: Path) -> None:
        """Put it at a path."""
        path.write_bytes(self.make(sound))


class Pipe(Case):
    """A named pipe that nobody writes to."""

    def write(self, sound: Sound, path: Path) -> None:
        """Put it at a path."""
        os.mkfifo(path)


CASES: dict[str, Case] = {"named pipe": Pipe(frozenset({"E101"}), lambda sound: b"")}


def add(name: str, codes: str, make: Maker) -> None:
    """Enter a case; ``codes`` are separated by blanks."""
    assert name not in CASES, name
    told = frozenset(codes.split())
    alike = sum(case.codes == told for case in CASES.values())
    CASES[name] = Case(told, make, is_variant=alike % 4 > 0)


def case(codes: str) -> Callable[[Maker], Maker]:
    """Enter the decorated maker, named as the function is."""

    def enter(make: Maker) -> Maker:
        add(make.__name__.replace("_", " "), codes, make)
        return make

    return enter


def replaced(codes: str, files: dict[str, bytes]) -> None:
    """Enter cases in which a member's content is replaced."""
    for name, data in files.items():
        add(name, codes, lambda sound, data=data: zipped(sound.members(data)))
