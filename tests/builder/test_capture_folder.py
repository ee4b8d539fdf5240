"""The capture folder as a whole: objects, digests, other parts, and that bad objects stay alone."""

import pickle
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from xden1k.errors import DataError, MissingObjectError
from xden1k.values.views import ViewGeometry
from xden_builder.capture import (
    Candidate,
    CaptureFolder,
    CoarsePose,
    PoseTold,
    ScannerFile,
    ViewFile,
    write_scanner,
)
from xden_builder.capture.pose import MeshScale
from xden_builder.physics.source import Detector, Tube

HEADER = "object_id,category,mesh_units,mass_g,split,source,notes\n"
ROWS = HEADER + 'mug-01,mug,mm,312.5,test,phantom,"blue, chipped"\npen,pen,,,,,\n'
SHAPE = (8, 6)
RAMP = np.linspace(0.1, 1.0, 48).reshape(SHAPE).astype("f4")


def view(image: str, **changes: object) -> ViewFile:
    geometry = ViewGeometry.from_dict(
        {
            "beam": "parallel",
            "direction": [0, 1, 0],
            "pixel00_cm": [0, 5, 0],
            "column_step_cm": [1, 0, 0],
            "row_step_cm": [0, 0, -1],
            "shape": SHAPE,
        }
    )
    return ViewFile(image, "transmission", geometry)


def scanner(tube: Tube | None = None, *extra: str) -> ScannerFile:
    views = {name: view(f"{name}.npy") for name in ("pa", "lat", *extra)}
    return ScannerFile(views, tube, Detector("CsI", 14))


@pytest.fixture
def root(tmp_path: Path) -> Path:
    root = tmp_path / "captures"
    root.mkdir()
    (root / "objects.csv").write_text(ROWS, encoding="utf-8")
    write_scanner(scanner(Tube(kv=100.0), "oblique"), root / "scanner.toml")
    for name, size in (("mug-01", 80), ("pen", 8)):
        (root / name / "parts").mkdir(parents=True)
        trimesh.creation.box((size, size, size)).export(root / name / "parts" / "body.ply")
        for image in ("pa", "lat"):
            np.save(root / name / f"{image}.npy", RAMP)
    np.save(root / "mug-01" / "oblique.npy", RAMP)
    (root / "pen" / "parts.csv").write_text("name,material\nbody,abs\n")
    write_scanner(scanner(), root / "pen" / "scanner.toml")
    return root


def test_an_object_arrives_whole(root: Path) -> None:
    folder = CaptureFolder(root)
    assert folder.object_ids == ("mug-01", "pen")
    mug = folder.read("mug-01")
    assert (mug.object_id, mug.category, mug.split, mug.source) == (
        "mug-01", "mug", "test", "phantom",
    )  # fmt: skip
    assert (mug.weighed_mass_g, mug.notes) == (312.5, "blue, chipped")
    assert (mug.tube, mug.detector) == (Tube(kv=100.0), Detector("CsI", 14))
    assert [v.name for v in mug.views] == ["pa", "lat"]
    assert [v.name for v in mug.audit_views] == ["oblique"]
    np.testing.assert_array_equal(mug.views[1].transmission, RAMP)
    assert [(part.name, part.material) for part in mug.parts] == [("body", "")]
    assert mug.parts[0].mesh.volume == pytest.approx(512)
    assert mug.flags == ()
    assert dict(mug.noise_sd) == {}


def test_what_a_row_leaves_out_has_its_default(root: Path) -> None:
    pen = CaptureFolder(root).read("pen")
    assert (pen.split, pen.source, pen.weighed_mass_g, pen.notes) == (None, "scan", None, "")
    assert pen.parts[0].mesh.volume == pytest.approx(512)
    assert pen.parts[0].material == "abs"


def test_an_object_s_own_scanner_file_replaces_the_common_one_whole(root: Path) -> None:
    pen = CaptureFolder(root).read("pen")
    assert pen.tube is None
    assert pen.audit_views == ()


def test_a_folder_and_a_capture_can_be_sent_to_a_worker(root: Path) -> None:
    folder = pickle.loads(pickle.dumps(CaptureFolder(root)))  # noqa: S301
    capture = pickle.loads(pickle.dumps(folder.read("mug-01")))  # noqa: S301
    assert capture.parts[0].mesh.volume == pytest.approx(512)


def save_mask(root: Path, marked: np.ndarray) -> None:
    Image.fromarray(np.where(marked, 255, 0).astype(np.uint8)).save(
        root / "mug-01" / "ignore_lat.png"
    )


