"""A dataset folder of the builder's as a submission."""

import hashlib
import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from tests.phantoms import BAR, box_object
from xden1k.errors import DataError, MissingObjectError
from xden1k.folder import open_folder, write_folder
from xden1k.predictor import SampleView
from xden1k.values.modality import Modality, track_of
from xden1k.values.types import DensityField
from xden_bench.cli import cli
from xden_bench.methods.baseline import run_predictor
from xden_bench.methods.rebuilt import Rebuilt
from xden_bench.scoring.protocol import load_protocol
from xden_bench.scoring.reference import Reference
from xden_bench.scoring.score import score

READS = Modality.GEOMETRY | Modality.PARTS | Modality.XRAY


def told(obj, labels):
    """Return an object that says whether its builder read the labels."""
    return replace(obj, meta={**obj.meta, "settings": {"labels": labels}})


def folder_of(obj, root):
    write_folder([obj], root, version="0.1.0", builder="tests")
    return open_folder(root)


def sample_of(folder, obj):
    return SampleView(folder, obj.object_id, READS)


def test_the_truth_rebuilt_scores_zero_in_the_xray_track(dataset, tmp_path):
    folder = open_folder(dataset)
    meta = run_predictor(Rebuilt(folder, "density"), folder, "test", tmp_path / "root.npz").meta
    scored = score(tmp_path / "root.npz", Reference(folder, "test"), load_protocol())
    assert track_of(READS) == meta.track == "xray"
    assert scored.metrics["density_mae_g_cm3"].mean == 0
    assert scored.metrics["mass_mape"].mean == 0
    assert scored.metrics["com_l1_cm"].mean == 0


@pytest.mark.parametrize(
    ("made", "name", "inputs"),
    [
        (lambda obj: told(obj, "withheld"), "builder", ("mesh", "parts", "xray")),
        (lambda obj: told(obj, "read"), "builder-labels", ("mesh", "parts", "xray", "materials")),
        (lambda obj: obj, "builder-labels", ("mesh", "parts", "xray", "materials")),
    ],
)
def test_only_what_says_that_it_was_built_blind_is_the_blind_builder(tmp_path, made, name, inputs):
    folder = folder_of(made(box_object("bar-0001", BAR, split="test")), tmp_path / "built")
    row = Rebuilt(folder, "density")
    assert (row.name, row.reads.inputs) == (name, inputs)


def test_one_object_built_with_labels_makes_the_row_one_with_labels(tmp_path):
    blind = told(box_object("bar-0001", BAR, split="test"), "withheld")
    labelled = told(box_object("bar-0002", BAR, split="test"), "read")
    write_folder([blind, labelled], tmp_path / "built", version="0.1.0", builder="tests")
    assert Rebuilt(open_folder(tmp_path / "built"), "density").name == "builder-labels"


def test_the_notes_say_from_what_it_was_made(dataset, tmp_path):
    folder = open_folder(dataset)
    meta = run_predictor(Rebuilt(folder, "density"), folder, "test", tmp_path / "root.npz").meta
    manifest = hashlib.sha256((dataset / "manifest.json").read_bytes()).hexdigest()[:12]
    assert meta.notes == f"reconstructed by tests, manifest {manifest}, settings unknown"


def test_the_notes_say_that_a_scan_against_itself_is_circular(tmp_path):
    folder = folder_of(box_object("bar-0001", BAR, split="test", source="scan"), tmp_path / "scan")
    meta = run_predictor(Rebuilt(folder, "density"), folder, "test", tmp_path / "root.npz").meta
    assert "circular: the truth of scans is the builder's own" in meta.notes


def moved(obj):
    return replace(obj, origin_cm=obj.origin_cm + np.array([0.0, 0.1, 0.0]))


def test_an_object_on_another_grid_is_told_part_by_part_whatever_their_order(tmp_path):
    obj = box_object("bar-0001", BAR, split="test")
    other = moved(replace(obj, parts=obj.parts[::-1]))
    truth, built = folder_of(obj, tmp_path / "truth"), folder_of(other, tmp_path / "built")
    values = Rebuilt(built, "density").predict(sample_of(truth, obj)).density_g_cm3
    np.testing.assert_allclose(values, [0.0, *(part.density_g_cm3 for part in obj.parts)])


