"""Files that strangers send: each flaw has its code, and nothing is decompressed to find it."""

from __future__ import annotations

import io
import json
import struct
import tracemalloc
import warnings
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from xden1k.errors import SubmissionError
from xden1k.predictions import Predictions, open_predictions

META: dict[str, Any] = {
    "schema": "xden-submission/1",
    "method": "hostile",
    "dataset_revision": "0.1.0",
    "config": "default",
    "split": "test",
    "inputs": ["mesh"],
    "training_data": [],
    "external_data": False,
}
GRID = np.zeros((64, 64, 64), np.float32)
GRID[20:40, 20:40, 20:40] = 1.0


def npy(values: np.ndarray, allow_pickle: bool = False) -> bytes:
    buffer = io.BytesIO()
    np.lib.format.write_array(buffer, values, allow_pickle=allow_pickle)
    return buffer.getvalue()


def meta_npy(**changes: Any) -> bytes:
    values = {key: value for key, value in {**META, **changes}.items() if value is not None}
    return npy(np.array(json.dumps(values)))


def archive(
    path: Path,
    members: Mapping[str, bytes] | list[tuple[str, bytes]],
    method: int = zipfile.ZIP_DEFLATED,
    meta: bytes | None = None,
) -> Path:
    pairs = list(members.items()) if isinstance(members, Mapping) else members
    with zipfile.ZipFile(path, "w", method) as out, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # duplicate names are on purpose
        out.writestr("__meta__.npy", meta_npy() if meta is None else meta)
        for name, data in pairs:
            out.writestr(name, data)
    return path


def found(path: Path) -> list[str]:
    """Every problem that shows on opening or on reading each object."""
    with Predictions(path) as predictions:
        problems = list(predictions.problems)
        for object_id in predictions.ids:
            problems += predictions.examine(object_id)[1]
            problems += predictions.examine_sd(object_id)[1]
    lines = [str(problem) for problem in problems]
    assert all(line.isprintable() for line in lines)
    return lines


def test_a_sound_file_has_no_problem(tmp_path: Path) -> None:
    assert found(archive(tmp_path / "p.npz", {"density/mug.npy": npy(GRID)})) == []


@pytest.mark.parametrize("size", [0, 1, 21, 22, 1000])
def test_e101_rubbish_of_any_length(tmp_path: Path, size: int) -> None:
    (tmp_path / "p.npz").write_bytes(b"PK\x05\x06"[:size] + b"x" * (size - 4))
    why = (
        "no zip directory at the end of the file" if size > 4 else "it does not start as a zip file"
    )
    assert found(tmp_path / "p.npz") == [f"E101: not a readable .npz: {why}"]


def test_e101_a_truncated_zip(tmp_path: Path) -> None:
    path = archive(tmp_path / "p.npz", {"density/mug.npy": npy(GRID)})
    path.write_bytes(path.read_bytes()[:-300])
    assert found(path) == ["E101: not a readable .npz: no zip directory at the end of the file"]


def test_e101_a_damaged_member_is_named(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).random((64, 64, 64), np.float32)
    path = archive(
        tmp_path / "p.npz", {"density/mug.npy": npy(noise), "density/cup.npy": npy(GRID)}
    )
    data = bytearray(path.read_bytes())
    data[500_000] ^= 0xFF
    path.write_bytes(bytes(data))
    (line,) = found(path)
    assert line.startswith("E101 mug: damaged")


def test_e101_values_that_do_not_fill_the_shape(tmp_path: Path) -> None:
    path = archive(tmp_path / "p.npz", {"density/mug.npy": npy(GRID)[:-4]})
    (line,) = found(path)
    assert line.startswith("E101 mug: shape (64, 64, 64) of <f4 needs 1048704 bytes")


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_e101_compression_whose_expansion_has_no_bound(tmp_path: Path, method: int) -> None:
    path = archive(tmp_path / "p.npz", {"density/mug.npy": npy(GRID)}, method)
    assert found(path) == [
        f"E101: __meta__: compression method {method}, must be stored or deflated",
        f"E101 mug: compression method {method}, must be stored or deflated",
    ]


def test_e101_an_encrypted_member(tmp_path: Path) -> None:
    path = archive(tmp_path / "p.npz", {"density/mug.npy": npy(GRID)})
    data = bytearray(path.read_bytes())
    last = data.rindex(b"PK\x01\x02")
    data[last + 8] |= 1
    path.write_bytes(bytes(data))
    assert found(path) == ["E101 mug: encrypted"]


