"""Arrays, values and meta data that are not what a submission holds; what must be told of each."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np

from tests.bench.crafting import (
    CASES,
    LANDMINE,
    Sound,
    Trap,
    add,
    case,
    header_of,
    npy,
    raw_npy,
    replaced,
    zipped,
)

__all__: list[str] = []

_TRAPPED = npy(np.array([Trap()], object), allow_pickle=True)
_BIG = bytes(4 * 64**3)
replaced("E103", {"object array": _TRAPPED})
replaced(
    "E104",
    {
        "pickle in a member": pickle.dumps(Trap()),
        "empty member": b"",
        "magic alone": b"\x93NUMPY",
        "structured dtype": npy(np.zeros((64, 64, 64), [("a", "<f4")])),
        "structured dtype with an object": raw_npy(header_of(dtype="[('a', '<f4'), ('b', '|O')]")),
        "subarray dtype": raw_npy(header_of(dtype="('<f4', (2,))")),
        "shape with a negative edge": raw_npy(header_of("(-64, -64, 64)"), _BIG),
        "shape of floats": raw_npy(header_of("(64.0, 64, 64)"), _BIG),
        "shape of booleans": raw_npy(header_of("(True, 64, 64)"), _BIG),
        "shape that is a list": raw_npy(header_of("[64, 64, 64]"), _BIG),
        "shape in hexadecimal": raw_npy(header_of("(0x40, 64, 64)"), _BIG),
        "shape in fullwidth digits": raw_npy(header_of("(\uff16\uff14, 64, 64)"), _BIG, 3),
        "shape of 40 axes": raw_npy(header_of("(" + "1, " * 40 + ")"), _BIG),
        "shape that is code": raw_npy(header_of(f"open('{LANDMINE}', 'w')"), _BIG),
        "shape that takes for ever": raw_npy(header_of("(9**9**9, 64, 64)"), _BIG),
        "dtype that is code": raw_npy(header_of(dtype="__import__('os').getcwd()"), _BIG),
        "header with another key": raw_npy("{'a': 1, " + header_of()[1:], _BIG),
        "header with a key twice": raw_npy(header_of()[:-1] + "'shape': (1,), }", _BIG),
        "header of 60,000 characters": raw_npy(header_of() + " " * 60_000, _BIG),
        "header longer than the member": b"\x93NUMPY\x01\0\xff\xff" + header_of().encode(),
        "header longer than all memory": b"\x93NUMPY\x02\0\xff\xff\xff\xff" + b" " * 100,
        "header nested a thousand deep": raw_npy("(" * 900),
        "version 9": raw_npy(header_of(), _BIG, 9),
        "zip in a member": zipped([("a", b"b")]),
        "text in a member": b"0.0 " * 1000,
    },
)
replaced(
    "E101",
    {
        "values cut short": raw_npy(header_of(), _BIG[:-4]),
        "values too many": raw_npy(header_of(), _BIG + b"\0\0\0\0"),
        "no values": raw_npy(header_of()),
        "shape of 10**27": raw_npy(header_of("(999999999, 999999999, 999999999)"), b"\0" * 64),
        "shape that is zero in 64 bits": raw_npy(header_of("(65536, 65536, 65536, 65536)")),
        "shape that is four in 64 bits": raw_npy(header_of("(274177, 335544, 5, 40)"), b"\0" * 4),
    },
)
replaced(
    "E401",
    {
        f"dtype {dtype}": npy(np.zeros((64, 64, 64), dtype))
        for dtype in (">f4", ">f2", "<f8", "<i4", "|u1", "|b1", "<c8", "<M8[s]", "|S4", "<U1")
    }
    | {"dtype |V4": raw_npy(header_of(dtype="'|V4'"), _BIG)}
    | {"dtype =f4": raw_npy(header_of(dtype="'=f4'"), _BIG)}
    | {"dtype float32": raw_npy(header_of(dtype="'float32'"), _BIG)},
)
replaced(
    "E402",
    {
        f"shape {shape}": npy(np.zeros(shape, "<f4"))
        for shape in ((), (0,), (1, 64, 64, 64), (262144,), (64, 64, 0), (63, 64, 64))
    },
)
add("fortran order", "", lambda s: zipped(s.members(npy(np.asfortranarray(s.grid)))))

# --- values -------------------------------------------------------------------------------------

for _name, _bits in {
    "nan": 0x7FC00000, "nan with a payload": 0x7FC0BEEF, "signalling nan": 0x7F800001,
    "negative nan": 0xFFC00000, "infinity": 0x7F800000,
}.items():  # fmt: skip
    add(_name, "E403", lambda s, bits=_bits: s.with_bits(bits))
add("negative infinity", "E403 E404", lambda s: s.with_bits(0xFF800000))
add("negative", "E404", lambda s: s.with_value(-1.0))
add("negative and subnormal", "E404", lambda s: s.with_bits(0x80000001))
add("negative zero", "", lambda s: s.with_bits(0x80000000))
add("subnormal", "", lambda s: s.with_bits(1))
add("subnormal everywhere", "", lambda s: s.scaled(1e-40))
add("highest float32 everywhere", "E403", lambda s: s.scaled(3e37))
add("float16 that overflows", "E403", lambda s: s.scaled(1e5, "<f2", units="kg/m3"))
add("highest value there may be", "E407", lambda s: s.scaled(1e8))
add("grams for kilograms", "E407", lambda s: s.scaled(1000))
add("kilograms for grams", "W501", lambda s: s.scaled(1, units="kg/m3"))
add("nothing anywhere", "W502", lambda s: s.scaled(0))


@case("E405")
def mass_in_the_corner_only(sound: Sound) -> bytes:
    grid = np.zeros((64, 64, 64), "<f4")
    grid[0, 0, 0] = 1
    return zipped(sound.members(npy(grid)))


for _name, _codes, _values in (
    ("parts without being a part method", "E402", [0, 1]),
    ("more parts than a byte can name", "E402", [0] * 300),
):
    add(
        _name,
        _codes,
        lambda s, v=_values: zipped(
            s.members(npy(np.array(v, "<f4")), f"part_density/{s.first}.npy")
        ),
    )
for _name, _codes, _value in (
    ("dense air", "E406", [1, 1, 1]),
    ("parts too many", "E402", [0] * 9),
    ("parts of the highest float32", "E403", None),
):
    add(
        _name,
        _codes,
        lambda s, v=_value: zipped(
            s.members(
                npy(np.array(v or [0, 3e38, 3e38], "<f4")),
                f"part_density/{s.first}.npy",
                inputs=["parts"],
            )
        ),
    )


def with_sd(sound: Sound, first: np.ndarray | None, kind: str = "density") -> bytes:
    """The file with a standard deviation for every object, the first one's replaced."""
    sd = {f"density_sd/{key}.npy": npy(grid) for key, grid in sound.grids.items()}
    del sd[f"density_sd/{sound.first}.npy"]
    if first is not None:
        sd[f"{kind}_sd/{sound.first}.npy"] = npy(first)
    return zipped([*sound.members(), *sd.items()])


