"""xden-build align: meshes, poses and a page, of every object that can be had."""

from __future__ import annotations

import csv
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner, Result
from PIL import Image

from tests.builder.folders import contents
from tests.builder.registration_scenes import THERE, TrueSearch
from xden1k.errors import DataError
from xden1k.rays import path_lengths
from xden1k.values.views import ViewGeometry, XRayView
from xden_builder.capture import Capture, CaptureFolder
from xden_builder.capture.pose import CoarsePose
from xden_builder.capture.space import Space, divide
from xden_builder.capture.writing import write_table
from xden_builder.cli import cli
from xden_builder.phantoms import Scanner, write_captures
from xden_builder.phantoms.posing import Posing
from xden_builder.pipeline.align.card import make_align_card, pose_text
from xden_builder.pipeline.align.kept import card_of, row_of
from xden_builder.pipeline.align.pictures import FOUND, Sheet
from xden_builder.pipeline.check.run import check_folder
from xden_builder.registration import capture as registration_capture
from xden_builder.registration.capture import registered
from xden_builder.registration.placement import Registration
from xden_builder.registration.shadow import shadow_of

pytestmark = pytest.mark.usefixtures("in_this_process")
CATEGORIES = ("eraser", "mug")


@pytest.fixture(scope="module")
def pristine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two objects of unknown pose and scale, which no test may change."""
    out = tmp_path_factory.mktemp("align") / "captures"
    posing = Posing("unknown", "unknown")
    write_captures(
        out, len(CATEGORIES), 2, scanner=Scanner(size_px=48), posing=posing, categories=CATEGORIES
    )
    return out


@pytest.fixture(autouse=True)
def search(pristine: Path, monkeypatch: pytest.MonkeyPatch) -> TrueSearch:
    """Finds the truth; the mug's shape differs."""
    search = TrueSearch(pristine, mug=["shape_differs"])
    monkeypatch.setattr(registration_capture, "register", search)
    return search


@pytest.fixture
def captures(pristine: Path, tmp_path: Path) -> Path:
    """Captures that a test may change."""
    return Path(shutil.copytree(pristine, tmp_path / "captures"))


def read_rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def write_rows(path: Path, rows: list[dict[str, str]]) -> None:
    write_table(path, list(rows[0]), [list(row.values()) for row in rows])


def align(captures: Path, out: Path, *options: str) -> Result:
    given = ["align", str(captures), "--out", str(out), "--workers", "1", *options]
    return CliRunner().invoke(cli, given)