def test_masked_pixels_are_not_looked_at_and_count_for_the_digest(root: Path) -> None:
    before = CaptureFolder(root).digest("mug-01")
    table = np.zeros(SHAPE, dtype=bool)
    table[6:] = True
    save_mask(root, table)
    pa, lat = CaptureFolder(root).read("mug-01").views
    assert pa.valid.all()
    np.testing.assert_array_equal(lat.valid, ~table)
    np.testing.assert_array_equal(np.isnan(lat.transmission), table)
    assert CaptureFolder(root).digest("mug-01") != before


@pytest.mark.parametrize(
    ("marked", "said"),
    [
        (np.zeros((4, 4), dtype=bool), r"ignore_lat.png: expected 8 x 6 pixels, .* got 4 x 4"),
        (np.ones(SHAPE, dtype=bool), r"ignore_lat.png: marks every pixel"),
    ],
)
def test_a_mask_that_does_not_fit_is_refused(root: Path, marked: np.ndarray, said: str) -> None:
    save_mask(root, marked)
    with pytest.raises(DataError, match=said):
        CaptureFolder(root).read("mug-01")
    assert CaptureFolder(root).read("pen").object_id == "pen"


def test_a_mask_whose_name_is_in_capitals_is_not_passed_over(root: Path) -> None:
    save_mask(root, np.zeros(SHAPE, dtype=bool))
    mask = root / "mug-01" / "ignore_lat.png"
    mask.rename(mask.with_name("Ignore_LAT.PNG"))
    with pytest.raises(DataError, match=r"Ignore_LAT\.PNG: expected the name ignore_lat\.png"):
        CaptureFolder(root).read("mug-01")


@pytest.mark.parametrize("name", ["ignore_lat.tif", "ignore_pa.npy", "ignore_ap.png"])
def test_a_mask_of_another_format_or_of_no_view_is_not_passed_over(root: Path, name: str) -> None:
    before = CaptureFolder(root).digest("mug-01")
    (root / "mug-01" / name).write_bytes(b"mine")
    assert CaptureFolder(root).digest("mug-01") != before  # a rebuild that is kept is not
    with pytest.raises(DataError, match=rf"{name}: expected the name ignore_pa\.png or ignore_lat"):
        CaptureFolder(root).read("mug-01")


def test_a_column_that_is_there_twice_and_a_number_with_underscores_are_refused(root: Path) -> None:
    table = root / "objects.csv"
    table.write_text("object_id,category,mass_g,mass_g\npen,pen,1,2\n")
    with pytest.raises(DataError, match=r"objects\.csv: column mass_g is there twice"):
        CaptureFolder(root)
    table.write_text("object_id,category,mass_g\npen,pen,1_000\n")
    with pytest.raises(DataError, match=r"must be a positive number of grams, got '1_000'"):
        CaptureFolder(root)


def test_a_mask_that_is_a_broken_link_is_not_passed_over(root: Path) -> None:
    (root / "mug-01" / "ignore_lat.png").symlink_to("nowhere.png")
    with pytest.raises(DataError, match=r"ignore_lat\.png: expected a file, got a folder or a"):
        CaptureFolder(root).read("mug-01")


POSED = "object_id,category,pose,mesh_scale\npen,pen,"
OFF = "object_id,category,mesh_sd_mm\npen,pen,"


@pytest.mark.parametrize(
    ("cells", "pose", "mesh_scale"),
    [
        (",", "near", "known"),
        ("near,known", "near", "known"),
        ("near,near", "near", "near"),
        ("unknown,near", "unknown", "near"),
        ("unknown,unknown", "unknown", "unknown"),
        ("candidate 2,", Candidate(2), "known"),
        ("0.5 -.5 0.5 0.5 1 -20 3e-1,", CoarsePose((0.5, -0.5, 0.5, 0.5), (1, -20, 0.3)), "known"),
        ("0 0 0 0.98 0 0 0,unknown", CoarsePose((0, 0, 0, 1), (0, 0, 0)), "unknown"),
    ],
)
def test_where_meshes_are_arrives(
    root: Path, cells: str, pose: PoseTold, mesh_scale: MeshScale
) -> None:
    (root / "objects.csv").write_text(POSED + cells)
    pen = CaptureFolder(root).read("pen")
    assert (pen.pose, pen.mesh_scale) == (pose, mesh_scale)


