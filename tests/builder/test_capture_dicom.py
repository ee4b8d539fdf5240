"""DICOM radiographs: pixels, polarity, spacing, and what their headers do to a view of counts."""

import importlib.util
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pydicom
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydicom.uid import (
    ComputedRadiographyImageStorage,
    ExplicitVRLittleEndian,
    JPEG2000Lossless,
    generate_uid,
)

from tests.builder.damage import assert_an_image_or_one_error
from xden1k.errors import DataError, MissingExtraError
from xden1k.values.views import ViewGeometry
from xden_builder.capture import (
    ScannerFile,
    ViewFile,
    dicom_pixel_spacing_cm,
    read_image,
    read_scanner,
    write_scanner,
)
from xden_builder.capture.calibration import calibrate
from xden_builder.capture.dicom import spacing_note
from xden_builder.physics.source import Detector


def write_dicom(path: Path, pixels: np.ndarray, compress: bool = False, **tags: Any) -> Path:
    meta = pydicom.dataset.FileMetaDataset()
    meta.MediaStorageSOPClassUID = ComputedRadiographyImageStorage
    meta.MediaStorageSOPInstanceUID = generate_uid()
    meta.TransferSyntaxUID = ExplicitVRLittleEndian
    data = pydicom.Dataset()
    data.file_meta = meta
    data.SOPClassUID = meta.MediaStorageSOPClassUID
    data.SOPInstanceUID = meta.MediaStorageSOPInstanceUID
    data.Rows, data.Columns = pixels.shape
    data.SamplesPerPixel = 1
    data.PhotometricInterpretation = "MONOCHROME2"
    data.BitsAllocated, data.BitsStored, data.HighBit = 16, 16, 15
    data.PixelRepresentation = 0
    data.PixelData = pixels.astype("<u2").tobytes()
    if compress:
        data.compress(JPEG2000Lossless, encoding_plugin="pylibjpeg", generate_instance_uid=False)
    for name, value in tags.items():
        setattr(data, name, value)
    data.save_as(path, enforce_file_format=True)
    return path


@pytest.mark.parametrize("compress", [False, True])
def test_dicom_comes_back(tmp_path: Path, compress: bool) -> None:
    pixels = np.random.default_rng(2).integers(0, 65535, (64, 48), endpoint=True)
    image = read_image(write_dicom(tmp_path / "a.dcm", pixels, compress))
    np.testing.assert_array_equal(image.pixels, pixels)
    assert (image.polarity, image.bits, image.intensity_relation) == ("linear", 16, "")


@pytest.mark.parametrize(
    ("tags", "polarity"),
    [
        ({"PhotometricInterpretation": "MONOCHROME1"}, "inverted"),
        ({"PhotometricInterpretation": "MONOCHROME2"}, "linear"),
        (
            {"PhotometricInterpretation": "MONOCHROME1", "PixelIntensityRelationshipSign": 1},
            "linear",
        ),
        ({"PixelIntensityRelationshipSign": -1}, "inverted"),
    ],
)
def test_dicom_polarity_is_the_intensity_sign_before_the_display(
    tmp_path: Path, tags: dict[str, Any], polarity: str
) -> None:
    image = read_image(write_dicom(tmp_path / "a.dcm", np.eye(3), **tags))
    np.testing.assert_array_equal(image.pixels, np.eye(3))
    assert image.polarity == polarity


def test_dicom_rescale_is_applied_and_moves_the_range_of_the_converter(tmp_path: Path) -> None:
    path = write_dicom(tmp_path / "a.dcm", np.eye(2), RescaleSlope="2", RescaleIntercept="-10")
    image = read_image(path)
    np.testing.assert_array_equal(image.pixels, [[-8, -10], [-10, -8]])
    assert image.converter_range(4) == (-10, 20)


@pytest.mark.parametrize(("slope", "polarity"), [("1", "inverted"), ("-1", "linear")])
def test_a_sign_of_what_is_stored_turns_over_with_a_falling_rescale(
    tmp_path: Path, slope: str, polarity: str
) -> None:
    path = write_dicom(
        tmp_path / "a.dcm",
        np.eye(2),
        PixelIntensityRelationshipSign=-1,
        RescaleSlope=slope,
        RescaleIntercept="4095",
    )
    assert read_image(path).polarity == polarity


