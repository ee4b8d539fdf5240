"""Image files: every format comes back pixel for pixel, every damage is one clear error."""

import re
import struct
import zlib
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image

from tests.builder.damage import assert_an_image_or_one_error
from xden1k.errors import DataError
from xden_builder.capture import read_image

shapes = st.tuples(st.integers(1, 9), st.integers(1, 9))
floats = st.floats(-1e9, 1e9, width=32)


@pytest.mark.parametrize("compression", [None, "zlib"])
@pytest.mark.parametrize("dtype", ["u1", "u2", "f4", "f8"])
def test_tiff_comes_back(tmp_path: Path, dtype: str, compression: str | None) -> None:
    pixels = np.random.default_rng(0).uniform(0, 255, (40, 30)).astype(dtype)
    tifffile.imwrite(tmp_path / "a.tif", pixels, compression=compression)
    read = read_image(tmp_path / "a.tif").pixels
    assert read.dtype == pixels.dtype
    np.testing.assert_array_equal(read, pixels)


@pytest.mark.parametrize("compression", ["tiff_lzw", "packbits", "tiff_adobe_deflate"])
@pytest.mark.parametrize("dtype", ["u1", "u2", "f4"])
def test_tiff_of_another_program_comes_back(tmp_path: Path, dtype: str, compression: str) -> None:
    pixels = np.random.default_rng(0).uniform(0, 255, (40, 30)).astype(dtype)
    predictor = {} if compression == "packbits" or dtype == "f4" else {317: 2}
    image = Image.fromarray(pixels)
    image.save(tmp_path / "a.tif", compression=compression, tiffinfo=predictor)
    read = read_image(tmp_path / "a.tif").pixels
    assert read.dtype == pixels.dtype
    np.testing.assert_array_equal(read, pixels)


@pytest.mark.parametrize("compression", [None, "zlib", "lzw", "packbits"])
def test_what_a_tiff_says_of_how_it_is_shown_changes_no_pixel(
    tmp_path: Path, compression: str | None
) -> None:
    pixels = np.random.default_rng(0).integers(0, 255, (40, 30), dtype="u1")
    turned = [(274, "H", 1, 6, True)]
    options: dict[str, Any] = {"photometric": "miniswhite", "extratags": turned}
    tifffile.imwrite(tmp_path / "a.tif", pixels, compression=compression, **options)
    np.testing.assert_array_equal(read_image(tmp_path / "a.tif").pixels, pixels)


def test_several_tiffs_of_another_program_are_refused(tmp_path: Path) -> None:
    page = Image.fromarray(np.zeros((40, 30), dtype=np.uint16))
    pages = {"save_all": True, "append_images": [page], "compression": "tiff_lzw"}
    page.save(tmp_path / "a.tif", **pages)
    with pytest.raises(
        DataError, match=r"a\.tif: expected rows x columns of numbers, got shape \(2, 40, 30\)"
    ):
        read_image(tmp_path / "a.tif")


def test_a_second_image_in_a_tiff_is_refused(tmp_path: Path) -> None:
    pixels = np.zeros((40, 30), dtype=np.uint16)
    with tifffile.TiffWriter(tmp_path / "a.tif") as file:
        file.write(pixels)
        file.write(pixels[:32], description="of another exposure")
    with pytest.raises(DataError, match=r"a\.tif: expected one image, got 2: 40 x 30 and 32 x 30$"):
        read_image(tmp_path / "a.tif")


@pytest.mark.parametrize("told", [{"subfiletype": 1}, {}])
@pytest.mark.parametrize("colours", [1, 3])
def test_a_thumbnail_before_an_image_is_not_taken_for_it(
    tmp_path: Path, colours: int, told: dict[str, Any]
) -> None:
    pixels = np.random.default_rng(0).integers(0, 255, (64, 64), dtype="u1")
    small = np.squeeze(np.repeat(pixels[::2, ::2, None], colours, axis=2))
    with tifffile.TiffWriter(tmp_path / "a.tif") as file:
        file.write(small, photometric="rgb" if colours == 3 else "minisblack", **told)
        file.write(pixels)
    np.testing.assert_array_equal(read_image(tmp_path / "a.tif").pixels, pixels)


def test_a_thumbnail_beside_an_image_is_not_asked_how_it_was_packed(tmp_path: Path) -> None:
    pixels = np.random.default_rng(0).integers(0, 255, (64, 64), dtype="u1")
    with tifffile.TiffWriter(tmp_path / "a.tif") as file:
        file.write(pixels)
        file.write(pixels[::8, ::8], compression="lzma")
    np.testing.assert_array_equal(read_image(tmp_path / "a.tif").pixels, pixels)


def test_a_tiff_that_does_not_say_how_it_is_packed_is_plain(tmp_path: Path) -> None:
    pixels = np.random.default_rng(0).integers(0, 255, (40, 30), dtype="u2")
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, pixels)
    with tifffile.TiffFile(path) as file:
        tag = file.pages[0].tags["Compression"]
    content = bytearray(path.read_bytes())
    content[tag.offset : tag.offset + 2] = (65000).to_bytes(2, "little")  # a private tag
    path.write_bytes(content)
    np.testing.assert_array_equal(read_image(path).pixels, pixels)