@pytest.fixture(scope="module")
def out(pristine: Path, in_this_process: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What align writes of them, which no test may change."""
    out = tmp_path_factory.mktemp("aligned") / "aligned"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registration_capture, "register", TrueSearch(pristine, mug=["shape_differs"]))
        answer = align(pristine, out)
    assert answer.exit_code == 0, answer.output
    assert "needs you: mug-0000: shape_differs (look at" in answer.stdout
    assert "2 put in place, 0 near as told, 0 failed" in answer.stdout
    return out


def test_aligned_meshes_are_taken_as_near_and_stand_where_they_were_found(
    pristine: Path, out: Path
) -> None:
    aligned, source = CaptureFolder(pristine, out), CaptureFolder(pristine)
    for object_id in source.object_ids:
        capture, there = aligned.read(object_id), registered(source.read(object_id)).capture
        assert (capture.pose, capture.mesh_scale) == (there.pose, there.mesh_scale)
        assert capture.pose == "near"
        for part, other in zip(capture.parts, there.parts, strict=True):
            np.testing.assert_allclose(part.mesh.bounds, other.mesh.bounds, atol=1e-6)
            assert part.material == other.material


def changed(captures: Path, what: str) -> None:
    """Change something that the pose of the mug was found from."""
    mug, eraser = captures / "mug-0000", captures / "eraser-0000"
    rows = read_rows(captures / "objects.csv")
    told = {"units": {"mesh_units": "m"}, "candidate": {"pose": "candidate 1"}}
    if what in told:
        write_rows(captures / "objects.csv", [row | told[what] for row in rows])
    elif what == "source":
        table = captures / "scanner.toml"
        table.write_text(re.sub(r"(source_cm = .*)-100\.0", r"\1-90.0", table.read_text()))
    elif what == "mask":
        Image.fromarray(np.eye(48, dtype=np.uint8)).save(mug / "ignore_pa.png")
    else:
        first, *_ = sorted(mug.glob(what))
        other, *_ = sorted(eraser.glob(what))
        shutil.copy(other, first)


@pytest.mark.parametrize(
    ("what", "named"),
    [
        ("pa.tif", "radiographs"),
        ("parts/*.ply", "meshes"),
        ("units", "mesh_units"),
        ("candidate", "pose"),
        ("mask", "masks"),
        ("source", "geometry"),
    ],
)
def test_aligned_meshes_of_captures_that_have_changed_since_are_refused(
    pristine: Path, captures: Path, out: Path, what: str, named: str
) -> None:
    changed(captures, what)
    expected = rf"mug-0000.made_from\.json: .* with other {named} than .* `xden-build align`"
    with pytest.raises(DataError, match=expected):
        CaptureFolder(captures, out).read("mug-0000")
    was, now = (CaptureFolder(each, out).digest("mug-0000") for each in (pristine, captures))
    assert was != now  # no row of before stands for it


def test_meshes_that_were_near_as_told_are_refused_where_they_have_changed(
    captures: Path, tmp_path: Path
) -> None:
    near(captures, "mug-0000")
    aligned = tmp_path / "aligned"
    assert align(captures, aligned).exit_code == 0
    for no_matter in ("pa.tif", "mask"):
        changed(captures, no_matter)
        assert CaptureFolder(captures, aligned).read("mug-0000").pose == "near"
    changed(captures, "parts/*.ply")
    with pytest.raises(DataError, match="with other meshes than"):
        CaptureFolder(captures, aligned).read("mug-0000")
    answer = align(captures, tmp_path / "again", "--parts", str(aligned))
    assert "mug-0000: " in answer.stderr
    assert "with other meshes than" in answer.stderr


@pytest.mark.parametrize("units", ["mm", "m"])
def test_units_of_meshes_from_elsewhere_may_not_change_either(
    captures: Path, tmp_path: Path, units: str
) -> None:
    other, aligned = tmp_path / "other", tmp_path / "aligned"
    for object_id in CaptureFolder(captures).object_ids:
        shutil.copytree(captures / object_id / "parts", other / object_id / "parts")
    assert align(captures, aligned, "--parts", str(other)).exit_code == 0
    rows = read_rows(captures / "objects.csv")
    write_rows(captures / "objects.csv", [row | {"mesh_units": units} for row in rows])
    with pytest.raises(DataError, match="with other mesh_units than"):
        CaptureFolder(captures, aligned).read("mug-0000")


def test_aligned_meshes_outlive_a_label_a_mass_and_a_view_that_is_not_fitted(
    captures: Path, out: Path
) -> None:
    rows = read_rows(captures / "objects.csv")
    write_rows(captures / "objects.csv", [row | {"mass_g": "12.5"} for row in rows])
    labels = captures / "mug-0000" / "parts.csv"
    write_rows(labels, [row | {"material": "lead"} for row in read_rows(labels)])
    table = (captures / "scanner.toml").read_text()
    lat = table[table.index("[views.lat]") :]
    oblique = lat.split("\n[", 1)[0].replace("views.lat", "views.oblique")
    (captures / "scanner.toml").write_text(f"{table}\n{oblique.replace('lat.tif', 'ob.tif', 1)}\n")
    shutil.copy(captures / "mug-0000" / "lat.tif", captures / "mug-0000" / "ob.tif")
    capture = CaptureFolder(captures, out).read("mug-0000")
    assert capture.weighed_mass_g == 12.5
    assert {part.material for part in capture.parts} == {"lead"}
    assert [view.name for view in capture.audit_views] == ["oblique"]


@pytest.mark.parametrize("said", ["[]", "{"])
def test_a_damaged_origin_is_one_line(captures: Path, out: Path, said: str) -> None:
    (aligned := captures.parent / "damaged").mkdir()
    shutil.copytree(out / "mug-0000", aligned / "mug-0000")
    (aligned / "mug-0000" / "made_from.json").write_text(said)
    with pytest.raises(DataError, match=r"made_from\.json: expected a JSON object") as caught:
        CaptureFolder(captures, aligned).read("mug-0000")
    assert "\n" not in str(caught.value)


def test_labels_that_came_with_other_meshes_go_with_them(captures: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    for object_id in CaptureFolder(captures).object_ids:
        shutil.copytree(captures / object_id / "parts", other / object_id / "parts")
    labels = read_rows(captures / "mug-0000" / "parts.csv")
    write_rows(other / "mug-0000" / "parts.csv", [row | {"material": "lead"} for row in labels])
    assert align(captures, tmp_path / "aligned", "--parts", str(other)).exit_code == 0
    read = CaptureFolder(captures, tmp_path / "aligned").read("mug-0000")
    assert {part.material for part in read.parts} == {"lead"}


def test_poses_of_the_table_can_be_pasted_into_objects_csv(out: Path, captures: Path) -> None:
    found = {row["object_id"]: row["pose"] for row in read_rows(out / "poses.csv")}
    told = [row | {"pose": found[row["object_id"]]} for row in read_rows(captures / "objects.csv")]
    write_rows(captures / "objects.csv", told)
    for object_id, row in CaptureFolder(captures).rows.items():
        truth = json.loads((captures / object_id / "truth.json").read_text())["mesh_pose"]
        assert isinstance(row.pose, CoarsePose)
        np.testing.assert_allclose(row.pose.translation_cm, truth["translation_cm"], atol=1e-3)
        quaternion = np.array(row.pose.quaternion_xyzw)
        assert abs(quaternion @ truth["quaternion_xyzw"]) == pytest.approx(1.0, abs=1e-5)


def test_a_pose_as_text_has_no_exponents_nor_minus_zeros() -> None:
    tiny = replace(THERE, rotation=np.eye(3), translation_cm=np.array([1e-9, -1e-9, 123.456789]))
    assert pose_text(tiny) == "0 0 0 1 0 0 123.457"


def test_the_page_asks_nobody_for_anything_and_shows_every_object(out: Path) -> None:
    page = (out / "index.html").read_text()
    assert "default-src 'none'" in page
    assert not re.search(r"(?:src|href)=\"(?!data:|#|poses\.csv)", page)
    assert "http" not in page.replace("http-equiv", "")
    assert re.findall(r'id="o-([\w-]+)"', page)[0] == "mug-0000"
    assert page.count("where they disagree</figcaption>") == 2
    assert page.count('<code class="paste">candidate 2</code>') == len(CATEGORIES)


def test_densities_that_differ_between_fitted_candidates_stand_with_each(
    captures: Path, tmp_path: Path
) -> None:
    """Pictures show outlines, which are the same where parts exchange their densities."""
    capture = CaptureFolder(captures).read("mug-0000")
    search = TrueSearch(captures)(capture, divide(capture.parts))
    densities = np.ones(len(capture.parts))
    other = densities.copy()
    other[0] = 2.5
    first, second = search.candidates
    unfitted = make_align_card(capture, search)
    assert [each.densities_g_cm3 for each in unfitted.candidates] == [(), ()]
    fitted = (
        replace(first, density_g_cm3=densities, deviance=3.0),
        replace(second, density_g_cm3=other, deviance=3.1),
    )
    card = make_align_card(capture, replace(search, candidates=fitted))
    name = capture.parts[0].name
    assert [each.densities_g_cm3 for each in card.candidates] == [((name, 1.0),), ((name, 2.5),)]
    assert card_of(row_of(card, tmp_path / "none")) == card


def test_names_and_notes_are_shown_as_they_are(captures: Path, tmp_path: Path) -> None:
    table = captures / "objects.csv"
    table.write_text(table.read_text().replace(",eraser,", ",<script>eraser</script>,"))
    answer = align(captures, tmp_path / "out", "--objects", "eraser-0000")
    assert answer.exit_code == 0, answer.output
    page = (tmp_path / "out" / "index.html").read_text()
    assert "&lt;script&gt;eraser" in page
    assert "<script" not in page


def test_nothing_that_is_there_is_overwritten(pristine: Path, out: Path) -> None:
    before = contents(out)
    answer = align(pristine, out)
    assert answer.exit_code == 1
    assert "expected a folder that is empty or does not exist" in answer.output
    assert contents(out) == before


def test_one_bad_object_never_stops_the_others(captures: Path, tmp_path: Path) -> None:
    (captures / "mug-0000" / "pa.tif").unlink()
    answer = align(captures, tmp_path / "out", "--json")
    assert answer.exit_code == 3
    said = json.loads(answer.stdout)
    assert [each["object_id"] for each in said["failures"]] == ["mug-0000"]
    assert [each["object_id"] for each in said["objects"]] == ["eraser-0000"]
    assert not (tmp_path / "out" / "mug-0000").exists()
    assert "mug-0000/pa.tif" in (tmp_path / "out" / "index.html").read_text()


def test_where_no_object_can_be_placed_nothing_is_written(
    captures: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: Any) -> None:
        raise DataError("view pa: no shadow of an object is in the image")

    monkeypatch.setattr(registration_capture, "register", refuse)
    answer = align(captures, tmp_path / "out")
    assert answer.exit_code == 1
    assert "the first, eraser-0000: view pa: no shadow" in answer.output
    assert [path.name for path in tmp_path.iterdir()] == ["captures"]


def test_an_object_that_is_not_there_is_refused_before_anything(
    pristine: Path, tmp_path: Path
) -> None:
    answer = align(pristine, tmp_path / "out", "--objects", "eraser-0000,ghost-0001")
    assert answer.exit_code == 1
    assert "objects.csv: no object 'ghost-0001'" in answer.output


def test_what_an_interrupted_alignment_has_done_is_not_done_again(
    pristine: Path, out: Path, tmp_path: Path, search: TrueSearch, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(capture: Capture, space: Space) -> Registration:
        if capture.category == "eraser":
            raise KeyboardInterrupt
        return search(capture, space)

    there, looked_for = tmp_path / "there", list[str]()
    monkeypatch.setattr(registration_capture, "register", interrupted)
    answer = align(pristine, there)
    assert answer.exit_code == 130
    assert "1 of 2 done; run again to go on" in answer.output
    assert not there.exists()

    def counted(capture: Capture, space: Space) -> Registration:
        looked_for.append(capture.category)
        return search(capture, space)

    monkeypatch.setattr(registration_capture, "register", counted)
    assert align(pristine, there).exit_code == 0
    assert looked_for == ["eraser"]
    assert contents(there) == contents(out)
    assert [path.name for path in tmp_path.iterdir()] == ["there"]


def test_work_of_a_rebuild_to_the_same_place_is_left_alone(pristine: Path, tmp_path: Path) -> None:
    work = tmp_path / "there.work"
    work.mkdir()
    (work / "mug-0000.h5").write_bytes(b"of a rebuild")
    assert align(pristine, tmp_path / "there").exit_code == 0
    assert (work / "mug-0000.h5").read_bytes() == b"of a rebuild"
    assert {path.name for path in tmp_path.iterdir()} == {"there", "there.work"}


def test_an_object_that_has_changed_since_an_interruption_is_looked_for_again(
    captures: Path, tmp_path: Path, search: TrueSearch, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked_for = list[str]()

    def interrupted(capture: Capture, space: Space) -> Registration:
        looked_for.append(capture.category)
        if capture.category == "eraser":
            raise KeyboardInterrupt
        return search(capture, space)

    monkeypatch.setattr(registration_capture, "register", interrupted)
    for _ in range(2):
        assert align(captures, tmp_path / "there").exit_code == 130
        shutil.copy(captures / "mug-0000" / "lat.tif", captures / "mug-0000" / "pa.tif")
    assert looked_for == ["mug", "eraser"] * 2


def near(captures: Path, object_id: str) -> None:
    """Say that an object's meshes are near their place, which they are."""
    aligned = registered(CaptureFolder(captures).read(object_id)).capture
    for part in aligned.parts:
        part.mesh.export(captures / object_id / "parts" / f"{part.name}.ply")
    told = {"mesh_units": "cm", "pose": "near", "mesh_scale": ""}
    rows = read_rows(captures / "objects.csv")
    write_rows(
        captures / "objects.csv",
        [row | told if row["object_id"] == object_id else row for row in rows],
    )


def test_meshes_told_to_be_near_are_written_as_they_are_unless_all_are_looked_for(
    captures: Path, tmp_path: Path
) -> None:
    near(captures, "eraser-0000")
    only = "--objects", "eraser-0000", "--json"
    answer = align(captures, tmp_path / "some", *only)
    assert json.loads(answer.stdout)["near"] == ["eraser-0000"]
    for part in CaptureFolder(captures).read("eraser-0000").parts:
        written = trimesh.load_mesh(
            tmp_path / "some" / "eraser-0000" / "parts" / f"{part.name}.ply"
        )
        np.testing.assert_allclose(written.bounds, part.mesh.bounds, atol=1e-6)
    answer = align(captures, tmp_path / "all", "--all", *only)
    assert [each["object_id"] for each in json.loads(answer.stdout)["objects"]] == ["eraser-0000"]


def test_other_meshes_are_put_in_place_of_those_of_the_captures(
    captures: Path, pristine: Path, tmp_path: Path
) -> None:
    for mesh in captures.glob("*/parts/*"):
        mesh.write_bytes(b"")
    assert align(captures, tmp_path / "without").exit_code == 1
    answer = align(captures, tmp_path / "with", "--parts", str(pristine))
    assert answer.exit_code == 0, answer.output
    assert len(list((tmp_path / "with").glob("*/registration.json"))) == len(CATEGORIES)


def test_check_says_that_no_pose_goes_with_the_shadows(pristine: Path, search: TrueSearch) -> None:
    search.flags["mug"] = ["pose_not_found"]
    eraser, mug = check_folder(pristine, workers=1).objects
    assert eraser.findings == ()
    assert [(said.kind, said.message[:31]) for said in mug.findings] == [
        ("contradicts", "pose_not_found: no pose of the ")
    ]


def ball_on_a_sheet(exposure: float = 1.0) -> tuple[Sheet, trimesh.Trimesh]:
    """A ball of 3 cm in pixels of 1 mm; one pixel of the radiograph is dead."""
    geometry = ViewGeometry.from_dict(
        {
            "beam": "cone",
            "source_cm": [0, -50, 0],
            "pixel00_cm": [-7, 10, 7],
            "column_step_cm": [0.2, 0, 0],
            "row_step_cm": [0, 0, -0.2],
            "shape": [71, 71],
        }
    )
    ball = trimesh.creation.icosphere(2, 3.0)
    image = np.float32(exposure) * path_lengths([ball], [0], geometry).image(np.array([1.0]))
    image[3, 3] = np.nan
    view = XRayView("pa", image, np.isfinite(image), geometry)
    return Sheet.of(view, shadow_of(view), np.array([0, 0, 71, 71]) - 0.5, 142), ball


def test_air_is_black_whatever_the_exposure_and_a_dead_pixel_alone_has_no_grey() -> None:
    sheet, _ = ball_on_a_sheet(exposure=0.8)
    colours = sheet.grey[..., :3].astype(int)
    assert (colours[-20:, -20:] < 3).all()
    coloured = np.ptp(colours, axis=-1) > 0
    assert 0 < coloured.sum() < 40


def test_a_silhouette_is_drawn_around_what_the_mesh_covers_and_where_the_shadow_is() -> None:
    sheet, ball = ball_on_a_sheet()
    covered = sheet._silhouette([ball])
    assert (covered ^ sheet.shadow).sum() < 0.1 * covered.sum()
    assert sheet.outlined("ball", [ball], FOUND) is not None
    behind = ball.copy().apply_translation((0, -60, 0))
    beside = ball.copy().apply_translation((40, 0, 0))
    assert sheet.outlined("behind the source", [behind], FOUND) is None
    assert sheet.outlined("beside the panel", [beside], FOUND) is None
