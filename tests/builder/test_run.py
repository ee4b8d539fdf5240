"""A rebuild as a whole: resumable, repeatable, and stopped by no bad object."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner

from tests.builder.folders import contents
from xden1k.errors import DataError
from xden1k.folder import open_folder, write_folder
from xden1k.rays import path_lengths
from xden_builder.audit.object import audit_object
from xden_builder.audit.view import audit_view
from xden_builder.capture import Capture, CaptureFolder
from xden_builder.cli import cli
from xden_builder.phantoms import write_captures
from xden_builder.pipeline import version
from xden_builder.pipeline.run import build, work_folder
from xden_builder.pipeline.version import OtherVersionError
from xden_builder.poly.hardness import Hardness
from xden_builder.poly.survey import Clue
from xden_builder.reconstruct.clues import find_clues
from xden_builder.reconstruct.object import reconstruct
from xden_builder.reconstruct.settings import BuildSettings
from xden_builder.triage.findings import Findings, Remark
from xden_builder.triage.remarks import folder_remarks
from xden_builder.workers import run_each

SETTINGS = BuildSettings()
pytestmark = pytest.mark.usefixtures("in_this_process")


@pytest.fixture(scope="module")
def pristine(tmp_path_factory) -> Path:
    """Captures of three phantoms, which no test may change."""
    root = tmp_path_factory.mktemp("captures") / "captures"
    write_captures(root, 3, 5, size=128, categories=["hammer", "mug", "screwdriver"])
    return root


@pytest.fixture(scope="module")
def built(pristine, in_this_process) -> Path:
    """The dataset folder of them."""
    out = pristine.with_name("dataset")
    build(pristine, out, SETTINGS, workers=2)
    return out


@pytest.fixture
def captures(pristine, tmp_path) -> Path:
    """Captures that a test may change."""
    return Path(shutil.copytree(pristine, tmp_path / "captures"))


@pytest.fixture
def half_built(built, tmp_path) -> Path:
    """A result with its work files, which a test may change."""
    shutil.copytree(work_folder(built), work_folder(tmp_path / "dataset"))
    return Path(shutil.copytree(built, tmp_path / "dataset"))


def statuses(report) -> dict[str, str]:
    return {outcome.object_id: outcome.status for outcome in report.outcomes}


def test_densities_come_back_within_five_sd_of_the_simulators_truth(pristine, built):
    for obj in open_folder(built).objects():
        truth = json.loads((pristine / obj.object_id / "truth.json").read_text())
        true_density = {part["name"]: part["density_g_cm3"] for part in truth["parts"]}
        for part in obj.parts:
            off = abs(part.density_g_cm3 - true_density[part.name])
            assert off < 5 * part.density_sd_g_cm3, (obj.object_id, part)
            if not part.flags:
                assert off < 0.03 * true_density[part.name], (obj.object_id, part)
        assert obj.mass_g == pytest.approx(truth["mass_g"], rel=0.05)


def test_stored_radiographs_and_parts_reproject_onto_the_captures(pristine, built):
    source = CaptureFolder(pristine)
    for obj in open_folder(built).objects():
        assert audit_object(obj, source.read(obj.object_id)).good


def test_a_capture_of_another_size_than_the_datasets_is_not_compared_with_it(pristine, built):
    obj = next(open_folder(built).objects())
    capture = CaptureFolder(pristine).read(obj.object_id)
    pa, lat = capture.views
    geometry = replace(pa.geometry, shape=(64, 128))
    half = replace(pa, transmission=pa.transmission[:64], valid=pa.valid[:64], geometry=geometry)
    with pytest.raises(DataError, match=r"view pa has 64 x 128 pixels, and 128 x 128 in the data"):
        audit_object(obj, replace(capture, views=(half, lat)))


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_a_build_in_processes_of_its_own_gives_the_same_bytes(
    pristine, built, tmp_path, monkeypatch, workers
):
    monkeypatch.setattr("xden_builder.pipeline.run.run_each", run_each)
    build(pristine, tmp_path / "again", SETTINGS, workers=workers)
    assert contents(tmp_path / "again") == contents(built)


def test_a_rerun_makes_only_what_is_missing_or_changed(captures, half_built):
    gone, changed, kept = CaptureFolder(captures).object_ids
    (work_folder(half_built) / f"{gone}.h5").unlink()
    table = captures / changed / "parts.csv"
    table.write_text(table.read_text() + "\n")
    report = build(captures, half_built, SETTINGS, workers=2)
    assert statuses(report) == {gone: "built", changed: "built", kept: "kept"}
    spent = {one.object_id: one.cost.processor_s for one in report.outcomes}
    assert spent[kept] < min(spent[gone], spent[changed])
    assert report.shared_processor_s is None  # the beam is kept too


@pytest.mark.slow
def test_other_settings_make_everything_anew(captures, half_built):
    report = build(captures, half_built, BuildSettings(subrays=1), workers=2)
    assert set(statuses(report).values()) == {"built"}


def test_the_beam_that_was_found_holds_while_most_objects_are_as_they_were(captures, half_built):
    beam = work_folder(half_built) / "beam.json"
    before = json.loads(beam.read_text())
    assert list(before["objects"]) == sorted(CaptureFolder(captures).object_ids)
    marked = before | {"hardness": before["hardness"] | {"filter_mm_cu": 0.0123}}
    beam.write_text(json.dumps(marked))
    one, two, _ = before["objects"]
    for changed, holds in ((one, True), (two, False)):
        image = captures / changed / "pa.tif"
        image.write_bytes(image.read_bytes() + b"\0")
        build(captures, half_built, SETTINGS, workers=1)
        settings = open_folder(half_built).object(one).meta["settings"]["poly"]
        assert (settings["extra_filter_mm_cu"] == 0.0123) == holds


def test_a_beam_of_a_few_objects_is_asked_for_anew_where_there_are_many(captures, half_built):
    beam = work_folder(half_built) / "beam.json"
    said = json.loads(beam.read_text())
    first, *_ = said["objects"]
    few = said | {"objects": {first: said["objects"][first]}}
    beam.write_text(json.dumps(few))
    report = build(captures, half_built, SETTINGS, workers=1)
    assert report.shared_processor_s is not None
    assert json.loads(beam.read_text()) == said


def test_a_beam_of_few_objects_is_sought_anew_once_the_others_can_be_read(
    captures, built, tmp_path
):
    images = [captures / each / "pa.tif" for each in CaptureFolder(captures).object_ids[1:]]
    for each in images:
        each.rename(each.with_suffix(".gone"))
    out = tmp_path / "dataset"
    before = statuses(build(captures, out, SETTINGS, workers=1))
    assert sorted(before.values()) == ["built", "failed", "failed"]
    for each in images:
        each.with_suffix(".gone").rename(each)
    build(captures, out, SETTINGS, workers=1)
    found, whole = (work_folder(each) / "beam.json" for each in (out, built))
    assert found.read_bytes() == whole.read_bytes()
    assert contents(out) == contents(built)


def test_who_told_of_the_beam_before_a_run_was_stopped_is_not_asked_again(
    captures, built, tmp_path, monkeypatch
):
    def stop(answered: int, asked: int) -> None:
        assert asked == 3
        if answered == 2:
            raise KeyboardInterrupt

    def counted(capture: Capture, settings: BuildSettings) -> tuple[Clue, ...]:
        again.append(capture.object_id)
        return find_clues(capture, settings)

    again: list[str] = []
    with pytest.raises(KeyboardInterrupt):
        build(captures, tmp_path / "dataset", SETTINGS, workers=1, on_asked=stop)
    monkeypatch.setattr("xden_builder.pipeline.beam.find_clues", counted)
    report = build(captures, tmp_path / "dataset", SETTINGS, workers=1)
    assert len(again) == 1
    assert set(statuses(report).values()) == {"built"}
    found, whole = (work_folder(each) / "beam.json" for each in (tmp_path / "dataset", built))
    assert found.read_bytes() == whole.read_bytes()
    assert contents(tmp_path / "dataset") == contents(built)


def test_a_damaged_record_of_the_beam_is_made_again(captures, half_built):
    beam = work_folder(half_built) / "beam.json"
    before = beam.read_bytes()
    beam.write_bytes(before[: len(before) // 2])
    report = build(captures, half_built, SETTINGS, workers=1)
    assert set(statuses(report).values()) == {"kept"}
    assert beam.read_bytes() == before
    told = json.loads((work_folder(half_built) / "build_report.json").read_text())
    assert told["shared_processor_s"] == report.shared_processor_s > 0
    assert all(one["seconds"] > 0 and one["processor_s"] > 0 for one in told["objects"])


@pytest.mark.slow
def test_a_filter_that_was_told_is_believed(captures, tmp_path):
    told = replace(SETTINGS, filtration="told")
    report = build(captures, tmp_path / "out", told, workers=1)
    assert report.beam is None
    assert not (work_folder(tmp_path / "out") / "beam.json").exists()


@pytest.mark.parametrize(
    ("beam", "words"),
    [
        (
            Hardness(0.1, 0.02, 40, 20, None, 1.0, 1.0),
            "filter does not explain these images: 0.10 ± 0.02 mm",
        ),
        (
            Hardness(0.2, 0.05, 3, 3, None, 1.0, 1.0, rests_on=("glass_soda_lime",)),
            "linear; without the parts labelled glass_soda_lime it would: check these)",
        ),
        (Hardness(-0.03, 0.004, 40, 20, None, 1.0, 1.0), "0.03 ± 0.00 mm Cu less would"),
        (
            Hardness(0.05, 0.02, 40, 20, (0.0, 0.1), 1.0, 1.0),
            "0.00 mm Cu more than told explains some, 0.10",
        ),
        (
            Hardness(0.29, 0.1, 16, 7, None, 2.3, 2.3, label_ratio=0.51),
            "behind any filter metals, glass and liquids show 0.51 times the density",
        ),
        (
            Hardness(0.0, 0.1, 16, 7, None, 2.3, 2.3, plastics_ratio=0.43),
            "plastics show 0.43 times the density of their labels",
        ),
    ],
)
def test_a_filter_that_does_not_explain_the_images_is_told(beam, words):
    said = [str(remark) for remark in folder_remarks(beam, None)]
    assert words in said[0]
    assert said[0].startswith("needs you: ")


@pytest.mark.parametrize(
    ("growths", "said"),
    [
        ((0.0101, 0.0099, 0.0102, 0.0098, 0.01), "larger before lat than before the other views"),
        ((-0.0101, -0.0099, -0.0102, -0.0098, -0.01), "smaller before lat"),
        ((0.01, -0.012, 0.001, -0.0005, 0.006), ""),
        ((0.0101, 0.0099), ""),
    ],
)
def test_a_view_before_which_all_objects_are_larger_is_told_once(growths, said):
    judged = [
        Findings(f"mug-{number}", "mug", (), 1.0, 0.1, None, None, {}, apart=apart)
        for number, apart in enumerate({"view": "lat", "growth": each} for each in growths)
    ]
    remarks = [str(remark) for remark in folder_remarks(None, None, judged)]
    assert len(remarks) == bool(said)
    assert all(said in text and "source_cm, column_step_cm" in text for text in remarks)


@pytest.mark.parametrize(("unlike", "said"), [(3, True), (2, False)])
def test_labels_that_most_objects_contradict_are_said_to_be_of_the_beam(unlike, said):
    flags = ["unlike_material"] * unlike + ["uncertain"] * 2
    judged = [
        Findings(f"mug-{number}", "mug", (Remark(flag, "cap"),), 1.0, 0.1, None, None, {})
        for number, flag in enumerate(flags)
    ]
    remarks = [str(remark) for remark in folder_remarks(None, None, judged)]
    assert [text.startswith(f"needs you: {unlike} of 5 objects have") for text in remarks] == (
        [True] if said else []
    )


def test_a_filter_that_explains_the_images_is_not_spoken_of():
    assert [*folder_remarks(Hardness(0.004, 0.01, 40, 20, None, 1.0, 1.0), None)] == []


@pytest.mark.parametrize(
    ("scales", "words"),
    [
        (
            (0.3, 0.9),
            "images err 0.30 and compositions 0.90 times as far as is assumed; deviations",
        ),
        (
            (0.9, 0.3),
            "images err 0.90 and compositions 0.30 times as far as is assumed; deviations",
        ),
        ((0.3, 2.5), "deviations are not larger for what errs more"),
        ((2.5, 1.0), "deviations are not larger for what errs more"),
        ((1.0, 1.2), ""),
    ],
)
def test_errors_that_are_not_as_assumed_are_spoken_of(scales, words):
    said = [
        str(remark) for remark in folder_remarks(Hardness(0.0, 0.01, 40, 20, None, *scales), None)
    ]
    assert [words in each for each in said] == ([True] if words else [])
    assert all(each.startswith("for information: ") for each in said)


def test_answers_beside_captures_go_into_the_dataset_and_stay(captures, half_built):
    (captures / "datasheet.toml").write_text('[motivation]\nfunding = "A lottery."\n')
    assert set(statuses(build(captures, half_built, SETTINGS, workers=2)).values()) == {"kept"}
    told = contents(half_built)
    assert "A lottery." in (half_built / "DATASHEET.md").read_text()
    (captures / "datasheet.toml").unlink()
    build(captures, half_built, SETTINGS, workers=2)
    assert contents(half_built) == told
    (captures / "datasheet.toml").write_text("[motivation]\nfundng = 'x'\n")
    with pytest.raises(
        DataError, match=r"captures/datasheet\.toml: unknown key motivation\.fundng"
    ):
        build(captures, half_built, SETTINGS, workers=2)


def test_a_bad_object_is_listed_and_the_others_are_built(captures, tmp_path):
    bad, *good = CaptureFolder(captures).object_ids
    (captures / bad / "lat.tif").unlink()
    out = tmp_path / "out"
    ran = CliRunner().invoke(cli, ["run", str(captures), "--out", str(out), "--workers", "2"])
    assert ran.exit_code == 3
    line, remark = [text for text in ran.stderr.splitlines() if text]
    assert line.startswith(f"failed: {bad}: ")
    assert "lat.tif" in line
    assert "scanner.toml: the scanner was not calibrated" in remark
    assert sorted(open_folder(out).ids()) == sorted(good)
    report = json.loads((work_folder(out) / "build_report.json").read_text())
    assert (report["built"], report["failed"]) == (2, 1)


def test_no_good_object_means_one_line_and_no_dataset(captures, tmp_path):
    for object_id in CaptureFolder(captures).object_ids:
        (captures / object_id / "pa.tif").write_bytes(b"not a TIFF")
    out = tmp_path / "out"
    ran = CliRunner().invoke(cli, ["run", str(captures), "--out", str(out), "--workers", "2"])
    assert ran.exit_code == 1
    *failed, error = [text for text in ran.stderr.splitlines() if text]
    assert len(failed) == 3
    assert all(line.startswith("failed: ") and "pa.tif" in line for line in failed)
    assert error.startswith("Error: ")
    assert f"no object could be built, {out} is not written" in error
    assert not out.exists()


def test_a_failing_rebuild_leaves_the_older_dataset_alone(captures, half_built):
    before = contents(half_built)
    for object_id in CaptureFolder(captures).object_ids:
        (captures / object_id / "pa.tif").unlink()
    with pytest.raises(DataError, match="no object could be built"):
        build(captures, half_built, SETTINGS, workers=2)
    assert contents(half_built) == before


def test_a_machine_with_other_code_ends_the_run(captures, tmp_path, monkeypatch):
    versions = iter(["this version's checksum", "another's"])
    monkeypatch.setattr(version, "made_by_checksum", lambda _: next(versions))
    with pytest.raises(OtherVersionError, match="has another version of xden1k"):
        build(captures, tmp_path / "out", SETTINGS, workers=1)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "exit_code", "told"),
    [
        (["--parts", "nowhere"], 1, "nowhere: no such folder of part meshes"),
        (["--cluster", "auto", "--workers", "2"], 2, "--workers has no meaning with --cluster"),
    ],
)
def test_wrong_words_are_one_line(captures, tmp_path, words, exit_code, told):
    ran = CliRunner().invoke(cli, ["run", str(captures), "--out", str(tmp_path / "out"), *words])
    assert ran.exit_code == exit_code
    assert told in ran.stderr
    assert list(tmp_path.iterdir()) == [captures]


def test_a_folder_that_is_no_dataset_is_not_replaced(captures, tmp_path):
    out = tmp_path / "precious"
    out.mkdir()
    (out / "thesis.txt").write_text("mine")
    ran = CliRunner().invoke(cli, ["run", str(captures), "--out", str(out)])
    assert ran.exit_code == 1
    assert str(out) in ran.stderr
    assert (out / "thesis.txt").read_text() == "mine"
    assert not work_folder(out).exists(), "said only after the work"


def test_a_part_without_space_of_its_own_is_an_error(captures, tmp_path):
    target = CaptureFolder(captures).object_ids[0]
    parts = captures / target / "parts"
    first = sorted(parts.iterdir())[0]
    mesh, within = trimesh.load(first), trimesh.creation.icosphere(radius=0.01)
    largest = int(mesh.area_faces.argmax())
    within.apply_translation(mesh.triangles_center[largest] - 0.02 * mesh.face_normals[largest])
    within.export(parts / "ghost.ply")
    table = captures / target / "parts.csv"
    table.write_text("name,material,priority\n" + f"{first.stem},,9\nghost,,1\n")
    for other in parts.iterdir():
        if other.name not in ("ghost.ply", first.name):
            other.unlink()
    report = build(captures, tmp_path / "out", SETTINGS, workers=2)
    (failure,) = report.failures
    assert failure.message == (
        "part ghost: other parts own all of its space; see priority in parts.csv"
    )


@pytest.mark.slow
def test_the_papers_way_runs_and_says_so(pristine, tmp_path):
    one = tmp_path / "captures"
    shutil.copytree(pristine, one)
    table = (one / "objects.csv").read_text().splitlines()
    (one / "objects.csv").write_text("\n".join(table[:2]) + "\n")
    build(one, tmp_path / "out", BuildSettings(model="paper"), workers=1)
    (obj,) = open_folder(tmp_path / "out").objects()
    assert obj.meta["model"] == "paper"
    assert obj.meta["fit"]["solver"] == "adam"
    assert set(obj.meta["fit"]["gain"].values()) == {1.0}


def test_a_part_that_crosses_itself_is_flagged(pristine):
    capture = CaptureFolder(pristine).read(CaptureFolder(pristine).object_ids[0])
    crossing = trimesh.util.concatenate(
        [trimesh.creation.box((1, 1, 6)), trimesh.creation.box((1, 6, 1))]
    )
    part = replace(capture.parts[0], mesh=crossing, material="")
    (flagged,) = reconstruct(replace(capture, parts=(part,))).parts
    assert "volume_unsure" in flagged.flags
    (sound,) = reconstruct(
        replace(capture, parts=(replace(part, mesh=trimesh.creation.box((1, 1, 6))),))
    ).parts
    assert "volume_unsure" not in sound.flags


@pytest.fixture
def capture(pristine):
    """One of the captures, read."""
    folder = CaptureFolder(pristine)
    return folder.read(folder.object_ids[0])


def with_extra_part(capture, material):
    """A capture with a part that lies beside both panels."""
    mesh = trimesh.creation.box((1, 1, 1))
    mesh.apply_translation((0, 0, 45))
    lost = replace(capture.parts[0], name="lost", mesh=mesh, material=material)
    return replace(capture, parts=(*capture.parts, lost))


@pytest.mark.parametrize(
    ("material", "source", "flag"), [("pp", "prior", "hidden"), ("", "none", "no_density")]
)
def test_a_part_that_no_ray_meets_is_stored_and_flagged(capture, tmp_path, material, source, flag):
    hidden = with_extra_part(capture, material)
    write_folder([reconstruct(hidden)], tmp_path / "out", version="0.1.0", builder="tests")
    (obj,) = open_folder(tmp_path / "out").objects()
    (lost,) = [part for part in obj.parts if part.name == "lost"]
    assert lost.density_source == source
    assert {"hidden", flag} <= set(lost.flags)
    assert np.isnan(lost.lac_per_cm)
    assert (obj.density is None) == (source == "none")
    assert audit_object(obj, hidden).good


def scaled(capture, factor):
    parts = []
    for part in capture.parts:
        mesh = part.mesh.copy()
        mesh.apply_scale(factor)
        parts.append(replace(part, mesh=mesh))
    return replace(capture, parts=tuple(parts))


@pytest.mark.parametrize(("factor", "words"), [(0.1, "10 times"), (1 / 2.54, "2.54 times")])
def test_meshes_in_other_units_than_the_shadow_are_an_error(capture, factor, words):
    with pytest.raises(DataError, match=rf"{words} .* check mesh_units in objects.csv"):
        reconstruct(scaled(capture, factor))


def test_an_image_of_something_else_is_flagged(pristine):
    folder = CaptureFolder(pristine)
    first, second = (folder.read(object_id) for object_id in folder.object_ids[:2])
    swapped = replace(first, views=(first.views[0], second.views[1]))
    assert "lat:does_not_fit" in reconstruct(swapped).flags
    assert not any("does_not_fit" in flag for flag in reconstruct(first).flags)


@pytest.mark.parametrize(
    ("offset_cm", "message"),
    [((0, -150, 0), "behind the source"), ((0, 19, 0), "through the detector")],
)
def test_a_part_where_none_can_be_is_an_error(capture, offset_cm, message):
    moved = scaled(capture, 1.0)
    moved.parts[0].mesh.apply_translation(offset_cm)
    name = moved.parts[0].name
    with pytest.raises(DataError, match=f"part {name} reaches {message} of view pa"):
        reconstruct(moved)


def test_an_audit_lists_what_it_cannot_audit_and_goes_on(built, captures):
    gone = CaptureFolder(captures).object_ids[0]
    (captures / gone / "pa.tif").unlink()
    words = ["audit", str(built), "--captures", str(captures), "--workers", "1", "--json"]
    ran = CliRunner().invoke(cli, words)
    assert ran.exit_code == 3
    report = json.loads(ran.stdout)
    assert [failure["object_id"] for failure in report["failures"]] == [gone]
    assert len(report["objects"]) == 2


def test_an_audit_view_without_background_has_gain_one(capture):
    view = capture.views[0]
    lengths = path_lengths([trimesh.creation.box((60, 10, 60))], [0], view.geometry)
    full = replace(view, transmission=lengths.image(np.array([0.02])), valid=view.valid | True)
    audit = audit_view(full, lengths, np.array([0.02]), gain=None, floor=1e-4)
    assert audit.gain == 1.0
    assert audit.transmission_mae < 1e-6


def test_a_slab_that_hardly_varies_is_not_called_misplaced(capture):
    view = capture.views[0]
    lengths = path_lengths([trimesh.creation.box((8, 1, 8))], [0], view.geometry)
    lac = np.array([0.01])
    noise = np.random.default_rng(0).normal(0, 0.005, view.transmission.shape)
    image = (lengths.image(lac) + noise).astype(np.float32)
    flat = replace(view, transmission=image, valid=np.ones_like(view.valid))
    audit = audit_view(flat, lengths, lac, gain=1.0, floor=1e-4)
    assert audit.transmission_corr < 0.9
    assert audit.verdict == "good"
