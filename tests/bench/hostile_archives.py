"""Archives crafted to crash, stall, fill or fool their reader, each with what it must be told."""

from __future__ import annotations

import bz2
import gzip
import io
import pickle
import struct
import zipfile
import zlib
from collections.abc import Sequence

import numpy as np

from tests.bench.crafting import Sound, Trap, add, case, header_of, npy, raw_npy, zipped

__all__: list[str] = []


def central(data: bytes, place: int, form: str, *values: int) -> bytes:
    """Overwrite fields of the last member's entry in the directory."""
    return poked(data, data.rindex(b"PK\x01\x02") + place, form, *values)


def local(data: bytes, place: int, form: str, *values: int) -> bytes:
    """Overwrite fields of the last member's own header."""
    return poked(data, data.rindex(b"PK\x03\x04"), form, *values, skip=place)


def ending(data: bytes, place: int, form: str, *values: int) -> bytes:
    """Overwrite fields of the end record."""
    return poked(data, len(data) - 22 + place, form, *values)


def poked(data: bytes, start: int, form: str, *values: int, skip: int = 0) -> bytes:
    """Overwrite bytes."""
    new = struct.pack(form, *values)
    return data[: start + skip] + new + data[start + skip + len(new) :]


def zip_by_hand(entries: Sequence[tuple[str, int, int, int]], body: bytes) -> bytes:
    """A zip file whose directory says anything: name, size, packed size, offset in ``body``."""
    directory = b"".join(
        struct.pack(
            "<4s4B4HL2L5H2L", b"PK\x01\x02", 20, 0, 20, 0, 0, 8, 0, 33, 0, packed, size,
            len(name), 0, 0, 0, 0, 0, offset,
        )
        + name.encode()
        for name, size, packed, offset in entries
    )  # fmt: skip
    count = len(entries) & 0xFFFF
    end = struct.pack("<4s4H2LH", b"PK\5\6", 0, 0, count, count, len(directory), len(body), 0)
    return body + directory + end


def local_header(name: str) -> bytes:
    """The header before a deflated member."""
    return struct.pack(
        "<4s2B4HL2L2H", b"PK\x03\x04", 20, 0, 0, 8, 0, 33, 0, 0, 0, len(name), 0
    ) + name.encode()  # fmt: skip


def zeros_deflated(mebibytes: int, start: bytes = b"") -> bytes:
    """A stream of zeros at a thousandth of its size, made without making them."""
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    head = packer.compress(start) + packer.flush(zlib.Z_FULL_FLUSH)
    block = packer.compress(bytes(1 << 20)) + packer.flush(zlib.Z_FULL_FLUSH)
    return head + block * mebibytes + packer.flush()


for _share in (0.02, 0.3, 0.5, 0.7, 0.9, 0.98):
    add(f"cut at {_share:.0%}", "E101", lambda s, at=_share: s.bytes[: int(len(s.bytes) * at)])
for _count in (1, 22):
    add(f"last {_count} bytes cut off", "E101", lambda s, cut=_count: s.bytes[:-cut])
for _name, _pack in {
    "empty": lambda data: b"",
    "text": lambda data: b"density,mass\n1,2\n",
    "gzip": gzip.compress,
    "bzip2": bz2.compress,
    "pickle of a trap": lambda data: pickle.dumps(Trap()),
    "bare npy": lambda data: npy(np.zeros((64, 64, 64), "<f4")),
    "page with a zip behind it": lambda data: b"<html><script>alert(1)</script>" + data,
    "appended garbage": lambda data: data + b"\0" * 40,
    "appended zip": lambda data: data + zipped([("a", b"")]),
    "archive comment": lambda data: data[:-2] + b"\x05\0hello",
}.items():
    add(_name, "E101", lambda sound, pack=_pack: pack(sound.bytes))


@case("E101")
def page_with_a_zip_that_knows_of_it(sound: Sound) -> bytes:
    buffer = io.BytesIO(b"<html>")
    with zipfile.ZipFile(buffer, "a") as out:
        for name, data in sound.members():
            out.writestr(name, data)
    return buffer.getvalue()


@case("E104 E201")
def zip_in_a_zip(sound: Sound) -> bytes:
    return zipped([("preds.npz", sound.bytes)])


@case("E104 E201")
def zips_nested_seven_deep(sound: Sound) -> bytes:
    data = bytes(1 << 22)
    for depth in range(7):
        data = zipped([(f"{depth}-{copy}.zip", data) for copy in range(8)])
    return data


@case("E101")
def overlapping_members(sound: Sound) -> bytes:
    body = local_header("density/0.npy") + zeros_deflated(4)
    entries = [(f"density/{i}.npy", 4 << 20, len(body) - 43, 0) for i in range(5000)]
    return zip_by_hand(entries, body)