def test_imager_pixel_spacing_goes_first(tmp_path: Path) -> None:
    path = write_dicom(
        tmp_path / "a.dcm", np.eye(2), PixelSpacing=[0.1, 0.1], ImagerPixelSpacing=[0.2, 0.4]
    )
    assert dicom_pixel_spacing_cm(path) == pytest.approx((0.02, 0.04))
    assert "a pixel of 0.02 x 0.04 cm but not where the detector stands" in spacing_note(path)


def test_real_dicom_radiographs(shared_data: Path) -> None:
    folder = shared_data / "radiographs-dicom"
    chest = read_image(folder / "RG1_J2KI.dcm")
    assert chest.pixels.shape == (1955, 1841)
    assert (chest.pixels.min(), chest.pixels.max(), chest.bits) == (803, 26512, 15)
    assert chest.pixels.mean() == pytest.approx(7391.4, abs=0.05)
    extremity = read_image(folder / "RG3_J2KR.dcm")
    assert extremity.pixels.shape == (1760, 1760)
    assert (extremity.pixels.min(), extremity.pixels.max(), extremity.bits) == (0, 1023, 10)
    assert extremity.pixels.mean() == pytest.approx(332.7, abs=0.05)
    assert chest.polarity == extremity.polarity == "inverted"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("RG1_J2KI.dcm", r"RG1_J2KI\.dcm: PixelSpacing is \[0, 0\]; give the geometry in scanner"),
        ("RG3_J2KR.dcm", r"RG3_J2KR\.dcm: PixelSpacing is missing; give the geometry in scanner"),
    ],
)
def test_a_useless_pixel_spacing_is_refused(shared_data: Path, name: str, message: str) -> None:
    with pytest.raises(DataError, match=message):
        dicom_pixel_spacing_cm(shared_data / "radiographs-dicom" / name)


def test_jpeg_2000_without_its_decoder_names_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_dicom(tmp_path / "a.dcm", np.eye(32), compress=True)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match=r"JPEG 2000 needs pylibjpeg: pip install"):
        read_image(path)


@pytest.mark.parametrize("photometry", ["RGB", "YBR_FULL"])
def test_colours_are_refused(tmp_path: Path, photometry: str) -> None:
    path = write_dicom(tmp_path / "a.dcm", np.eye(2), PhotometricInterpretation=photometry)
    with pytest.raises(
        DataError,
        match=f"expected a DICOM image that is MONOCHROME1 or MONOCHROME2, got {photometry}",
    ):
        read_image(path)


@cache
def whole_files() -> dict[str, bytes]:
    pixels = np.random.default_rng(3).integers(0, 999, (40, 36)).astype("u2")
    with TemporaryDirectory() as name:
        folder = Path(name)
        write_dicom(folder / "plain.dcm", pixels)
        write_dicom(folder / "jpeg2000.dcm", pixels, compress=True)
        return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@settings(max_examples=200, deadline=None, derandomize=True)
@pytest.mark.filterwarnings("ignore")  # what the libraries remark of damaged files is their own
@given(
    name=st.sampled_from(["plain.dcm", "jpeg2000.dcm"]),
    changes=st.dictionaries(st.integers(0, 999), st.integers(0, 255), max_size=3),
    cut=st.none() | st.integers(0, 3000),
)
def test_damage_is_an_image_or_one_error(
    tmp_path_factory: pytest.TempPathFactory, name: str, changes: dict[int, int], cut: int | None
) -> None:
    path = tmp_path_factory.mktemp("damaged") / name
    assert_an_image_or_one_error(path, whole_files()[name], changes, cut)


PHOTONS = np.array([[1000.0, 900.0, 500.0], [100.0, 250.0, 1000.0]])
GEOMETRY = ViewGeometry.from_dict(
    {
        "beam": "parallel",
        "direction": [0, 1, 0],
        "pixel00_cm": [0, 5, 0],
        "column_step_cm": [1, 0, 0],
        "row_step_cm": [0, 0, -1],
        "shape": PHOTONS.shape,
    }
)


