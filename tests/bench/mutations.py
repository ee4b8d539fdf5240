"""Random damage to a sound submission, the same for the same seed.

Half of the mutators know nothing of the format; the others damage one thing and leave the rest of
the archive sound, so that what lies behind the zip's own checks is reached as well.
"""

from __future__ import annotations

import io
import json
import random
import re
import struct
import zipfile
from collections.abc import Callable

import numpy as np

from tests.bench.crafting import header_of, npy, raw_npy, zipped

__all__ = ["mutated"]

_NUMBERS = (0, 1, 2, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)
_WORDS = (
    b"PK\x01\x02", b"PK\x03\x04", b"PK\x05\x06", b"PK\x06\x07", b"\x93NUMPY", b"'descr'", b"<f4",
    b"|O", b"(64, 64, 64)", b"(0,)", b"-1", b"999999999", b"True", b"\0", b"\xff\xff\xff\xff",
    b".npy", b"density/", b"density_sd/", b"part_density/", b"__meta__", b"../", b"nan", b"[[[[",
)  # fmt: skip
_VALUES = (
    None, True, 0, -1, 2**63, 1e999, -1e999, "", "x", "\ud800", "\x1b[0m", "g/cm3", "kg/m3", [],
    ["mesh"], ["parts"], ["xray", "xray"], {}, [[[]]], "density", "apparent_density",
)  # fmt: skip
_NAMES = (
    "__meta__.npy", "density/a.npy", "part_density/bar-1.npy", "density_sd/bar-1.npy", "/",
)  # fmt: skip
_SHAPES = (
    "(64, 64, 64)",
    "(64, 64, 64)",
    "(3,)",
    "()",
    "(0,)",
    "(262144,)",
    "(-1,)",
    "x",
    "(2**9,)",
)
_DTYPES = ("'<f2'", "'<f2'", "'<f4'", "'<f8'", "'>f2'", "'<i2'", "'|O'", "'<U9'", "[('a', '<f2')]")
_HALVES = (b"\0\x7c", b"\1\x7e", b"\1\x7c", b"\0\xfc", b"\0\x80", b"\1\x80", b"\1\0", b"\xff\x7b")
"""Infinity, nan, signalling nan, -infinity, -0, the least negative and positive, 65504."""


def _flip(data: bytearray, draw: random.Random) -> None:
    for _ in range(draw.randint(1, 8)):
        data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)


def _overwrite(data: bytearray, draw: random.Random) -> None:
    for _ in range(draw.randint(1, 4)):
        start = draw.randrange(len(data))
        new = draw.choice(_WORDS)
        data[start : start + len(new)] = new


def _number(data: bytearray, draw: random.Random) -> None:
    start = draw.randrange(max(1, len(data) - 4))
    data[start : start + 4] = struct.pack("<L", draw.choice(_NUMBERS))


def _cut(data: bytearray, draw: random.Random) -> None:
    del data[draw.randrange(len(data)) :]


def _splice(data: bytearray, draw: random.Random) -> None:
    start, end = sorted(draw.randrange(len(data)) for _ in range(2))
    piece = data[start:end]
    if draw.random() < 0.5:
        del data[start:end]
    place = draw.randrange(len(data) + 1)
    data[place:place] = piece


def _zip_header(data: bytearray, draw: random.Random) -> None:
    """Change a field of the directory, of a member's own header or of the end record."""
    mark, size = draw.choice(((b"PK\x01\x02", 46), (b"PK\x03\x04", 30), (b"PK\x05\x06", 22)))
    places = [found.start() for found in re.finditer(re.escape(mark), data)]
    start = draw.choice(places or [0]) + draw.randrange(4, size)
    form = draw.choice(("<B", "<H", "<L"))
    new = struct.pack(form, draw.choice(_NUMBERS) % 256 ** struct.calcsize(form))
    data[start : start + len(new)] = new


def _member(data: bytearray, draw: random.Random) -> None:
    """Damage what is in a member, most often its header, and zip it soundly."""
    members = _members(data)
    at = draw.randrange(len(members))
    name, content = members[at]
    split = 160 if draw.random() < 0.8 else len(content)
    head = bytearray(content[:split])
    draw.choice((_flip, _overwrite, _number, _cut, _splice))(head, draw)
    members[at] = (name, bytes(head) + content[split:])
    data[:] = zipped(members)


def _header(data: bytearray, draw: random.Random) -> None:
    """Describe an array as another one, soundly zipped."""
    members = _members(data)
    at = draw.randrange(len(members))
    name, content = members[at]
    header = header_of(draw.choice(_SHAPES), draw.choice(_DTYPES), draw.choice(("True", "False")))
    members[at] = (name, raw_npy(header, content[128:], draw.choice((1, 1, 2, 3, 9))))
    data[:] = zipped(members)


def _values(data: bytearray, draw: random.Random) -> None:
    """Change single values of an array, soundly zipped."""
    members = _members(data)
    at = draw.randrange(1, len(members))
    name, content = members[at]
    changed = bytearray(content)
    for _ in range(draw.randint(1, 20)):
        start = draw.randrange(128, len(content), 2)
        changed[start : start + 2] = draw.choice(_HALVES)
    members[at] = (name, bytes(changed[: len(content)]))
    data[:] = zipped(members)


def _names(data: bytearray, draw: random.Random) -> None:
    """Rename, drop or repeat a member."""
    members = _members(data)
    at = draw.randrange(len(members))
    name, content = members[at]
    change = draw.randrange(4)
    if change == 0:
        members[at] = (draw.choice(_NAMES), content)
    elif change == 1:
        cut = draw.randrange(len(name))
        members[at] = (name[:cut] + chr(draw.randrange(1, 0x3000)) + name[cut:], content)
    elif change == 2:
        del members[at]
    else:
        members.append((draw.choice([*_NAMES, *dict(members)]), content))
    data[:] = zipped(members)


def _meta(data: bytearray, draw: random.Random) -> None:
    """Change the meta data, as JSON or as text."""
    (_, old), *rest = _members(data)
    text = old[128:].decode("utf-32-le")
    if draw.random() < 0.7:
        values = json.loads(text)
        key = draw.choice([*values, "units", "target", "seed", "seconds_per_object", "x"])
        values[key] = draw.choice(_VALUES)
        text = json.dumps(values)
    else:
        cut = draw.randrange(len(text))
        text = text[:cut] + draw.choice('{}[]",:0-eE\\\0\ud800x') + text[cut + draw.randint(0, 2) :]
    data[:] = zipped([("__meta__.npy", npy(np.array(text))), *rest])


def _members(data: bytearray) -> list[tuple[str, bytes]]:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return [(info.filename, archive.read(info)) for info in archive.infolist()]


_BLIND: tuple[Callable[[bytearray, random.Random], None], ...] = (
    _flip,
    _overwrite,
    _number,
    _cut,
    _splice,
    _zip_header,
)
_KNOWING = (_member, _header, _values, _names, _meta)


def mutated(sound: bytes, seed: int) -> bytes:
    """Return a sound submission with one to three kinds of damage."""
    draw = random.Random(seed)  # noqa: S311
    data = bytearray(sound)
    if draw.random() < 0.5:
        draw.choice(_KNOWING)(data, draw)
    if seed % 2 or bytes(data) == sound:
        for _ in range(draw.randint(1, 2)):
            if data:
                draw.choice(_BLIND)(data, draw)
    return bytes(data)