add("sd of some", "E303", lambda s: with_sd(s, None))
add("sd of parts for a grid", "E303 E402", lambda s: with_sd(s, np.zeros(2, "f4"), "part_density"))
add("sd negative", "E404", lambda s: with_sd(s, -s.grid))
add("sd infinite", "E403", lambda s: with_sd(s, np.full_like(s.grid, np.inf)))
add("sd of float64", "E401", lambda s: with_sd(s, s.grid.astype("<f8")))
add("sd that is a pickle", "E103 E303", lambda s: with_trapped_sd(s))


def with_trapped_sd(sound: Sound) -> bytes:
    """The file with a pickle for a standard deviation."""
    return zipped([*sound.members(), (f"density_sd/{sound.first}.npy", _TRAPPED)])


# --- meta data ----------------------------------------------------------------------------------

_NUMBER = "1" * 5000
for _name, _codes, _text in (
    ("meta that is empty", "E201", ""),
    ("meta that is a list", "E201", "[]"),
    ("meta nested 50,000 deep", "E201", "[" * 50_000),
    ("meta of objects nested 10,000 deep", "E201", '{"a":' * 10_000),
    ("meta with a number of 5,000 digits", "E201", f'{{"seed": {_NUMBER}}}'),
    ("meta with a key twice", "E201", '{"schema": "xden-submission/1", "schema": "2"}'),
    ("meta with a byte order mark", "E201", "\ufeff{}"),
    ("meta with a NUL", "E201", '{}\0{"schema": "xden-submission/1"}'),
    ("meta with an unescaped line break", "E201", '{"method": "a\nb"}'),
    ("meta of 300,000 characters", "E102", " " * 300_000),
    ("meta without a schema", "E202", "{}"),
    ("meta whose schema is 500 deep", "E202", '{"schema": ' + "[" * 500 + "]" * 500 + "}"),
):
    add(_name, _codes, lambda s, text=_text: s.with_text(text))