def test_a_further_view_is_handed_over_for_the_fit_and_must_be_there(root: Path) -> None:
    views = dict(scanner(None, "oblique", "top").views)
    views["oblique"] = replace(views["oblique"], fit=True, turned=True)
    write_scanner(ScannerFile(views), root / "scanner.toml")
    mug = CaptureFolder(root).read("mug-01")
    assert [each.name for each in mug.fitted_views] == ["pa", "lat", "oblique"]
    assert [each.name for each in mug.views] == ["pa", "lat"]
    assert mug.audit_views == ()
    assert mug.turned == {"oblique"}
    assert mug.all_views == mug.fitted_views
    (root / "mug-01" / "oblique.npy").unlink()
    with pytest.raises(DataError, match=r"mug-01/oblique\.npy: no such image"):
        CaptureFolder(root).read("mug-01")


def test_empty_columns_of_a_spreadsheet_are_no_columns(root: Path) -> None:
    lines = (root / "objects.csv").read_text().splitlines()
    before = CaptureFolder(root).rows
    (root / "objects.csv").write_text("\n".join(f"{line},, " for line in lines))
    assert CaptureFolder(root).rows == before


def refused_in_one_line(root: Path, raw: bytes, message: str) -> None:
    (root / "objects.csv").write_bytes(raw)
    with pytest.raises(DataError, match=rf"objects\.csv: {message}") as caught:
        CaptureFolder(root)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("object_id\npen\n", "column category is missing"),
        (HEADER, "no objects"),
        ("", "is empty, expected a header and a row for each entry"),
        (
            "object_id,category,colour\npen,pen,red\n",
            "unknown column 'colour'; columns are object_",
        ),
        (
            "object_id,category,,\npen,pen,,\ncup,cup,,blue\n",
            "column 4 has no name, and 'blue' stands in it in row 3",
        ),
        ("object_id;category\npen;pen\n", "columns must be separated by commas, got semicolons"),
        (
            "object_id;category;mass_g\npen;pen;12,5\n",
            "columns must be separated by commas, got sem",
        ),
        ("object_id\tcategory\npen\tpen\n", "columns must be separated by commas, got tabs"),
        ("object_id,category\npen,\n", "row 2, category: must not be empty"),
        ("object_id,category\n,pen\n", "row 2, object_id: must not be empty"),
        ("object_id,category\npen,pen,blue\n", "row 2: 3 fields, expected at most 2 as in the"),
        (
            "object_id,category,mass_g\nmug,mug,\n\npen,pen,0,5\n",
            "row 4: 4 fields, expected at most 3 .*, got 'pen,pen,0,5'; write decimals with a",
        ),
        (
            HEADER + "pen,pen,inch,,,,\nmug,mug,,3,,,\ncup,cup,,-3,,,\nmug,mug,,,,,",
            "row 2, mesh_units: .* got 'inch'; wrong too: row 4, 5",
        ),
        (HEADER + "pen,pen,,,,,\n\npen,pen,,,,,", "row 4, object_id: 'pen' stands in row 2 too"),
        ("object_id,category\n../pen,pen\n", "row 2, object_id: must be of A-Z .*, got '../pen'"),
        (
            "object_id,category\n..,pen\n",
            "row 2, object_id: must be of A-Z a-z 0-9 . _ -, got '..'",
        ),
        (
            "object_id,category\nblue pen,pen\n",
            "row 2, object_id: must be of A-Z .*, got 'blue pen'",
        ),
        (
            HEADER + "pen,pen,inch,,,,",
            "row 2, mesh_units: must be one of cm, mm, m, in, got 'inch'",
        ),
        (
            HEADER + "pen,pen,,,dev,,",
            "row 2, split: must be one of train, val, test, unseen, got 'dev'",
        ),
        (
            HEADER + "pen,pen,,,,real,",
            "row 2, source: must be one of scan, phantom, ct, got 'real'",
        ),
        (
            HEADER + "a,b,,,,,\npen,pen,,-3,,,",
            "row 3, mass_g: must be a positive number of grams, ",
        ),
        (HEADER + "pen,pen,,1e308,,,", "row 2, mass_g: .*, 1e[+]07 at most, got '1e308'"),
        (HEADER + "pen,pen,,0,,,", "row 2, mass_g: must be a positive number of grams, got '0'"),
        (
            HEADER + "pen,pen,,nan,,,",
            "row 2, mass_g: must be a positive number of grams, got 'nan'",
        ),
        (
            HEADER + "pen,pen,,12 g,,,",
            "row 2, mass_g: must be a positive number of grams, got '12 g",
        ),
        (POSED + "0 0 0 1 0 0 1_0,", "row 2, pose: must be near, .* got '0 0 0 1 0 0 1_0'"),
        (OFF + "0_1", "row 2, mesh_sd_mm: must be a number of mm from 0 to 5, got '0_1'"),
        (POSED + "far,", "row 2, pose: must be near, unknown, seven numbers qx .* got 'far'"),
        (POSED + "0 0 0 1 0 0,", "row 2, pose: must be near, .*, got '0 0 0 1 0 0'"),
        (POSED + "0 0 0 1 0 0 nan,", "row 2, pose: must be near, .*, got '0 0 0 1 0 0 nan'"),
        (POSED + "candidate 0,", "row 2, pose: must be near, .* from 1, got 'candidate 0'"),
        (POSED + "5 0 2 0 0 0 1,", "row 2, pose: the quaternion .* norm 1, got 5.39 in '5 0 2"),
        (OFF + "-0.1", "row 2, mesh_sd_mm: must be a number of mm from 0 to 5, got '-0.1'"),
        (OFF + "0.2 mm", "row 2, mesh_sd_mm: must be a number of mm from 0 to 5, got '0.2 mm'"),
        (OFF + "nan", "row 2, mesh_sd_mm: must be a number of mm from 0 to 5, got 'nan'"),
        (POSED + "unknown,2", "row 2, mesh_scale: must be one of known, near, unknown, got '2'"),
        (POSED + ",unknown", "row 2, mesh_scale: is unknown, but meshes whose pose is near"),
    ],
)
def test_a_wrong_objects_csv_is_an_error_of_the_folder(
    tmp_path: Path, text: str, message: str
) -> None:
    refused_in_one_line(tmp_path, text.encode(), message)


