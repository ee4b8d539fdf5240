"""xden-bench segment: the truth, rows to read others by, entries, and bad input, as a user sees."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result
from PIL import Image
from trimesh import Trimesh

from tests.phantoms import BAR, Box, box_object
from xden1k.errors import DataError
from xden1k.folder import open_folder, write_folder
from xden1k.segmentation import CLUSTER_COUNTS, SegmentsMeta, SegmentsWriter
from xden_bench.cli import cli
from xden_bench.entries.leaderboard import render
from xden_bench.entries.reading import read_entries
from xden_bench.methods.baseline import Options, find_method, run_predictor
from xden_bench.pictures.cuts import OUTSIDE, widest_cut
from xden_bench.scoring.protocol import load_segment_protocol
from xden_bench.scoring.regions import SegmentReference

Run = Callable[..., Result]
RULES = load_segment_protocol()
BOTTLE = (Box("bottle", (-4, -1, -1), (4, 1, 1), 1.5, hole=((-3, -0.5, -0.5), (3, 0.5, 0.5))),)
SHEET = (Box("sheet", (0, 0, 0), (0.5, 2, 6)),)
"""One material."""


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> SegmentReference:
    root = tmp_path_factory.mktemp("segments") / "dataset"
    objects = [
        box_object("bottle-0001", BOTTLE, split="test", category="bottle"),
        box_object("sheet-0001", SHEET, split="test", category="sheet"),
    ]
    write_folder(objects, root, version="0.1.0", builder="tests")
    return SegmentReference(open_folder(root), "test", RULES)


@pytest.fixture(scope="module")
def truth(reference: SegmentReference) -> Path:
    """The true regions of every object, under other names."""
    path = reference.folder.path.parent / "truth.npz"
    with SegmentsWriter(path) as writer:
        for object_id in reference.ids:
            drawn = reference.drawn(object_id)
            regions = 7 * drawn.regions(RULES.region_gap_g_cm3).parts
            labels = np.broadcast_to(regions, (len(CLUSTER_COUNTS), len(regions)))
            writer.add(object_id, drawn.points.voxels, labels, regions)
        writer.finish(meta_of(reference, writer.points_sha256))
    return path


def meta_of(reference: SegmentReference, points_sha256: str) -> SegmentsMeta:
    return SegmentsMeta(
        method="test",
        dataset_revision="0.1.0",
        manifest_sha256=reference.manifest_sha256,
        config="default",
        split="test",
        inputs=("mesh",),
        training_data=(),
        external_data=False,
        points_seed=RULES.points_seed,
        points_sha256=points_sha256,
    )


@pytest.fixture
def run(reference: SegmentReference, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDEN1K_ROOT", str(reference.folder.root))
    return lambda *words: CliRunner().invoke(cli, list(map(str, words)))


def values(done: Result) -> dict[str, Any]:
    assert done.exit_code == 0, done.stderr
    return dict(json.loads(done.stdout))


def test_the_truth_scores_100_and_objects_of_one_region_are_counted(run: Run, truth: Path) -> None:
    found = values(run("segment", "score", truth, "--json"))
    assert {name: one["mean"] for name, one in found["metrics"].items()} == pytest.approx(
        dict.fromkeys(RULES.metrics, 100.0)
    )
    assert found["n_objects"] == 2
    assert found["left_out"] == {"iou_a": 1, "iou_b_material": 1, "iou_b_part": 1}
    assert "iou_a" not in found["by_category"]["sheet"]["metrics"]


def test_an_entry_gets_a_table_of_its_own_and_copies_no_other(run: Run, truth: Path) -> None:
    done = values(run("segment", "submit", truth, "--out", "results", "--json"))
    assert done["standing"].startswith("rank 1 of 1"), done["standing"]
    again = run("segment", "submit", truth, "--out", "results")
    assert again.exit_code == 1
    assert "entered already" in again.stderr
    assert values(run("verify", done["file"], "--json"))["same"]
    entries = read_entries(Path("results"))
    page = render(entries)
    assert "Target `segments`, split `test`, 2 objects" in page
    assert "IoU A, %: without 1 objects of one region." in page
    assert "## Segments, track `geometry`, split `test`: outer surface alone" in page
    assert re.search(r"^\| 1 +\| test +\| 100.0 +\| 100.0 +\|", page, re.MULTILINE)


def test_rows_to_read_others_by_stand_in_the_table_of_every_track(run: Run, truth: Path) -> None:
    values(run("segment", "submit", truth, "--out", "results", "--json"))
    (own,) = read_entries(Path("results"))
    method = {**own["method"], "name": "xray-clusters", "inputs": ["mesh", "xray"]}
    guest = {**own, "method": method, "track": "xray", "submission_sha256": "0" * 64}
    geometry, xray, _ = render([own, guest]).split("\n## ", 2)
    assert re.search(r"^\| 1 +\| test ", geometry, re.MULTILINE)
    assert re.search(r"^\| +\| \*xray-clusters\* ", geometry, re.MULTILINE)
    assert "- **xray-clusters**: entered for the track `xray`" in geometry
    assert "| test " not in xray
    other_split = {**guest, "dataset": {**own["dataset"], "split": "unseen"}}
    assert "xray-clusters" not in render([own, other_split]).split("\n## ")[0]


def changed(path: Path, out: str, **arrays: Any) -> str:
    """A copy of a submission with other arrays, or other words in its meta data."""
    with np.load(path) as found:
        kept = dict(found)
    meta = json.loads(str(kept["__meta__"])) | arrays.pop("meta", {})
    kept |= {"__meta__": np.array(json.dumps(meta))} | arrays
    np.savez_compressed(out, **{name: one for name, one in kept.items() if one is not None})
    return out


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"meta": {"points_seed": 3}}, "E205: points_seed must be 20251210 here, got 3"),
        ({"meta": {"points_sha256": "0" * 64}}, "E205: points_sha256 must be '"),
        (
            {"labels/bottle-0001": None, "free/bottle-0001": None},
            "E301: objects missing of the 2 in the split test: 1: 'bottle-0001'",
        ),
        (
            {"labels/x": np.zeros((18, 9), np.uint8), "free/x": np.zeros(9, np.uint8)},
            "E302: objects that are none of the 2 in the split test: 1: 'x'",
        ),
        (
            {"labels/bottle-0001": np.zeros((18, 8191), np.uint8)},
            "E402 bottle-0001: labels: shape must be (18, 8192), a row for each k from 2 to 19",
        ),
    ],
)
def test_what_is_wrong_is_one_line_and_nothing_is_written(
    change: dict[str, Any], expected: str, run: Run, truth: Path
) -> None:
    done = run("segment", "submit", changed(truth, "bad.npz", **change), "--out", "results")
    assert done.exit_code == 1
    assert done.stderr.startswith(f"Error: bad.npz: {expected}")
    assert done.stderr.count("\n") == 1
    assert not Path("results").exists()


def test_a_split_whose_labels_are_public_cannot_be_sealed(
    reference: SegmentReference, run: Run, truth: Path
) -> None:
    done = run("segment", "score", truth, "--split", "private")
    assert done.exit_code == 1
    assert "segments of the split private cannot be scored: its part meshes" in done.stderr
    asked = run("baseline", "one-region", "--task", "segments", "--split", "private")
    assert asked.exit_code == 1
    assert "segments of the split private cannot be scored: its part meshes" in asked.stderr
    assert not list(Path().iterdir())


def test_parts_of_unknown_density_are_refused_by_name(tmp_path: Path, truth: Path) -> None:
    objects = [box_object("bar-0001", BAR, split="test", category="bar", density_known=False)]
    write_folder(objects, tmp_path / "data", version="0.1.0", builder="tests")
    drawn = SegmentReference(open_folder(tmp_path / "data"), "test", RULES).drawn("bar-0001")
    with pytest.raises(ValueError, match="data: bar-0001: the part plastic must have a density"):
        drawn.regions(RULES.region_gap_g_cm3)


def test_of_several_files_the_bad_one_is_named(run: Run, truth: Path) -> None:
    bad = changed(truth, "bad.npz", meta={"points_seed": 3})
    for words in (("compare", truth, bad), ("kinds", truth, bad), ("show", "sheet-0001", bad)):
        done = run("segment", *words)
        assert done.exit_code == 1
        assert done.stderr.startswith("Error: bad.npz: E205: points_seed must be"), words


def test_an_open_part_is_told_with_its_object_and_dataset(tmp_path: Path) -> None:
    made = box_object("bar-0001", BAR, split="test", category="bar")
    part = made.parts[0]
    torn = Trimesh(part.mesh.vertices, part.mesh.faces[1:], process=False)
    made = replace(made, parts=(replace(part, mesh=torn), *made.parts[1:]))
    write_folder([made], tmp_path / "data", version="0.1.0", builder="tests")
    folder = open_folder(tmp_path / "data")
    expected = f"{folder.root}: bar-0001: part 0 is not a closed mesh"
    with pytest.raises(DataError, match=re.escape(expected)):
        SegmentReference(folder, "test", RULES).drawn("bar-0001")
    options = Options(points_seed=RULES.points_seed)
    with pytest.raises(DataError, match=re.escape(expected)):
        run_predictor(find_method("one-region"), folder, "test", tmp_path / "a.npz", options)
    assert not (tmp_path / "a.npz").exists()


@pytest.mark.slow
def test_a_template_is_valid_once_it_has_a_name(run: Run, reference: SegmentReference) -> None:
    done = run("segment", "template", "--track", "xray")
    assert done.exit_code == 0, done.stderr
    assert "segments.npz: 2 objects of one region. Fill in:" in done.stdout
    assert run("segment", "validate", "segments.npz").stderr.startswith(
        "Error: segments.npz: E207: "
    )
    named = changed(Path("segments.npz"), "named.npz", meta={"method": "mine"})
    assert run("segment", "validate", named).stdout == "named.npz: valid\n"


@pytest.mark.slow
@pytest.mark.parametrize("name", RULES.unranked)
def test_each_row_to_read_others_by_runs_and_keeps_its_name(
    name: str, run: Run, truth: Path
) -> None:
    done = run("baseline", name, "--task", "segments", "--out", "row.npz", "--json")
    assert values(done)["meta"]["method"] == name
    entered = values(run("segment", "submit", "row.npz", "--out", "results", "--json"))
    assert entered["metrics"]["iou_a"]["mean"] <= 100
    assert entered["standing"].startswith("no rank in track "), entered["standing"]
    remade = values(run("verify", entered["file"], "--remake", "--json"))
    assert (remade["same"], remade["how"]) == (True, "remade")
    stolen = changed(truth, "stolen.npz", meta={"method": name.upper()})
    refused = run("segment", "submit", stolen, "--out", "results")
    assert f"the name '{name}' is that of a row to read others by" in refused.stderr


@pytest.mark.slow
def test_two_methods_are_compared_on_the_objects_that_both_have(run: Run, truth: Path) -> None:
    run("baseline", "one-region", "--task", "segments", "--out", "one.npz")
    found = values(run("segment", "compare", truth, "one.npz", "--json"))["metrics"]
    assert found["iou_a"]["a_better"] == 1
    assert found["iou_c"]["difference"]["mean"] > 0
    assert found["iou_b_part"]["largest"][0]["object_id"] == "bottle-0001"


def test_a_method_is_asked_only_for_what_it_gives(run: Run) -> None:
    one, other = run("baseline", "one-region"), run("baseline", "water", "--task", "segments")
    assert one.stderr == "Error: the method one-region gives segments, no densities\n"
    assert other.stderr == "Error: the method water gives densities, no segments\n"
    assert not list(Path().glob(".*.partial"))


def test_show_tells_and_draws_what_is_scored(run: Run, truth: Path) -> None:
    words = ("segment", "show", "bottle-0001,sheet-0001", truth, truth)
    found = json.loads(run(*words, "--picture", "both.png", "--json").stdout)
    assert [row["regions"] for row in found] == [2, 1]
    assert [row["answers"][0]["iou_a"] for row in found] == [pytest.approx(100), None]
    with Image.open("both.png") as image:
        both = np.asarray(image.convert("RGB"))
    assert run("segment", "show", "bottle-0001", truth, "--picture", "one.png").exit_code == 0
    with Image.open("one.png") as image:
        assert image.width < both.shape[1]
        assert image.height < both.shape[0]
    assert (both == 255).all(axis=2).mean() > 0.4, "on light ground"


def test_a_cut_shows_the_cavity_and_true_labels_of_points_fill_it_alike(
    reference: SegmentReference,
) -> None:
    drawn = reference.drawn("bottle-0001")
    cut = widest_cut(drawn, RULES.region_gap_g_cm3)
    void = int((cut.regions == 0).sum())
    whole = int((cut.regions != OUTSIDE).sum())
    assert cut.axis != 0, "not across the longest axis"
    assert void / whole == pytest.approx(6 * 1 / (8 * 2), abs=0.02)
    labels = drawn.regions(RULES.region_gap_g_cm3).materials
    spread = cut.nearest(drawn.points, labels)
    np.testing.assert_array_equal(spread == OUTSIDE, cut.regions == OUTSIDE)
    assert (spread == cut.regions)[cut.inside].mean() > 0.9


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("bottle-0009", "truth.npz"), "no object 'bottle-0009' in the split test"),
        (("bottle-0001", "other.npz"), "E205"),
        (("bottle-0001", "gone.npz"), "gone.npz"),
    ],
)
def test_show_refuses_in_a_line_and_draws_nothing(
    run: Run, truth: Path, words: tuple[str, str], expected: str
) -> None:
    Path("truth.npz").write_bytes(truth.read_bytes())
    changed(truth, "other.npz", meta={"points_seed": 1})
    done = run("segment", "show", *words, "--picture", "none.png")
    assert done.exit_code == 1
    assert expected in done.stderr
    assert not Path("none.png").exists()