_DEEP: Any = []
for _ in range(300):
    _DEEP = [_DEEP]
for _key, _value in (
    ("method", _DEEP), ("method", "a\x1b[31mred"), ("method", "a\u202eb"), ("method", "a\r\nb"),
    ("method", "w\u0430ter"), ("method", "\uff57ater"), ("method", "w\u0251ter"),
    ("method", "water\u200b"), ("method", "water\u3164"), ("method", "water\u0332"),
    ("method", "\ud800"), ("method", "m" * 81), ("method", {"a": 1}), ("notes", "n" * 501),
    ("notes", "\x07"), ("inputs", "xray"), ("inputs", ["lidar"]), ("inputs", [None]),
    ("inputs", {"mesh": 1}), ("training_data", ["x"] * 21), ("training_data", [["x"]]),
    ("external_data", "false"), ("external_data", 0), ("seed", -1), ("seed", 2**63),
    ("seed", 1.5), ("seed", True), ("seconds_per_object", float("nan")),
    ("seconds_per_object", float("inf")), ("seconds_per_object", "1"), ("target", "mass"),
    ("manifest_sha256", "g" * 64), ("unit", "kg/m3"), ("\x1b[2J", 1), ("__class__", "x"),
):  # fmt: skip
    add(
        f"meta {_key!a}: {ascii(_value)[:30]}, {len(CASES)}",
        "E203",
        lambda s, key=_key, value=_value: zipped(s.members(**{key: value})),
    )
for _mark in ("<!-- results: end -->", "<!--", "-->"):
    add(f"meta with {_mark}", "E206", lambda s, mark=_mark: zipped(s.members(command=mark)))
add("meta of unknown units", "E204", lambda s: zipped(s.members(units="lb/ft3")))
add("meta of units in a list", "E204", lambda s: zipped(s.members(units=["g/cm3"])))
for _key, _value in {
    "dataset_revision": "0.0.9", "manifest_sha256": "0" * 64, "config": "other", "split": "train",
}.items():  # fmt: skip
    add(
        f"truth of another {_key}",
        "E205",
        lambda s, key=_key, value=_value: zipped(s.members(**{key: value})),
    )
for _name, _codes, _data in (
    ("meta that is an object array", "E103", npy(np.array({}, object), allow_pickle=True)),
    ("meta that is a trap", "E103", _TRAPPED),
    ("meta of bytes", "E201", npy(np.array(b"{}"))),
    ("meta of one axis", "E201", npy(np.array(["{}"]))),
    ("meta that is a number", "E201", npy(np.array(1.0))),
    ("meta that is no array", "E104", b"{}"),
    ("meta beyond unicode", "E201", npy(np.array("x")).replace(b"x\0\0\0", b"\xff\xff\xff\x7f")),
    ("meta with a surrogate", "E201", npy(np.array("x")).replace(b"x\0\0\0", b"\0\xd8\0\0")),
    ("meta big-endian", "E201", npy(np.array("{}", ">U2"))),
):
    add(_name, _codes, lambda s, data=_data: s.with_meta(data))
add("no meta", "E201", lambda s: zipped(s.members()[1:]))
for _key, _text in {
    "method": "<script>alert(1)</script>", "notes": "| a | b |](javascript:alert(1)) `rm -rf`",
    "code": "javascript:alert(1)", "command": "$(touch " + LANDMINE + ")",
}.items():  # fmt: skip
    add(
        f"markup in {_key}",
        "",
        lambda s, key=_key, text=_text: zipped(s.members(**{key: text})),
    )