def test_a_folder_without_objects_csv_is_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"objects\.csv: no such file"):
        CaptureFolder(tmp_path)


@pytest.mark.parametrize(
    ("raw", "message"),
    [
        (
            "object_id,category,notes\npen,pen,ä\n".encode("cp1252"),
            "row 2: must be UTF-8, got byte",
        ),
        ("object_id,category\nécrou,nut\n".encode("cp1252"), "row 2: must be UTF-8, got byte 0xe9"),
        ("object_id,category\rpen,pén\r".encode("cp1252"), "row 2: must be UTF-8, got byte 0xe9"),
        ("object_id,category\npen,pen\n".encode("utf-16"), "row 1: must be UTF-8, got byte 0xff"),
    ],
)
def test_a_table_in_another_encoding_is_told_where(
    tmp_path: Path, raw: bytes, message: str
) -> None:
    refused_in_one_line(tmp_path, raw, message)


def test_spreadsheet_habits_are_understood(tmp_path: Path) -> None:
    (tmp_path / "objects.csv").write_bytes(
        b"\xef\xbb\xbfobject_id,category,notes\r\n007, NA ,\r\nnan,pen,\xc3\xa4\r\n,,\r\n"
    )
    rows = CaptureFolder(tmp_path).rows
    assert list(rows) == ["007", "nan"]
    assert rows["007"].category == "NA"
    assert rows["nan"].notes == "ä"


def test_an_unknown_object_is_named(root: Path) -> None:
    folder = CaptureFolder(root)
    for ask in (folder.read, folder.digest, folder.ct):
        with pytest.raises(MissingObjectError, match=r"objects\.csv: no object 'spoon'"):
            ask("spoon")


def remove(name: str) -> Callable[[Path], None]:
    return lambda folder: (folder / name).unlink()


def save(name: str, pixels: np.ndarray) -> Callable[[Path], None]:
    return lambda folder: np.save(folder / name, pixels)


def own_scanner(*names: str) -> Callable[[Path], None]:
    views = {name: view(f"{name}.npy") for name in names}
    return lambda folder: write_scanner(ScannerFile(views), folder / "scanner.toml")