def test_e101_a_zip64_directory(tmp_path: Path) -> None:
    path = archive(tmp_path / "p.npz", {"density/mug.npy": npy(GRID)})
    data = path.read_bytes()
    locator = struct.pack("<4sLQL", b"PK\x06\x07", 0, 0, 1)
    path.write_bytes(data[:-22] + locator + data[-22:])
    assert found(path) == ["E101: not a readable .npz: zip64 directories are not accepted"]


def test_e102_a_huge_directory_is_never_read(tmp_path: Path) -> None:
    end = struct.pack("<4s4H2LH", b"PK\x05\x06", 0, 0, 1, 1, 1 << 30, 0, 0)
    (tmp_path / "p.npz").write_bytes(b"PK\x03\x04" + b"x" * 96 + end)
    (line,) = found(tmp_path / "p.npz")
    assert line == "E102: the zip directory takes 1073741824 bytes, at most 2097152"


def test_e102_a_bomb_is_not_decompressed(tmp_path: Path) -> None:
    bomb = npy(np.zeros(1, np.float32))[:-4].replace(b"(1,), }       ", b"(12500000,), }")
    path = archive(tmp_path / "p.npz", {"density/mug.npy": bomb + bytes(50_000_000)})
    assert path.stat().st_size < 300_000
    tracemalloc.start()
    (line,) = found(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert line.startswith("E102 mug: declares 50000128 bytes, at most 1049600")
    assert peak < 1_000_000


def test_e102_a_directory_that_declares_too_little(tmp_path: Path) -> None:
    """The bytes beyond the declared size are never produced."""
    path = archive(tmp_path / "p.npz", {"density/mug.npy": npy(GRID) + bytes(100_000_000)})
    data = bytearray(path.read_bytes())
    last = data.rindex(b"PK\x01\x02")
    data[last + 24 : last + 28] = struct.pack("<L", len(npy(GRID)))
    path.write_bytes(bytes(data))
    tracemalloc.start()
    (line,) = found(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert line.startswith("E101 mug: damaged: Bad CRC-32")
    assert peak < 10_000_000


def test_e102_a_directory_that_declares_too_much(tmp_path: Path) -> None:
    path = archive(tmp_path / "p.npz", {"density/mug.npy": npy(np.zeros(2, np.float32))})
    data = bytearray(path.read_bytes())
    last = data.rindex(b"PK\x01\x02")
    data[last + 24 : last + 28] = struct.pack("<L", 1_000_000)
    path.write_bytes(bytes(data))
    (line,) = found(path)
    assert line.startswith("E102 mug: declares 1000000 bytes from ")


def test_e103_a_pickle_is_never_loaded(tmp_path: Path) -> None:
    class Trap:
        def __reduce__(self) -> tuple[Any, ...]:
            return (Path.touch, (tmp_path / "owned",))

    trapped = npy(np.array([Trap()], object), allow_pickle=True)
    path = archive(tmp_path / "p.npz", {"density/mug.npy": trapped})
    assert found(path) == ["E103 mug: an object array, which would have to be unpickled"]
    assert not (tmp_path / "owned").exists()


@pytest.mark.parametrize(
    "name",
    [
        "../../etc/passwd",
        "density/../../../etc/passwd.npy",
        "/density/mug.npy",
        "C:\\density\\mug.npy",
        "density/mug.npy\0.npy",
        "density/mug",
        "density/mug.txt",
        "Density/mug.npy",
        "density/m\u0443g.npy",
        "density/.npy",
        "labels/mug.npy",
        "density/a/b.npy",
        "density/mug\n.npy",
    ],
)
def test_e104_names_that_are_no_key(tmp_path: Path, name: str) -> None:
    path = archive(tmp_path / "p.npz", {"density/mugmugmugmugm.npy": npy(GRID)})
    renamed = archive(
        tmp_path / "q.npz", {"density/mug.npy": npy(GRID), "x" * len(name.encode()): b""}
    )
    data = renamed.read_bytes().replace(b"x" * len(name.encode()), name.encode())
    renamed.write_bytes(data)
    assert found(path) == []
    (line,) = found(renamed)
    assert line.startswith("E104: keys must be __meta__, density/ID or part_density/ID, or these")


def test_e104_ten_thousand_unknown_keys_make_one_line(tmp_path: Path) -> None:
    path = archive(tmp_path / "p.npz", {f"key{i:05d}.npy": b"" for i in range(10_000)})
    (line,) = found(path)
    assert "others 10000: 'key00000.npy', 'key00001.npy'" in line
    assert len(line) < 300


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"not an array",
        b"\x93NUMPY\x01\x00",
        b"\x93NUMPY\x01\x00\xff\xff{}",
        b"\x93NUMPY\x03\x00\xff\xff\xff\xff{}",
        npy(np.zeros((), [("a", "<f4")])),
        npy(GRID).replace(b"'shape'", b"'Shape'"),
        npy(GRID).replace(b"(64, 64, 64)", b"(__import__)"),
        npy(GRID).replace(b"(64, 64, 64)", b"(-4, 64, 64)"),
        npy(GRID).replace(b"{'descr'", b"{------("),
    ],
)
def test_e104_a_member_that_is_no_plain_array(tmp_path: Path, data: bytes) -> None:
    (line,) = found(archive(tmp_path / "p.npz", {"density/mug.npy": data}))
    assert line.startswith("E104 mug: ")


