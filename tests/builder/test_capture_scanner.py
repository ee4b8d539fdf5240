"""scanner.toml: what is read, what is refused, and that writing and reading are inverse."""

import re
import tomllib
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from xden1k.errors import DataError
from xden1k.values.materials import load_materials
from xden1k.values.views import ViewGeometry
from xden_builder.capture.scanner import ScannerFile, ViewFile, read_scanner, write_scanner
from xden_builder.physics.source import Detector, Tube

WHOLE = """
schema = "xden-scanner/1"
frame = "object"
[tube]
kv = 100
mas = 126.0
filtration = { Al = 0.25, "aluminium_6061" = 0.1 }
[detector]
scintillator = "CsI"
bits = 16
[views.pa]
image = "pa.tif"
quantity = "counts"
polarity = "linear"
flat = "flat_pa.tif"
dark_value = 105
beam = "cone"
source_cm = [0, -100, 0]
pixel00_cm = [-21.5, 30.0, 21.5]
column_step_cm = [0.042, 0.0, 0.0]
row_step_cm = [0.0, 0.0, -0.042]
shape = [1024, 512]
[views.lat]
image = "lat.npy"
quantity = "attenuation"
beam = "parallel"
direction = [2.0, 0.0, 0.0]
pixel00_cm = [30.0, -21.5, 21.5]
column_step_cm = [0.0, 0.042, 0.0]
row_step_cm = [0.0, 0.0, -0.042]
shape = [1024, 1024]
"""


def read(folder: Path, text: str) -> ScannerFile:
    path = folder / "scanner.toml"
    path.write_text(text, encoding="utf-8")
    return read_scanner(path)


def as_plain(scanner: ScannerFile) -> dict[str, object]:
    views = {
        name: {**vars(view), "geometry": view.geometry.to_dict()}
        for name, view in scanner.views.items()
    }
    tube = asdict(scanner.tube) if scanner.tube else None
    return {"tube": tube, "detector": asdict(scanner.detector), "views": views}


def test_every_key_arrives(tmp_path: Path) -> None:
    scanner = read(tmp_path, WHOLE)
    assert scanner.tube == Tube(
        kv=100.0, mas=126.0, filtration_cm={"Al": 0.25, "aluminium_6061": 0.1}
    )
    assert scanner.detector == Detector("CsI", 16)
    pa, lat = scanner.views.values()
    assert (pa.quantity, pa.polarity, pa.flat, pa.dark) == ("counts", "linear", "flat_pa.tif", 105)
    assert pa.geometry.shape == (1024, 512)
    np.testing.assert_array_equal(pa.geometry.source_cm, [0, -100, 0])
    assert (lat.quantity, lat.polarity, lat.flat, lat.dark) == ("attenuation", None, None, None)
    np.testing.assert_array_equal(lat.geometry.matrix[:, 2], [1, 0, 0])