def write(name: str, text: str) -> Callable[[Path], None]:
    def do(folder: Path) -> None:
        (folder / name).write_text(text)

    return do


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (remove("lat.npy"), r"mug-01/lat\.npy: no such image"),
        (shutil.rmtree, r"mug-01: no such folder, though objects\.csv has a row for it"),
        (save("pa.npy", RAMP[:5]), r"mug-01/pa\.npy: expected 8 x 6 pixels .*, got 5 x 6"),
        (
            save("pa.npy", RAMP * np.nan),
            r"mug-01/pa\.npy: 48 pixels are not finite, first at \(0, 0",
        ),
        (save("oblique.npy", RAMP.T), r"mug-01/oblique\.npy: expected 8 x 6 pixels"),
        (own_scanner("pa", "side"), r"mug-01/scanner\.toml: views\.lat is missing"),
        (own_scanner("side"), r"mug-01/scanner\.toml: views\.pa is missing"),
        (
            write("scanner.toml", 'schema = "xden-scanner/1"'),
            r"mug-01/scanner\.toml: frame is missi",
        ),
        (
            write("parts.csv", "name,material\nbody,cheese\n"),
            r"parts\.csv: row 2, material: unknown",
        ),
        (remove("parts/body.ply"), r"mug-01: no mesh: expected parts/NAME\.ply"),
        (write("parts/lid.stl", "solid lid\nendsolid"), r"parts/lid\.stl"),
    ],
)
def test_one_bad_object_never_stops_the_others(
    root: Path, spoil: Callable[[Path], None], message: str
) -> None:
    spoil(root / "mug-01")
    folder = CaptureFolder(root)
    with pytest.raises(DataError, match=message) as caught:
        folder.read("mug-01")
    assert "\n" not in str(caught.value)
    assert folder.read("pen").object_id == "pen"


def test_a_missing_common_scanner_file_is_named(root: Path) -> None:
    (root / "scanner.toml").unlink()
    folder = CaptureFolder(root)
    with pytest.raises(DataError, match=r"captures/scanner\.toml: no such file"):
        folder.read("mug-01")
    assert folder.read("pen").object_id == "pen"


def test_other_parts_replace_the_annotated_ones(root: Path, tmp_path: Path) -> None:
    other = tmp_path / "segmented"
    (other / "pen" / "parts").mkdir(parents=True)
    for name, at in (("body", 0), ("cap", 9)):
        mesh = trimesh.creation.box((4, 4, 4)).apply_translation([at, 0, 0])
        mesh.export(other / "pen" / "parts" / f"{name}.stl")
    folder = CaptureFolder(root, other)
    parts = folder.read("pen").parts
    assert [(part.name, part.material) for part in parts] == [("body", "abs"), ("cap", "")]
    assert parts[0].mesh.volume == pytest.approx(64)
    with pytest.raises(DataError, match=r"segmented/mug-01: no mesh"):
        folder.read("mug-01")
    (other / "pen" / "parts.csv").write_text("name,material\ncap,steel\n")
    assert [part.material for part in folder.read("pen").parts] == ["", "steel"]
    assert folder.digest("pen") != CaptureFolder(root).digest("pen")