@pytest.mark.parametrize("second", ["density/mug.npy", "part_density/mug.npy"])
def test_e105_one_object_twice(tmp_path: Path, second: str) -> None:
    path = archive(tmp_path / "p.npz", [("density/mug.npy", npy(GRID)), (second, npy(GRID))])
    assert found(path) == [f"E105: an object may come once; repeated members 1: '{second}'"]


def test_e201_no_meta_data(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "p.npz", "w") as out:
        out.writestr("density/mug.npy", npy(GRID))
    assert found(tmp_path / "p.npz") == [
        "E201: __meta__ is missing: a 0-d string array holding JSON"
    ]


@pytest.mark.parametrize(
    "meta",
    [
        npy(np.array(["{}"])),
        npy(np.array(1.0)),
        npy(np.array("{")),
        npy(np.array("[" * 50_000)),
        npy(np.array("[]")),
        npy(np.array("x")).replace(b"x\0\0\0", b"\xff\xff\xff\xff"),
    ],
)
def test_e201_meta_data_that_are_no_json_object(tmp_path: Path, meta: bytes) -> None:
    (line,) = found(archive(tmp_path / "p.npz", {}, meta=meta))
    assert line.startswith("E201: __meta__")


def test_e202_another_schema(tmp_path: Path) -> None:
    path = archive(tmp_path / "p.npz", {}, meta=meta_npy(schema="xden-submission/2"))
    assert found(path) == ["E202: schema must be 'xden-submission/1', got 'xden-submission/2'"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"method": None}, "method is missing"),
        ({"method": 3}, "method must be one printable line"),
        ({"method": ""}, "method must be one printable line"),
        ({"method": "a\nb"}, "method must be one printable line"),
        ({"method": "a" * 81}, "method must be one printable line"),
        ({"method": "\ud800"}, "method must be one printable line"),
        ({"inputs": "xray"}, "inputs must be a list of any of"),
        ({"inputs": ["lidar"]}, "inputs must be a list of any of"),
        ({"inputs": [["mesh"]]}, "inputs must be a list of any of"),
        ({"training_data": None}, "training_data is missing"),
        ({"external_data": 0}, "external_data must be true or false"),
        ({"seconds_per_object": -1}, "seconds_per_object must be a number >= 0"),
        ({"processor_seconds_per_object": "1"}, "processor_seconds_per_object must be a number"),
        ({"peak_memory_gb": float("nan")}, "peak_memory_gb must be a number >= 0"),
        ({"seconds_per_object": float("nan")}, "seconds_per_object must be a number >= 0"),
        ({"seed": True}, "seed must be an integer"),
        ({"manifest_sha256": "b710"}, "manifest_sha256 must be 64 hexadecimal digits"),
        ({"target": "lac"}, "target must be one of"),
        ({"unit": "kg/m3"}, "unknown field 'unit'"),
    ],
)
def test_e203_fields(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    (line,) = found(archive(tmp_path / "p.npz", {}, meta=meta_npy(**changes)))
    assert line.startswith(f"E203: {message}")


def test_e204_unknown_units(tmp_path: Path) -> None:
    (line,) = found(archive(tmp_path / "p.npz", {}, meta=meta_npy(units="lb/ft3")))
    assert line == "E204: units must be one of ('g/cm3', 'kg/m3'), got 'lb/ft3'"


@pytest.mark.parametrize("dtype", ["<f8", ">f4", "<i4", "<c8", "|b1", "<M8[s]", "<U8"])
def test_e401_dtypes(tmp_path: Path, dtype: str) -> None:
    values = npy(np.zeros((8, 8, 8), dtype))
    (line,) = found(archive(tmp_path / "p.npz", {"density/mug.npy": values}))
    assert line.startswith("E401 mug: dtype must be float32 or float16")


def test_e401_a_float64_grid_is_told_by_its_dtype_not_its_size(tmp_path: Path) -> None:
    values = npy(GRID.astype(np.float64))
    (line,) = found(archive(tmp_path / "p.npz", {"density/mug.npy": values}))
    assert line == "E401 mug: dtype must be float32 or float16 ('<f4' or '<f2'), got '<f8'"


def test_e402_a_finer_grid_is_told_how_it_is_pooled(tmp_path: Path) -> None:
    fine = np.random.default_rng(0).random((128, 128, 128)).astype(np.float32)
    (line,) = found(archive(tmp_path / "p.npz", {"density/mug.npy": npy(fine)}))
    assert line.startswith("E402 mug: shape must be (64, 64, 64), got (128, 128, 128); take means")
    told = line.split("means: ")[1]
    pooled = eval(told, {"values": fine})  # noqa: S307, what the message says
    assert pooled.shape == (64, 64, 64)
    assert pooled[1, 2, 3] == pytest.approx(fine[2:4, 4:6, 6:8].mean())


@pytest.mark.parametrize("shape", [(64, 64), (64, 64, 63), (1, 64, 64, 64), (), (262144,)])
def test_e402_shapes(tmp_path: Path, shape: tuple[int, ...]) -> None:
    values = npy(np.zeros(shape, np.float32))
    (line,) = found(archive(tmp_path / "p.npz", {"density/mug.npy": values}))
    assert line.startswith(f"E402 mug: shape must be (64, 64, 64), got {shape}")


@pytest.mark.parametrize("shape", [(), (1,), (257,), (2, 2)])
def test_e402_part_shapes(tmp_path: Path, shape: tuple[int, ...]) -> None:
    values = npy(np.zeros(shape, np.float32))
    (line,) = found(archive(tmp_path / "p.npz", {"part_density/mug.npy": values}))
    assert line.startswith("E402 mug: shape must be (parts + 1,)")


@pytest.mark.parametrize("dtype", [np.float32, np.float16])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_e403_not_finite(tmp_path: Path, dtype: type, value: float) -> None:
    grid = GRID.astype(dtype)
    grid[0, 1, 2:5] = value
    first = found(archive(tmp_path / "p.npz", {"density/mug.npy": npy(grid)}))[0]
    assert first == "E403 mug: 3 values are not finite, first at (0, 1, 2)"


def test_e403_a_signalling_nan_raises_no_warning(tmp_path: Path) -> None:
    grid = GRID.astype(np.float16)
    grid.view(np.uint16)[0, 0, 0] = 0x7C01
    (line,) = found(archive(tmp_path / "p.npz", {"density/mug.npy": npy(grid)}))
    assert line.startswith("E403 mug: 1 values")


@pytest.mark.parametrize("value", [1.1e9, 3e38])
def test_e403_values_whose_sums_would_overflow(tmp_path: Path, value: float) -> None:
    grid = GRID.copy()
    grid[5, 6, 7] = value
    (line,) = found(archive(tmp_path / "p.npz", {"density/mug.npy": npy(grid)}))
    assert line == "E403 mug: 1 values are above 1e+09, first at (5, 6, 7)"


def test_e404_negative(tmp_path: Path) -> None:
    grid = GRID.copy()
    grid[5, 6, 7] = -1e-30
    (line,) = found(archive(tmp_path / "p.npz", {"density/mug.npy": npy(grid)}))
    assert line == "E404 mug: 1 values are negative, first at (5, 6, 7)"


def test_negative_zero_and_subnormal_values_are_densities(tmp_path: Path) -> None:
    grid = GRID.copy()
    grid[0, 0, 0], grid[0, 0, 1] = -0.0, 1e-40
    assert found(archive(tmp_path / "p.npz", {"density/mug.npy": npy(grid)})) == []


def test_e406_dense_air(tmp_path: Path) -> None:
    values = npy(np.array([1.0, 2.0], np.float32))
    (line,) = found(archive(tmp_path / "p.npz", {"part_density/mug.npy": values}))
    assert line == "E406 mug: entry 0 is air and must be 0, got 1.0"


PARTS = np.array([0, 1, 2], np.float32)


@pytest.mark.parametrize(
    ("members", "lines"),
    [
        (
            {"density/a": GRID, "density/b": GRID, "density_sd/a": GRID},
            ["E303: density_sd is for all objects or none; objects without it 1: 'b'"],
        ),
        (
            {"density/a": GRID, "part_density_sd/a": PARTS},
            [
                "E303: density_sd needs its density, part_density_sd its part_density; "
                "without it 1: 'a'",
                "E402 a: density_sd: shape must be the density's, (64, 64, 64), got (3,)",
            ],
        ),
        (
            {"density/a": GRID, "density_sd/a": GRID, "density_sd/b": GRID},
            [
                "E303: density_sd needs its density, part_density_sd its part_density; "
                "without it 1: 'b'"
            ],
        ),
        (
            {"part_density/a": PARTS, "part_density_sd/a": PARTS[:2]},
            ["E402 a: density_sd: shape must be the density's, (3,), got (2,)"],
        ),
        (
            {"density/a": GRID, "density_sd/a": GRID[:9]},
            ["E402 a: density_sd: shape must be (64, 64, 64), got (9, 64, 64)"],
        ),
        (
            {"density/a": GRID, "density_sd/a": GRID.astype(np.float64)},
            ["E401 a: density_sd: dtype must be float32 or float16 ('<f4' or '<f2'), got '<f8'"],
        ),
        (
            {"density/a": GRID, "density_sd/a": -GRID},
            ["E404 a: density_sd: 8000 values are negative, first at (20, 20, 20)"],
        ),
        (
            {"part_density/a": PARTS, "part_density_sd/a": PARTS + 1},
            ["E406 a: density_sd: entry 0 is air and must be 0, got 1.0"],
        ),
    ],
)
def test_standard_deviations(
    tmp_path: Path, members: dict[str, np.ndarray], lines: list[str]
) -> None:
    arrays = {f"{name}.npy": npy(values) for name, values in members.items()}
    assert found(archive(tmp_path / "p.npz", arrays)) == lines


def test_e105_one_standard_deviation_twice(tmp_path: Path) -> None:
    names = ["density/a.npy", "density_sd/a.npy", "part_density_sd/a.npy"]
    path = archive(tmp_path / "p.npz", [(name, npy(GRID)) for name in names])
    assert found(path) == [
        "E105: an object may come once; repeated members 1: 'part_density_sd/a.npy'"
    ]


def test_every_problem_is_told_at_once(tmp_path: Path) -> None:
    path = archive(
        tmp_path / "p.npz",
        {
            "density/a.npy": npy(GRID[:10]),
            "density/b.npy": npy(GRID.astype(np.float64)),
            "hello": b"",
        },
        meta=meta_npy(method=None, units="lb"),
    )
    with pytest.raises(SubmissionError) as caught:
        open_predictions(path)
    assert [line[:4] for line in caught.value.problems] == ["E203", "E204", "E402", "E401", "E104"]


def test_what_cannot_be_read_is_still_named(tmp_path: Path) -> None:
    path = archive(
        tmp_path / "p.npz", {"density/a.npy": npy(GRID[:10]), "density/b.npy": npy(GRID)}
    )
    with Predictions(path) as predictions:
        assert predictions.ids == ("b",)
        assert predictions.named_ids == {"a", "b"}


SMALL = np.zeros((64, 64, 64), np.float16)
SMALL[30:34, 30:34, 30:34] = 1.0


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("sound") / "p.npz"
    parts = npy(np.array([0, 1, 2], np.float32))
    return archive(path, {"density/a.npy": npy(SMALL), "part_density/b.npy": parts}).read_bytes()


@settings(
    max_examples=5 * settings.default.max_examples,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    st.lists(st.tuples(st.floats(0, 1), st.integers(0, 255)), min_size=1, max_size=8),
    st.floats(0.9, 1.1).map(lambda share: min(share, 1.0)),
)
def test_no_mutation_crashes_the_reader(
    tmp_path: Path, sound: bytes, changes: list[tuple[float, int]], kept: float
) -> None:
    data = bytearray(sound[: int(len(sound) * kept)])
    for place, value in changes:
        data[min(int(place * len(data)), len(data) - 1)] = value
    (tmp_path / "p.npz").write_bytes(bytes(data))
    for line in found(tmp_path / "p.npz"):
        assert line[0] == "E"
        assert len(line) < 500