@case("E101")
def members_that_quote_each_others_headers(sound: Sound) -> bytes:
    """The construction of zipbomb.me: each member starts with the headers of all that follow."""
    kernel = zeros_deflated(4)
    body, entries = local_header("density/z.npy") + kernel, []
    for index in range(200):
        name = f"density/{index}.npy"
        quote = b"\0" + struct.pack("<2H", len(body) & 0xFFFF, ~len(body) & 0xFFFF)
        body = local_header(name) + quote + body
        entries.append((name, 4 << 20, 0, len(body)))
    end = len(body)
    return zip_by_hand([(n, size, at - 50, end - at) for n, size, _, at in entries], body)


@case("E104 E201")
def endless_empty_blocks(sound: Sound) -> bytes:
    """Deflate blocks that give nothing: a reader that wants one byte goes through all of them."""
    name = f"density/{sound.first}.npy"
    body = local_header(name) + b"\0\0\0\xff\xff" * 4_000_000
    return zip_by_hand([(name, 1 << 20, len(body) - 30 - len(name), 0)], body)


@case("E101")
def zip64_directory(sound: Sound) -> bytes:
    locator = struct.pack("<4sLQL", b"PK\x06\x07", 0, 0, 1)
    return sound.bytes[:-22] + locator + sound.bytes[-22:]


@case("E101")
def zip64_offset_beyond_all_numbers(sound: Sound) -> bytes:
    data = sound.bytes
    last = data.rindex(b"PK\x01\x02")
    extra = struct.pack("<2HQ", 1, 8, 2**64 - 1)
    data = central(central(data, 42, "<L", 0xFFFFFFFF), 30, "<H", len(extra))
    size = struct.unpack("<L", data[-10:-6])[0] + len(extra)
    end = last + 46 + struct.unpack("<H", data[last + 28 : last + 30])[0]
    return ending(data[:end] + extra + data[-22:], 12, "<L", size)


@case("E102")
def zip64_size_beyond_all_disks(sound: Sound) -> bytes:
    data = sound.bytes
    last = data.rindex(b"PK\x01\x02")
    extra = struct.pack("<2HQ", 1, 8, 1 << 60)
    data = central(central(data, 24, "<L", 0xFFFFFFFF), 30, "<H", len(extra))
    size = struct.unpack("<L", data[-10:-6])[0] + len(extra)
    end = last + 46 + struct.unpack("<H", data[last + 28 : last + 30])[0]
    return ending(data[:end] + extra + data[-22:], 12, "<L", size)


@case("E102 E201")
def bomb_of_two_gigabytes(sound: Sound) -> bytes:
    name = f"density/{sound.first}.npy"
    body = local_header(name) + zeros_deflated(2048, raw_npy(header_of("(536870880,)")))
    return zip_by_hand([(name, 1 << 31, len(body) - 30 - len(name), 0)], body)


for _name, _codes, _change in (
    ("directory of a gigabyte", "E102", lambda d: ending(d, 12, "<L", 1 << 30)),
    ("directory that starts elsewhere", "E101", lambda d: ending(d, 16, "<L", 7)),
    ("directory that starts beyond the end", "E101", lambda d: ending(d, 16, "<L", 0xFFFFFFF0)),
    ("directory one entry short", "E101", lambda d: ending(d, 12, "<L", 46)),
    ("other disks", "", lambda d: ending(d, 4, "<2H", 7, 9)),
    ("wrong count of members", "", lambda d: ending(d, 8, "<2H", 9999, 9999)),
    ("wrong checksum", "E101", lambda d: central(d, 16, "<L", 0)),
    ("encrypted", "E101", lambda d: central(d, 8, "<H", 1)),
    ("strongly encrypted", "E101", lambda d: central(d, 8, "<H", 0x41)),
    ("strong encryption alone", "E101", lambda d: central(d, 8, "<H", 0x40)),
    ("patched data", "E101", lambda d: central(d, 8, "<H", 0x20)),
    ("name that claims to be unicode", "", lambda d: central(d, 8, "<H", 0x800)),
    ("made for zip 9.9", "E101", lambda d: central(d, 6, "<H", 99)),
    ("method deflate64", "E101", lambda d: central(d, 10, "<H", 9)),
    ("method 99", "E101", lambda d: central(d, 10, "<H", 99)),
    ("method stored for what is deflated", "E101", lambda d: central(d, 10, "<H", 0)),
    ("declared size of four gigabytes", "E102", lambda d: central(d, 24, "<L", 0xFFFFFFFE)),
    ("declared size of nothing", "E101", lambda d: central(d, 24, "<L", 0)),
    ("declared size too small by one", "E101", lambda d: central(d, 24, "<L", 524415)),
    ("packed size of nothing", "E102", lambda d: central(d, 20, "<L", 0)),
    ("packed size of four gigabytes", "E101", lambda d: central(d, 20, "<L", 0xFFFFFFFE)),
    ("member that starts at another", "E101", lambda d: central(d, 42, "<L", 0)),
    ("member that starts nowhere", "E101", lambda d: central(d, 42, "<L", 0xFFFFFFF0)),
    ("header of another name", "E101", lambda d: local(d, 30, "<B", 0x41)),
    ("header without its mark", "E101", lambda d: local(d, 0, "<B", 0)),
    ("header with a longer name", "E101", lambda d: local(d, 26, "<H", 60000)),
    ("header of other sizes", "", lambda d: local(d, 14, "<3L", 1, 2, 3)),
    ("header of another method", "", lambda d: local(d, 8, "<H", 99)),
    ("damaged stream", "E101", lambda d: local(d, 90, "<4B", 255, 0, 255, 0)),
):
    add(_name, _codes, lambda sound, change=_change: change(sound.bytes))