def test_the_digest_tells_content_not_place(root: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(root, tmp_path / "elsewhere")
    ids = CaptureFolder(root).object_ids
    digests = [[CaptureFolder(place).digest(name) for name in ids] for place in (root, copy)]
    assert digests[0] == digests[1]
    assert len(set(digests[0])) == 2
    assert len(digests[0][0]) == 64


@pytest.mark.parametrize(
    "change",
    [
        save("pa.npy", RAMP + 0.01),
        save("oblique.npy", RAMP + 0.01),
        remove("oblique.npy"),
        write("parts.csv", "name,material\nbody,abs\n"),
        write("parts/README.obj", ""),
        own_scanner("pa", "lat"),
        lambda folder: (folder / "parts" / "body.ply").rename(folder / "parts" / "shell.ply"),
        lambda folder: (folder.parent / "objects.csv").write_text(ROWS.replace("312.5", "313")),
        lambda folder: write_scanner(scanner(Tube(kv=90.0)), folder.parent / "scanner.toml"),
    ],
)
def test_the_digest_changes_with_every_input(root: Path, change: Callable[[Path], None]) -> None:
    before = CaptureFolder(root).digest("mug-01")
    change(root / "mug-01")
    assert CaptureFolder(root).digest("mug-01") != before


@pytest.mark.parametrize(
    "change",
    [
        write("truth.json", "{}"),
        write("ct.npz", "not read by the builder"),
        write("README.md", "about"),
        write("parts/README.md", "about"),
        lambda folder: (folder.parent / "expected.json").write_text("{}"),
        lambda folder: (folder.parent / "objects.csv").write_text(ROWS + "cup,cup,,,,,\n"),
        lambda folder: np.save(folder.parent / "pen" / "pa.npy", RAMP + 1),
    ],
)
def test_the_digest_stays_where_nothing_read_changes(
    root: Path, change: Callable[[Path], None]
) -> None:
    before = CaptureFolder(root).digest("mug-01")
    change(root / "mug-01")
    folder = CaptureFolder(root)
    assert folder.digest("mug-01") == before
    assert folder.read("mug-01").object_id == "mug-01"


def test_flat_and_dark_belong_to_the_digest(root: Path) -> None:
    views = {
        name: ViewFile(f"{name}.npy", "counts", view("").geometry, "linear", "flat.npy", "dark.npy")
        for name in ("pa", "lat")
    }
    write_scanner(ScannerFile(views), root / "scanner.toml")
    np.save(root / "flat.npy", np.full(SHAPE, 2.0))
    np.save(root / "dark.npy", np.full(SHAPE, 0.0))
    folder = CaptureFolder(root)
    np.testing.assert_allclose(folder.read("mug-01").views[0].transmission, RAMP / 2)
    before = folder.digest("mug-01")
    np.save(root / "dark.npy", np.full(SHAPE, 0.01))
    after = folder.digest("mug-01")
    np.save(root / "flat.npy", np.full(SHAPE, 2.1))
    assert len({before, after, folder.digest("mug-01")}) == 3


def test_the_tooth(shared_data: Path) -> None:
    folder = CaptureFolder(shared_data / "captures-tooth")
    assert folder.object_ids == ("tooth",)
    tooth = folder.read("tooth")
    assert (tooth.source, tooth.tube, tooth.weighed_mass_g, tooth.flags) == ("scan", None, None, ())
    for read in tooth.views:
        assert read.transmission.shape == (2, 640)
        assert read.valid.all()
        assert 0.1 < read.transmission.min() < 0.3
        assert 1.0 < read.transmission.max() < 1.1
        assert np.median(read.transmission) == pytest.approx(0.994, abs=0.02)
        assert 0 < tooth.noise_sd[read.name] < 1e-3
    assert [(p.name, p.material, len(p.mesh.faces)) for p in tooth.parts] == [
        ("dentine", "", 2440),
        ("enamel", "", 4508),
    ]
    bounds = np.array([part.mesh.bounds for part in tooth.parts])
    extent = bounds[:, 1].max(axis=0) - bounds[:, 0].min(axis=0)
    np.testing.assert_allclose(extent, [0.23, 0.26, 0.008], atol=0.005)


def test_the_ct_of_the_tooth(shared_data: Path) -> None:
    ct = CaptureFolder(shared_data / "captures-tooth").ct("tooth")
    assert ct is not None
    assert ct.mu_per_cm.shape == (275, 310, 2)
    np.testing.assert_allclose(ct.spacing_cm, [0.001, 0.001, 0.004])
    assert ct.label_names == ("outside", "dentine", "enamel")
    assert ct.labels is not None
    assert ct.mu_per_cm[ct.labels == 1].mean() == pytest.approx(4.61617, rel=1e-4)
    assert ct.mu_per_cm[ct.labels == 2].mean() == pytest.approx(7.50581, rel=1e-4)


def test_the_iron_tetrahedron(shared_data: Path) -> None:
    folder = CaptureFolder(shared_data / "captures-tetra")
    tetra = folder.read("tetra")
    assert (tetra.source, tetra.tube, tetra.detector.bits) == ("phantom", Tube(130.0), 16)
    assert [read.name for read in tetra.audit_views] == ["f02", "f07", "f10", "f13"]
    for read in (*tetra.views, *tetra.audit_views):
        assert read.transmission.shape == (150, 150)
        assert read.valid.all()
        assert 0 < read.transmission.min() < 0.09
        assert read.transmission.max() == pytest.approx(1.0, abs=1e-3)
    assert tetra.views[1].transmission.min() < 1e-4  # one count above dark
    (iron,) = tetra.parts
    assert (iron.name, iron.material, len(iron.mesh.faces)) == ("iron", "iron", 72)
    assert iron.mesh.volume == pytest.approx(5.50374, rel=1e-5)  # millimetres in the file
    assert folder.ct("tetra") is None
    assert folder.digest("tetra") == CaptureFolder(shared_data / "captures-tetra").digest("tetra")


def test_an_object_that_another_folder_of_parts_lacks_is_told_as_that(
    root: Path, tmp_path: Path
) -> None:
    folder = CaptureFolder(root, tmp_path)
    with pytest.raises(DataError, match=r"mug-01: no meshes of this object: was it put in place"):
        folder.parts("mug-01")