def test_without_tube_and_detector_both_are_unknown(tmp_path: Path) -> None:
    views = WHOLE[WHOLE.index("[views.pa]") :]
    scanner = read(tmp_path, 'schema = "xden-scanner/1"\nframe = "object"\n' + views)
    assert scanner.tube is None
    assert scanner.detector == Detector()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("xden-scanner/1", "xden-scanner/2", "schema must be xden-scanner/1, got 'xden-scanner/2'"),
        ('frame = "object"', "", "frame is missing, expected object"),
        ('frame = "object"', 'frame = "lab"', "frame must be object, got 'lab'"),
        ('frame = "object"', 'frame = "object"\nmode = 1', "mode is not a known key; known keys"),
        ("kv = 100", "kv = -1", "tube.kv must be a number from 20 to 500 kV"),
        ("kv = 100", "kv = 100000", "tube.kv must be a number from 20 to 500 kV (or energy_kev"),
        ("kv = 100", "kv = true", "tube.kv must be a number from 20 to 500 kV"),
        ("kv = 100", "", "tube.kv is missing, expected a number from 20 to 500 kV (or energy_kev"),
        ("kv = 100", "energy_kev = 60", "tube.energy_kev is a monochromatic source: no kv, mas"),
        ("kv = 100", "kv = 100\nma = 4", "tube.ma is not a known key; known keys are energy_kev"),
        ("Al = 0.25", 'Al = "thin"', "tube.filtration.Al must be a thickness in cm, 0 or more"),
        ("Al = 0.25", "Al = -0.25", "tube.filtration.Al must be a thickness in cm, 0 or more, got"),
        ("Al = 0.25", "Unobtainium = 0.25", "tube.filtration.Unobtainium is neither an element"),
        ("Al = 0.25", "AL = 0.25", "tube.filtration.AL is neither an element nor a name of the"),
        ("bits = 16", "bits = 16.5", "detector.bits must be a whole number from 1 to 32, got 16.5"),
        ("bits = 16", "bits = true", "detector.bits must be a whole number from 1 to 32, got True"),
        ('"cone"', '"fan"', "views.pa.beam must be cone or parallel, got 'fan'"),
        ('beam = "cone"', "", "views.pa.beam is missing, expected cone or parallel"),
        ('image = "pa.tif"', "", "views.pa.image is missing, expected a path inside the object's"),
        ('"pa.tif"', '"../other/pa.tif"', "views.pa.image must be a path inside the object's"),
        ('"flat_pa.tif"', '"/flat.tif"', "views.pa.flat must be a path inside the capture folder"),
        ('flat = "flat_pa.tif"', "", "views.pa.flat is missing, expected flat (an image) or"),
        ('flat = "flat_pa.tif"', 'flat = "f.tif"\nflat_value = 1', "flat and flat_value exclude"),
        ('polarity = "linear"', "", "views.pa.polarity is missing, expected linear or inverted"),
        ('"linear"', '"bright"', "views.pa.polarity must be linear or inverted, got 'bright'"),
        (
            '"attenuation"',
            '"attenuation"\npolarity = "inverted"',
            "polarity is linear by",
        ),
        ('"attenuation"', '"attenuation"\nflat_value = 9', "flat_value goes with counts only"),
        ('"attenuation"', '"absorbance"', "views.lat.quantity must be counts or transmission or"),
        ("dark_value = 105", "dark_value = nan", "views.pa.dark_value must be a number, got nan"),
        ("direction = [2.0, 0.0, 0.0]", "", "views.lat.direction is missing, expected three"),
        ("direction =", "source_cm =", "views.lat.source_cm does not go with a parallel beam"),
        ("[0, -100, 0]", "[0, -100]", "views.pa.source_cm must be three finite numbers"),
        ("[2.0, 0.0, 0.0]", "[0.0, 1.0, 0.0]", "views.lat: the detector is seen edge-on"),
        ("[1024, 512]", "[1024, 0]", "views.pa.shape must be rows and columns, whole numbers from"),
        ("[1024, 512]", "[1024, 512, 3]", "views.pa.shape must be rows and columns"),
        ("[views.pa]", "[views.pa]\nflats = 1", "views.pa.flats is not a known key; known keys"),
        ("[views.pa]", "[views.pa]\nfit = false", "views.pa.fit must be true, or left out"),
        ("[views.lat]", "[views.lat]\nfit = false", "views.lat.fit must be true, or left out"),
        ("[views.lat]", '[views.lat]\nfit = "yes"', "views.lat.fit must be true or false, got"),
        ("[views.pa]", "[views.pa]\nturned = true", "views.pa.turned must be false, or left out"),
        ("[views.lat]", "[views.lat]\nturned = 1", "views.lat.turned must be true or false, got 1"),
        ("[views.lat]", "[views.top]\nturned = true", "views.top.turned goes with a view that is"),
        ("[tube]", "tube = 5\n[other]", "other is not a known key"),
        ("[views.pa]", "[views.pa", "not valid TOML"),
    ],
)
def test_a_wrong_file_is_one_line_with_the_key(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    assert old in WHOLE
    with pytest.raises(DataError, match=re.escape(message)) as caught:
        read(tmp_path, WHOLE.replace(old, new, 1))
    assert str(caught.value).startswith(f"{tmp_path / 'scanner.toml'}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("energy_kev", [0, -60, 0.05, 5000, "60"])
def test_an_energy_beyond_the_attenuation_tables_is_refused(tmp_path: Path, energy_kev) -> None:
    views = WHOLE[WHOLE.index("[views.pa]") :]
    text = f'schema = "xden-scanner/1"\nframe = "object"\n[tube]\nenergy_kev = {energy_kev!r}\n'
    message = r"scanner\.toml: tube\.energy_kev must be a number from 0\.1 to 800 keV, got"
    with pytest.raises(DataError, match=message):
        read(tmp_path, text + views)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"scanner\.toml: no such file"):
        read_scanner(tmp_path / "scanner.toml")


def test_no_views_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="views is missing, expected a table for each view"):
        read(tmp_path, WHOLE[: WHOLE.index("[views.pa]")])


@pytest.mark.parametrize("said", ["fit = true", "turned = false"])
def test_what_goes_without_saying_of_pa_may_be_said(tmp_path: Path, said: str) -> None:
    assert as_plain(read(tmp_path, WHOLE.replace("[views.pa]", f"[views.pa]\n{said}"))) == as_plain(
        read(tmp_path, WHOLE)
    )