def test_a_monochrome1_image_is_turned_over(tmp_path: Path) -> None:
    tags = {"PhotometricInterpretation": "MONOCHROME1", "BitsStored": 12, "HighBit": 11}
    write_dicom(tmp_path / "pa.dcm", 4095 - PHOTONS, **tags)
    stored = ViewFile("pa.dcm", "counts", GEOMETRY, flat=3095.0)
    read = calibrate("pa", stored, tmp_path, tmp_path, Detector())
    np.testing.assert_allclose(read.view.transmission, PHOTONS / 1000, rtol=1e-6)
    assert read.flags == ()


def test_the_scanner_file_stands_above_the_header_and_is_flagged(tmp_path: Path) -> None:
    write_dicom(tmp_path / "pa.dcm", PHOTONS, PhotometricInterpretation="MONOCHROME1")
    stored = ViewFile("pa.dcm", "counts", GEOMETRY, "linear", flat=1000.0)
    read = calibrate("pa", stored, tmp_path, tmp_path, Detector())
    np.testing.assert_allclose(read.view.transmission, PHOTONS / 1000, rtol=1e-6)
    assert read.flags == ("pa:polarity_not_as_dicom",)


def test_a_header_against_flat_and_dark_is_an_error(tmp_path: Path) -> None:
    write_dicom(tmp_path / "pa.dcm", PHOTONS, PhotometricInterpretation="MONOCHROME1")
    stored = ViewFile("pa.dcm", "counts", GEOMETRY, flat=1000.0, dark=10.0)
    with pytest.raises(
        DataError, match=r"pa\.dcm: views\.pa\.polarity is inverted, but most of the open"
    ):
        calibrate("pa", stored, tmp_path, tmp_path, Detector())


@pytest.mark.parametrize("relation", ["LOG", "DISP"])
def test_values_that_are_not_linear_in_photons_are_no_counts(tmp_path: Path, relation: str) -> None:
    write_dicom(tmp_path / "pa.dcm", PHOTONS, PixelIntensityRelationship=relation)
    stored = ViewFile("pa.dcm", "counts", GEOMETRY, flat=1000.0)
    with pytest.raises(
        DataError, match=f"linear in photons, .* PixelIntensityRelationship {relation}"
    ):
        calibrate("pa", stored, tmp_path, tmp_path, Detector())


def scanner_without(key: str, folder: Path) -> Path:
    path = folder / "scanner.toml"
    write_scanner(ScannerFile({"pa": ViewFile("pa.dcm", "counts", GEOMETRY, flat=9.0)}), path)
    kept = [line for line in path.read_text().splitlines() if not line.startswith(key)]
    path.write_text("\n".join(kept))
    return path


def test_missing_geometry_says_what_the_header_lacks(tmp_path: Path) -> None:
    path = scanner_without("column_step_cm", tmp_path)
    write_dicom(tmp_path / "pa.dcm", PHOTONS, PixelSpacing=[0.0, 0.0])
    with pytest.raises(
        DataError,
        match=r"scanner\.toml: views\.pa\.column_step_cm is missing; .*pa\.dcm: PixelSpacing is "
        r"\[0, 0\]; give the geometry in scanner\.toml$",
    ):
        read_scanner(path, tmp_path)
    write_dicom(tmp_path / "pa.dcm", PHOTONS, PixelSpacing=[0.1, 0.1])
    with pytest.raises(DataError, match=r"a pixel of 0\.01 x 0\.01 cm but not where the detector"):
        read_scanner(path, tmp_path)


def test_geometry_in_the_scanner_file_makes_a_useless_spacing_harmless(tmp_path: Path) -> None:
    path = scanner_without("nothing", tmp_path)
    write_dicom(tmp_path / "pa.dcm", PHOTONS, PixelSpacing=[0.0, 0.0])
    stored = read_scanner(path, tmp_path).views["pa"]
    stored = ViewFile(stored.image, stored.quantity, stored.geometry, flat=1000.0)
    view = calibrate("pa", stored, tmp_path, tmp_path, Detector()).view
    assert view.geometry.column_step_cm.tolist() == [1.0, 0.0, 0.0]