def test_an_object_on_another_grid_with_other_parts_is_refused(tmp_path):
    obj = box_object("bar-0001", BAR, split="test")
    first, *rest = obj.parts
    other = moved(replace(obj, parts=(replace(first, name="else"), *rest)))
    truth, built = folder_of(obj, tmp_path / "truth"), folder_of(other, tmp_path / "built")
    with pytest.raises(DataError, match=r"lies on another grid and has other parts: .*'else'"):
        Rebuilt(built, "density").predict(sample_of(truth, obj))


def test_an_object_of_unknown_density_is_refused(tmp_path):
    obj = box_object("bar-0001", BAR, split="test")
    truth = folder_of(obj, tmp_path / "truth")
    unknown = folder_of(replace(obj, density=None), tmp_path / "built")
    with pytest.raises(DataError, match="has no density of it"):
        Rebuilt(unknown, "density").predict(sample_of(truth, obj))
    apparent = Rebuilt(unknown, "apparent_density").predict(sample_of(truth, obj)).density_g_cm3
    assert isinstance(obj.apparent_density, DensityField)
    np.testing.assert_allclose(apparent, obj.apparent_density.density_g_cm3, rtol=1e-3)


def test_an_object_that_was_not_rebuilt_is_named(tmp_path):
    obj = box_object("bar-0001", BAR, split="test")
    truth = folder_of(obj, tmp_path / "truth")
    built = folder_of(replace(obj, object_id="bar-0002"), tmp_path / "built")
    with pytest.raises(MissingObjectError, match="bar-0001"):
        Rebuilt(built, "density").predict(sample_of(truth, obj))


@pytest.mark.parametrize("words", [["root"], ["water", "--from", "built"]])
def test_the_name_root_and_the_option_from_go_together(dataset, words):
    ran = CliRunner().invoke(cli, ["baseline", *words, "--root", str(dataset)])
    assert ran.exit_code == 2
    assert "go together" in ran.stderr


def reported(folder, **changed):
    """Write what the builder says of its objects beside a folder, one of them changed."""
    objects = [
        {"object_id": one, "status": "built", "seconds": 3.0, "processor_s": 2.0}
        | {"peak_memory_gb": 0.5}
        for one in folder.ids()
    ]
    objects[0] |= {"seconds": 5.0, "processor_s": 4.0, "peak_memory_gb": 0.7} | changed
    report = {"shared_processor_s": 3.0 * len(objects), "objects": objects}
    path = folder.root.with_name(f"{folder.root.name}.work") / "build_report.json"
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps(report))
    return path


def two_bars(root):
    bars = [box_object(name, BAR, split="test") for name in ("bar-0001", "bar-0002")]
    write_folder(bars, root, version="0.1.0", builder="tests")
    return open_folder(root)


def cost_of(built, truth, out):
    meta = run_predictor(Rebuilt(built, "density"), truth, "test", out).meta
    return meta.seconds_per_object, meta.processor_seconds_per_object, meta.peak_memory_gb


def test_a_row_costs_what_the_builder_took_with_its_share_of_the_beam(tmp_path):
    built = two_bars(tmp_path / "built")
    reported(built)
    assert cost_of(built, built, tmp_path / "row.npz") == (4.0, 3.0 + 3.0, 0.7)


@pytest.mark.parametrize("changed", [{"status": "kept"}, {"status": "failed"}, {"object_id": "b"}])
def test_a_run_that_did_not_make_every_object_tells_no_cost(tmp_path, changed):
    built = two_bars(tmp_path / "built")
    reported(built, **changed)
    assert cost_of(built, built, tmp_path / "row.npz") == (None, None, None)


def test_a_folder_without_its_report_or_with_an_older_one_tells_no_cost(tmp_path):
    built = two_bars(tmp_path / "built")
    assert Rebuilt(built, "density").cost() is None
    path = reported(built)
    report = json.loads(path.read_text())
    path.write_text(json.dumps(report | {"shared_processor_s": None}))
    assert Rebuilt(built, "density").cost() is None
    del report["objects"][0]["processor_s"]
    path.write_text(json.dumps(report))
    assert Rebuilt(built, "density").cost() is None


@pytest.mark.parametrize(
    "text", ["{", "[]", '{"objects": 3}', '{"objects": [{"status": "built"}]}']
)
def test_a_damaged_report_is_named(tmp_path, text):
    built = two_bars(tmp_path / "built")
    path = reported(built)
    path.write_text(text)
    with pytest.raises(DataError, match=rf"{path}: not a report of xden-build"):
        Rebuilt(built, "density").cost()