for _name, _method in {"bzip2": zipfile.ZIP_BZIP2, "lzma": zipfile.ZIP_LZMA}.items():
    add(f"members by {_name}", "E101", lambda s, by=_method: zipped(s.members(), by))
add("members not compressed", "", lambda s: zipped(s.members(), zipfile.ZIP_STORED))

# --- names --------------------------------------------------------------------------------------

for _name in (
    "../../etc/passwd.npy", "/density/bar.npy", "density/../../bar.npy", "C:\\density\\bar.npy",
    "density\\bar.npy", "density/", "density/bar\0.npy", "density/b\u0430r-0002.npy",
    "density/cafe\u0301.npy", "density/\uff42ar-0002.npy", "density/\u202ebar.npy",
    "density/b\u200bar.npy", "density/\x1b[2J.npy", "density/bar\n.npy", "Density/bar.npy",
    "density/bar.NPY", "density/a/b.npy", "density/" + "a" * 129 + ".npy", "n" * 60_000,
    "density/<img src=x onerror=alert(1)>.npy", "density/'; DROP TABLE entries.npy",
    "density_sd.npy", "file:///etc/passwd",
):  # fmt: skip
    add(
        f"named {ascii(_name)[:40]}",
        "E104 E301",
        lambda s, n=_name: zipped(s.members(name=n)),
    )
for _name in ("..", "-rf", "CON", "bar-0002."):
    add(f"id {_name}", "E301 E302", lambda s, n=_name: zipped(s.members(name=f"density/{n}.npy")))


@case("E104")
def link_to_the_truth(sound: Sound) -> bytes:
    data = zipped(sound.members(b"/data/truth.parquet"))
    return central_of_first_object(data, 38, "<L", 0o120777 << 16)


def central_of_first_object(data: bytes, place: int, form: str, *values: int) -> bytes:
    """Overwrite fields of the second entry in the directory."""
    start = data.index(b"PK\x01\x02", data.index(b"PK\x01\x02") + 4)
    return poked(data, start + place, form, *values)


@case("E101")
def name_that_is_no_unicode(sound: Sound) -> bytes:
    data = zipped(sound.members(name="density/\u0430.npy"))
    return data.replace("\u0430".encode(), b"\xff\xfe")


@case("E104")
def two_thousand_keys(sound: Sound) -> bytes:
    return zipped([*sound.members(), *((f"key{i:04d}", b"") for i in range(2_000))])


@case("E104 E302")
def two_thousand_objects(sound: Sound) -> bytes:
    more = ((f"density/o{i:04d}.npy", b"x") for i in range(2_000))
    return zipped([*sound.members(), *more])


@case("E102")
def fifty_thousand_keys(sound: Sound) -> bytes:
    body = local_header("a")
    return zip_by_hand([(f"density/{i}.npy", 0, 0, 0) for i in range(50_000)], body)


@case("E105")
def one_object_twice(sound: Sound) -> bytes:
    return zipped([*sound.members(), (f"density/{sound.first}.npy", npy(sound.grid * 0))])


@case("E105")
def one_object_in_both_kinds(sound: Sound) -> bytes:
    return zipped([*sound.members(), (f"part_density/{sound.first}.npy", npy(np.zeros(2, "f4")))])


@case("E105")
def two_meta_data(sound: Sound) -> bytes:
    return zipped([*sound.members(), ("__meta__.npy", sound.members(units="kg/m3")[0][1])])