def test_a_further_view_is_audited_unless_it_is_to_be_fitted(tmp_path: Path) -> None:
    third = WHOLE[WHOLE.index("[views.lat]") :].replace("[views.lat]", "[views.top]")
    assert read(tmp_path, WHOLE + third).audit_names == ("top",)
    fitted = read(tmp_path, WHOLE + third.replace("]", "]\nfit = true\nturned = true", 1))
    assert (fitted.further_names, fitted.audit_names) == (("top",), ())
    assert [view.turned for view in fitted.views.values()] == [False, False, True]


def test_linear_beside_attenuation_says_nothing_false_and_nothing_new(tmp_path: Path) -> None:
    said = read(tmp_path, WHOLE.replace('"attenuation"', '"attenuation"\npolarity = "linear"'))
    assert as_plain(said) == as_plain(read(tmp_path, WHOLE))


def test_only_a_dicom_image_may_leave_its_polarity_out(tmp_path: Path) -> None:
    text = WHOLE.replace('polarity = "linear"\n', "").replace("pa.tif", "PA.DCM", 1)
    assert read(tmp_path, text).views["pa"].polarity is None


positive = st.floats(1e-6, 1e6)
names = st.text(
    st.characters(codec="utf-8", exclude_characters="/\\"), min_size=1, max_size=9
).filter(lambda name: name not in ("", "..") and not name.isspace())
filters = st.sampled_from(["Al", "Cu", "W", "Be", *load_materials().labels])
calibrations = st.one_of(names, st.floats(-1e5, 1e5))
roles = st.sampled_from([{}, {"fit": True}, {"fit": True, "turned": True}])


@st.composite
def geometries(draw: st.DrawFn) -> ViewGeometry:
    steps = draw(st.tuples(positive, positive))
    offset = np.array(draw(st.tuples(*[st.floats(-50, 50)] * 3)))
    beam = draw(st.sampled_from(["cone", "parallel"]))
    emitter = {"source_cm": offset - [0, 90, 0]} if beam == "cone" else {"direction": [0, 3, 0]}
    return ViewGeometry.from_dict(
        {
            "beam": beam,
            "pixel00_cm": offset,
            "column_step_cm": [-steps[0], 0, 0],
            "row_step_cm": [0, 0, steps[1]],
            "shape": draw(st.tuples(st.integers(1, 4096), st.integers(1, 4096))),
            **emitter,
        }
    )


@st.composite
def scanner_files(draw: st.DrawFn) -> ScannerFile:
    counts = st.builds(
        ViewFile,
        names,
        st.just("counts"),
        geometries(),
        st.sampled_from(["linear", "inverted"]),
        calibrations,
        st.none() | calibrations,
    )
    others = st.builds(
        ViewFile, names, st.sampled_from(["transmission", "attenuation"]), geometries()
    )
    tubes = st.one_of(
        st.none(),
        st.builds(Tube, energy_kev=st.floats(0.1, 800)),
        st.builds(
            Tube,
            kv=st.floats(20, 500),
            mas=st.none() | positive,
            filtration_cm=st.dictionaries(filters, st.just(0.0) | positive, max_size=2),
        ),
    )
    layers = st.none() | positive
    detectors = st.one_of(
        st.builds(
            Detector,
            names | st.just(""),
            st.none() | st.integers(1, 32),
            layers,
            st.none() | st.floats(0, 1),
        ),
        st.builds(
            Detector,
            st.just("CdTe-counting"),
            layer_g_cm2=layers,
            threshold_kev=st.none() | positive,
        ),
    )
    any_view = st.builds(lambda view, role: replace(view, **role), counts | others, roles)
    views = st.dictionaries(names, any_view, min_size=1, max_size=3)
    return ScannerFile(draw(views), draw(tubes), draw(detectors))


@given(scanner_files())
def test_write_then_read_is_identity(
    tmp_path_factory: pytest.TempPathFactory, scanner: ScannerFile
) -> None:
    path = tmp_path_factory.mktemp("scanner") / "scanner.toml"
    write_scanner(scanner, path)
    tomllib.loads(path.read_text(encoding="utf-8"))
    assert as_plain(read_scanner(path)) == as_plain(scanner)


def test_the_shared_scanner_files_survive_a_round_trip(shared_data: Path, tmp_path: Path) -> None:
    for name in ("captures-tooth", "captures-tetra"):
        scanner = read_scanner(shared_data / name / "scanner.toml")
        write_scanner(scanner, tmp_path / "scanner.toml")
        assert as_plain(read_scanner(tmp_path / "scanner.toml")) == as_plain(scanner)