def test_a_tiff_that_lost_something_when_it_was_packed_is_refused(tmp_path: Path) -> None:
    pixels = np.random.default_rng(0).integers(0, 255, (40, 30), dtype="u1")
    Image.fromarray(pixels).save(tmp_path / "a.tif", compression="jpeg")
    with pytest.raises(DataError, match=r"a\.tif: expected a TIFF image that is plain .*got JPEG"):
        read_image(tmp_path / "a.tif")


def test_a_png_whose_header_tells_an_absurd_size_is_refused_by_name(tmp_path: Path) -> None:
    size = struct.pack(">IIBBBBB", 100_000, 100_000, 8, 0, 0, 0, 0)
    chunks = [
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        for name, data in ((b"IHDR", size), (b"IDAT", b""))
    ]
    (tmp_path / "a.png").write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(chunks))
    with pytest.raises(DataError, match=r"a\.png: not a PNG image that can be read: Image size"):
        read_image(tmp_path / "a.png")


@pytest.mark.parametrize("dtype", ["u1", "u2"])
def test_png_comes_back(tmp_path: Path, dtype: str) -> None:
    top = np.iinfo(dtype).max
    pixels = np.random.default_rng(1).integers(0, top, (40, 30), endpoint=True).astype(dtype)
    Image.fromarray(pixels).save(tmp_path / "a.PNG", format="png")
    read = read_image(tmp_path / "a.PNG").pixels
    assert read.dtype == pixels.dtype
    np.testing.assert_array_equal(read, pixels)


@given(
    arrays(st.sampled_from(["u1", "<u2", ">u2", "i4"]), shapes)
    | arrays("f4", shapes, elements=floats)
)
def test_npy_comes_back(tmp_path_factory: pytest.TempPathFactory, pixels: np.ndarray) -> None:
    path = tmp_path_factory.mktemp("npy") / "a.npy"
    np.save(path, pixels)
    np.testing.assert_array_equal(read_image(path).pixels, pixels)


def write_rgb_png(path: Path) -> None:
    Image.fromarray(np.zeros((4, 4, 3), dtype="u1")).save(path)


def write_frames(path: Path) -> None:
    tifffile.imwrite(path, np.zeros((3, 4, 4), dtype="u2"), photometric="minisblack")


def write_packed_frames(path: Path) -> None:
    frames = np.zeros((3, 4, 4), dtype="u2")
    tifffile.imwrite(path, frames, photometric="minisblack", compression="lzw")


def write_objects(path: Path) -> None:
    np.save(path, np.array([[None]]), allow_pickle=True)


def write_nan(path: Path) -> None:
    np.save(path, np.array([[1.0, 2.0], [np.nan, np.inf]]))


def write_text(path: Path) -> None:
    path.write_text("not an image")


@pytest.mark.parametrize(
    ("name", "write", "message"),
    [
        ("a.png", write_rgb_png, "expected grey values of 8 or 16 bits, got RGB"),
        (
            "a.tif",
            write_frames,
            r"expected rows x columns of numbers, got shape (3, 4, 4) of uint16",
        ),
        (
            "a.tif",
            write_packed_frames,
            r"expected rows x columns of numbers, got shape (3, 4, 4) of uint16",
        ),
        ("a.npy", write_objects, "not a NumPy array that can be read: Object arrays cannot be"),
        ("a.npy", write_nan, "2 pixels are not finite, first at (1, 0)"),
        ("a.npy", lambda path: np.save(path, np.zeros((0, 3))), "got shape (0, 3) of float64"),
        ("a.npy", lambda path: np.save(path, np.eye(2) * 1j), "got shape (2, 2) of complex128"),
        ("a.dcm", write_text, "not a DICOM image that can be read: File is missing DICOM"),
        ("a.tif", write_text, "not a TIFF image that can be read"),
        ("a.png", write_text, "not a PNG image that can be read"),
        ("a.npy", write_text, "not a NumPy array that can be read"),
        ("a.jpg", write_text, "expected one of .tif, .tiff, .png, .npy, .dcm, got '.jpg'"),
        ("a.tif", lambda path: None, "a.tif: no such image"),
        ("a.tif", lambda path: path.mkdir(), "a.tif: not a file"),
    ],
)
def test_what_is_no_grey_image_is_refused(
    tmp_path: Path, name: str, write: Any, message: str
) -> None:
    write(tmp_path / name)
    with pytest.raises(DataError, match=re.escape(message)) as caught:
        read_image(tmp_path / name)
    assert str(tmp_path / name) in str(caught.value)


@cache
def whole_files() -> dict[str, bytes]:
    pixels = np.random.default_rng(3).integers(0, 999, (40, 36)).astype("u2")
    with TemporaryDirectory() as name:
        folder = Path(name)
        tifffile.imwrite(folder / "a.tif", pixels, compression="zlib")
        Image.fromarray(pixels).save(folder / "a.png")
        np.save(folder / "a.npy", pixels)
        return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@settings(max_examples=200, deadline=None, derandomize=True)
@pytest.mark.filterwarnings("ignore")  # what the libraries remark of damaged files is their own
@given(
    name=st.sampled_from(["a.tif", "a.png", "a.npy"]),
    changes=st.dictionaries(st.integers(0, 999), st.integers(0, 255), max_size=3),
    cut=st.none() | st.integers(0, 3000),
)
def test_damage_is_an_image_or_one_error(
    tmp_path_factory: pytest.TempPathFactory, name: str, changes: dict[int, int], cut: int | None
) -> None:
    path = tmp_path_factory.mktemp("damaged") / name
    assert_an_image_or_one_error(path, whole_files()[name], changes, cut)
