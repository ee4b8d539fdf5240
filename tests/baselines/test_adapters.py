"""Each adapter gives back the density a made-up run was made of; frames, scales, units matter."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.baselines.foreign_runs import (
    ANGLE,
    BOX,
    Pixie,
    cloud,
    density_kg_m3,
    drawn_similarity,
    edit_npz,
    ranges,
    write_json,
    write_nerf2physics,
    write_ply,
    write_points,
    write_pugs,
    write_transforms,
    write_vomp,
)
from tests.baselines.painted import BROWN, GREY, camera_at, painted
from tests.phantoms import exact_mass_g
from xden1k.access.samples import SampleView
from xden1k.errors import DataError
from xden1k.folder import DatasetFolder, open_folder, write_folder
from xden1k.predictions import open_predictions
from xden1k.values.modality import Modality
from xden_baselines.adapters.__main__ import cli
from xden_baselines.adapters.case import parse_answers
from xden_baselines.adapters.cloud import Cloud
from xden_baselines.adapters.filling import box_iou, fill
from xden_baselines.adapters.frames import Frames, Similarity
from xden_baselines.gaussian_property.regions import part_numbers
from xden_baselines.views.rendering import render
from xden_baselines.views.scenes import write_scene

NAME = "angle-0001"
SPACE = ("--unit", "kg/m3", "--frame", "cm")
GENERIC = ("--method", "any", "--inputs", "rgb", *SPACE)


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("adapters") / "dataset"
    angle = painted(NAME, ANGLE, {"stem": BROWN, "foot": GREY})
    write_folder([angle], found, version="0.1.0", builder="tests")
    return found


@pytest.fixture(scope="module")
def folder(root: Path) -> DatasetFolder:
    return open_folder(root)


@pytest.fixture(scope="module")
def sample(folder: DatasetFolder) -> SampleView:
    return SampleView(folder, NAME, Modality.GEOMETRY)


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Relative: the command line goes into the row, which has an end."""
    monkeypatch.chdir(tmp_path)
    return Path("runs")


def invoke(adapter: str, runs: Path, root: Path, *options: object) -> Result:
    words = [adapter, runs, "--root", root, "--out", runs.parent / "preds.npz", *options]
    return CliRunner().invoke(cli, [str(word) for word in words])


def adapted(adapter: str, runs: Path, root: Path, *options: object) -> dict[str, Any]:
    """The report of a run that must be adapted."""
    done = invoke(adapter, runs, root, *options, "--json")
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


def refused(adapter: str, runs: Path, root: Path, *options: object) -> str:
    """The one line with which a run must be refused; no submission is left."""
    done = invoke(adapter, runs, root, *options)
    assert done.exit_code == 1, done.output
    assert not (runs.parent / "preds.npz").exists()
    assert done.output.count("\n") == 1
    return done.output


def assert_round_trip(runs: Path, folder: DatasetFolder, *, wrong: float, mass: float) -> None:
    """Voxels off by over 1 % are fewer than a share ``wrong``; the mass is right to ``mass``."""
    truth = folder.object(NAME)
    with open_predictions(runs.parent / "preds.npz") as found:
        field = found.read(NAME)
    expected = truth.density.density_g_cm3
    off = np.abs(field - expected) > 0.01 * expected.max() * truth.envelope
    assert off[truth.envelope > 0].mean() < wrong
    assert not field[truth.envelope == 0].any()
    total = field.sum(dtype=np.float64) * truth.voxel_size_cm**3
    assert total == pytest.approx(exact_mass_g(ANGLE), rel=mass)


def test_nerf2physics_is_not_taken_out_of_its_reconstruction_twice(
    runs: Path, root: Path, folder: DatasetFolder
) -> None:
    write_nerf2physics(runs, NAME)
    found = adapted("nerf2physics", runs, root)
    assert_round_trip(runs, folder, wrong=0.02, mass=0.01)
    assert found["objects"][0]["mass_native_g"] == pytest.approx(20)


def test_pugs_comes_back_with_its_mass(runs: Path, root: Path, folder: DatasetFolder) -> None:
    write_pugs(runs, NAME)
    found = adapted("pugs", runs, root)
    assert_round_trip(runs, folder, wrong=0.02, mass=0.01)
    assert found["objects"][0]["mass_native_g"] == pytest.approx(20)


@pytest.mark.parametrize("place", ["given", "box"])
def test_pixie_comes_back_from_arrays(
    runs: Path, root: Path, folder: DatasetFolder, place: str
) -> None:
    run = Pixie(runs, NAME)
    run.write()
    options = ["--renders", run.renders, "--ranges", run.ranges]
    if place == "given":
        options += ["--transforms", write_transforms(runs / "t.json", NAME, run.to_object)]
    adapted("pixie", run.runs, root, *options)
    assert_round_trip(run.runs, folder, wrong=0.06, mass=0.03)


def test_pixie_nodes_of_ply_files_are_put_back(runs: Path, root: Path) -> None:
    fields = []
    for file in ("sample_0_pred.npy", "mapped_preds.ply", "world_mapped_preds.ply"):
        run = Pixie(runs / file, NAME)
        if file == "sample_0_pred.npy":
            run.write()
        elif file == "mapped_preds.ply":
            run.write_ply()
        else:
            rotation = drawn_similarity(4)
            rotation = Similarity.made(1.0, rotation.matrix[:3, :3] / rotation.scale)
            to_scene = Similarity.made(2.0, rotation.matrix[:3, :3], np.array([1.0, 2.0, 3.0]))
            transform = to_scene.matrix[:3] / to_scene.scale
            parser = {"transform": transform.tolist(), "scale": 2.0}
            write_json(run.renders / NAME / "dataparser_transforms.json", parser)
            run.write_ply(file, to_scene.inverse)
        place = write_transforms(runs / "t.json", NAME, run.to_object)
        options = ("--renders", run.renders, "--ranges", run.ranges, "--transforms", place)
        adapted("pixie", run.runs, root, *options)
        with open_predictions(run.runs.parent / "preds.npz") as found:
            fields.append(found.read(NAME))
    for field in fields[1:]:
        assert (np.abs(field - fields[0]) > 1e-3).mean() < 1e-3


def test_pixie_background_in_the_mask_follows_its_neighbours(
    runs: Path, root: Path, folder: DatasetFolder
) -> None:
    run = Pixie(runs, NAME)
    scattered = np.random.default_rng(5).random(run.mask.shape) < 0.2
    run.write(background=run.mask & scattered)
    found = adapted("pixie", run.runs, root, "--renders", run.renders, "--ranges", run.ranges)
    assert_round_trip(run.runs, folder, wrong=0.08, mass=0.03)
    assert found["objects"][0]["unread"] == (run.mask & scattered).sum()


@pytest.mark.parametrize("options", [(), ("--original-scale", "--frame", "m")])
def test_vomp_comes_back_from_its_box_or_from_the_meshs_scale(
    runs: Path, root: Path, folder: DatasetFolder, options: tuple[str, ...]
) -> None:
    write_vomp(runs, NAME)
    if options:
        with np.load(runs / f"{NAME}.npz") as found:
            voxels = found["voxel_data"]
        for axis, centre in zip("xyz", BOX.mean(axis=0), strict=True):
            voxels[axis] = (voxels[axis] * 4 + centre) / 100
        np.savez(runs / f"{NAME}.npz", voxel_data=voxels)
    adapted("vomp", runs, root, *options)
    assert_round_trip(runs, folder, wrong=0.06, mass=0.03)


@pytest.mark.parametrize("segment", ["query_point_material", "interpolated_material"])
def test_vomp_comes_back_from_points_it_was_asked_for(
    runs: Path, root: Path, folder: DatasetFolder, segment: str
) -> None:
    write_vomp(runs, NAME, segment=segment)
    moved = runs / f"{NAME}.npz"
    edit_npz(moved, lambda found: found["voxel_data"]["x"].__iadd__(0.003))  # off the lattice
    adapted("vomp", runs, root)
    assert_round_trip(runs, folder, wrong=0.08, mass=0.03)


@pytest.mark.parametrize("far", [1.001, 1.04, 1.5, 40.0])
def test_floaters_do_not_end_a_run_and_are_counted(
    runs: Path, root: Path, folder: DatasetFolder, far: float
) -> None:
    write_pugs(runs, NAME)
    path = runs / "scenes" / NAME / "pred_result_density"
    points, density = (np.load(path / f"dense_{one}.npy") for one in ("points", "pred_density"))
    corners = np.array([(x, y, z) for x in (1 - far, far) for y in (1 - far, far) for z in (far,)])
    floating = corners * BOX[1] / 100
    np.save(path / "dense_points.npy", np.concatenate([points, floating]).astype(np.float32))
    np.save(path / "dense_pred_density.npy", np.concatenate([density, density[:4]]))
    found = adapted("pugs", runs, root)
    assert_round_trip(runs, folder, wrong=0.02, mass=0.01)
    assert found["objects"][0]["floaters"] == (0 if far == 1.001 else 4)
    adapted("pugs", runs, root, "--frame", "box")
    assert_round_trip(runs, folder, wrong=0.12 if far == 1.04 else 0.03, mass=0.05)


def test_a_floater_of_no_matter_does_not_end_a_run(sample: SampleView) -> None:
    points, density = cloud()
    for odd in (0.0, 1e9):
        floating = Cloud(np.vstack([points, [[50.0] * 3]]), np.append(density, odd), "kg/m3")
        assert fill(floating, Similarity.made(1.0), sample).floaters == 1
        touching = Cloud(np.vstack([points, [[1.0] * 3]]), np.append(density, odd), "kg/m3")
        with pytest.raises(DataError, match=f"{NAME}: densities must be within"):
            fill(touching, Similarity.made(1.0), sample)


def test_a_run_of_many_floaters_is_adapted_where_their_share_is_told(
    runs: Path, root: Path, folder: DatasetFolder
) -> None:
    write_pugs(runs, NAME)
    path = runs / "scenes" / NAME / "pred_result_density"
    points, density = (np.load(path / f"dense_{one}.npy") for one in ("points", "pred_density"))
    count = len(points) // 100
    floating = np.random.default_rng(0).uniform(-1, 2, (count, 3)) * BOX[1] / 100
    np.save(path / "dense_points.npy", np.concatenate([points, floating]).astype(np.float32))
    np.save(path / "dense_pred_density.npy", np.concatenate([density, density[:count]]))
    assert "or more points float than --floaters says" in refused("pugs", runs, root)
    found = adapted("pugs", runs, root, "--floaters", "0.01")
    assert_round_trip(runs, folder, wrong=0.03, mass=0.02)
    assert 0.8 * count < found["objects"][0]["floaters"] <= count


def test_every_object_that_cannot_be_adapted_is_named_at_once(runs: Path, tmp_path: Path) -> None:
    names = ("angle-0001", "angle-0002", "angle-0003")
    colors = {"stem": BROWN, "foot": GREY}
    there = tmp_path / "three"
    write_folder(
        [painted(name, ANGLE, colors) for name in names], there, version="0.1.0", builder="t"
    )
    write_points(runs, names[0])
    write_points(runs, names[1], density=np.zeros(7))
    done = invoke("generic_points", runs, there, *GENERIC)
    assert done.exit_code == 1
    assert "2 of 3 objects cannot be adapted:\n" in done.output
    assert [done.output.count(name) for name in names] == [0, 1, 1]
    assert not (runs.parent / "preds.npz").exists()


def test_generic_points_take_one_density_or_a_range(
    runs: Path, root: Path, folder: DatasetFolder
) -> None:
    _, density = cloud()
    for values in (density, ranges(density)):
        write_points(runs, NAME, density=values)
        found = adapted("generic_points", runs, root, *GENERIC)
        assert_round_trip(runs, folder, wrong=0.02, mass=0.01)
        assert found["objects"][0]["coverage"] > 0.99
        assert found["objects"][0]["iou"] == 1


def test_labels_take_the_density_of_the_table_or_the_library(
    runs: Path, root: Path, folder: DatasetFolder
) -> None:
    points, density = cloud()
    material = np.where(density > 2000, "Aluminium", "resin")
    (runs / NAME).mkdir(parents=True)
    np.savez(runs / NAME / "labels.npz", points=points, material=material)
    missing = refused("gaussianproperty", runs, root, *SPACE)
    assert "no density is known for the materials ['resin']" in missing
    table = write_json(runs / "table.json", {"Resin": [1100, 1300]})
    adapted("gaussianproperty", runs, root, *SPACE, "--densities", table)
    assert_round_trip(runs, folder, wrong=0.02, mass=0.01)


def test_gaussians_with_a_density_are_read(runs: Path, root: Path, folder: DatasetFolder) -> None:
    points, density = cloud()
    write_ply(runs / NAME / "point_cloud.ply", points, opacity=density * 0, density=density)
    adapted("gaussianproperty", runs, root, *SPACE)
    assert_round_trip(runs, folder, wrong=0.02, mass=0.01)


def test_a_case_is_lifted_by_the_vote_of_its_views(
    runs: Path, root: Path, folder: DatasetFolder
) -> None:
    parts = folder.object(NAME).parts
    centre = BOX.mean(axis=0)
    signs = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)])
    around = [9.0 * at + (0.1, 0.2, 0) for at in signs if abs(at).sum() in (1, 3)]
    cameras = [camera_at(centre + at, centre) for at in around]
    meshes = [part.mesh for part in parts]
    case = runs / NAME
    write_scene(render(meshes, [part.color_rgb for part in parts], cameras).pictures, case)
    lines = []
    (case / "seg").mkdir()
    for view, numbers in enumerate(part_numbers(meshes, cameras)):
        np.save(case / "seg" / f"{view:03d}_s.npy", numbers.astype(np.int32))
        stem = "resin" if view else "pvc"  # one view errs
        lines.append(f"gpt_input/{view:02d}/01.png,a stem, upright,{stem},40-60,Shore D")
        lines.append(f"gpt_input/{view:02d}/02.png,a foot,aluminium,80-90,Shore D")
    lines.append("gpt_input/05/03.png,error,-1")
    (case / f"{NAME}.txt").write_text("\n".join(lines))
    table = write_json(runs / "table.json", {"resin": [1200, 1200]})
    options = ("--unit", "kg/m3", "--frame", "m", "--densities", table)
    found = adapted("gaussianproperty", runs, root, *options)
    assert_round_trip(runs, folder, wrong=0.1, mass=0.05)
    assert found["objects"][0]["unread"] == 1
    assert "1 answers or voxels without density" in found["meta"]["notes"]


def test_points_that_no_view_shows_do_not_vote_for_the_largest_mask(
    runs: Path, root: Path, folder: DatasetFolder
) -> None:
    """Label 0 is the largest mask, and every point behind has it for none."""
    parts = folder.object(NAME).parts
    centre = BOX.mean(axis=0)
    around = [np.array(at) * 9.0 for at in ((1, 0.1, 0), (-1, 0.1, 0), (0.1, 0, 1))]
    cameras = [camera_at(centre + at, centre) for at in around]
    meshes = [part.mesh for part in parts]
    case = runs / NAME
    write_scene(render(meshes, [part.color_rgb for part in parts], cameras).pictures, case)
    (case / "seg").mkdir()
    lines = []
    for view, numbers in enumerate(part_numbers(meshes, cameras)):
        # as in sam_preprocess.py: the largest mask is 0, the next 1, and the background -1
        labels = np.select([numbers == 1, numbers == 2], [0, 1], default=-1)
        np.save(case / "seg" / f"{view:03d}_s.npy", labels.astype(np.int32))
        lines += [
            f"gpt_input/{view:02d}/00.png,a stem,resin,40-60,Shore D",
            f"gpt_input/{view:02d}/01.png,a foot,aluminium,80-90,Shore D",
        ]
    (case / f"{NAME}.txt").write_text("\n".join(lines))
    table = write_json(runs / "table.json", {"resin": [1200, 1200]})
    options = ("--unit", "kg/m3", "--frame", "m", "--densities", table)
    adapted("gaussianproperty", runs, root, *options)
    assert_round_trip(runs, folder, wrong=0.1, mass=0.05)


@pytest.mark.parametrize(
    "answer",
    [
        "a metal head, metal, 70-90, Shore D",
        "(a metal head, metal, 70-90, Shore D)",
        "a metal head, **Metal**, 70-90, <Shore D>",
        "<think>wood, perhaps, 3</think>\na head, with a claw, metal, 70-90, Shore D",
        # what vlm_predict.py writes of GPT4V(): str(response.choices[0])
        "Choice(finish_reason='stop', index=0, logprobs=None, message=ChatCompletionMessage("
        "content='a metal head, metal, 70-90, Shore D', refusal=None, role='assistant', "
        "annotations=[], audio=None, function_call=None, tool_calls=None))",
        "Choice(finish_reason='stop', index=0, message=ChatCompletionMessage("
        'content="the hammer\'s head,\\nmetal, 70-90, Shore D", refusal=None, audio=None))',
    ],
)
def test_every_form_of_an_answer_is_read(answer: str) -> None:
    text = f"gp_cases_dirs/hammer/gpt_input/01/00.png,{answer}\na/01/01.png,error,-1\n"
    assert parse_answers(text) == ({(1, 0): "metal"}, 1)


@pytest.mark.parametrize(
    "answer",
    [
        r"Choice(message=ChatCompletionMessage(content='a \xgg lid,Wood,40-60,Shore D'))",
        "Choice(message=ChatCompletionMessage(content=None, refusal='I cannot see it'))",
        "a1," * 20_000,
    ],
)
def test_answers_that_are_none_are_counted_and_quickly(answer: str) -> None:
    assert parse_answers(f"01/00.png,{answer}") == ({}, 1)


def test_captions_with_commas_and_recorded_errors_are_told_apart() -> None:
    text = "\n".join(
        [
            "out/gpt_input/01/02.png,a long, red, lid,plastic,40-60,Shore D",
            "out/gpt_input/01/03.png,error,-1",
            "",
            "out/gpt_input/01/04.png,plastic,40-60,Shore D",
            "out/picture.png,a lid,plastic,40-60,Shore D",
            "<Response [200]>",
        ]
    )
    assert parse_answers(text) == ({(1, 2): "plastic"}, 3)


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_runs_frame_does_not_matter(sample: SampleView, seed: int) -> None:
    points, density = cloud(5_000)
    to_object = drawn_similarity(seed)
    here = fill(Cloud(points, density, "kg/m3"), Similarity.made(1.0), sample)
    there = fill(Cloud(to_object.inverse(points), density, "kg/m3"), to_object, sample)
    assert (np.abs(here.density_g_cm3 - there.density_g_cm3) > 1e-6).mean() < 1e-4
    assert there.coverage == pytest.approx(here.coverage, abs=1e-4)


@pytest.mark.parametrize(
    ("to_object", "message"),
    [
        (Similarity.made(2.0), "IoU"),
        (Similarity.made(0.01), "IoU"),
        (Similarity.made(1.0, None, np.array([0.5, 0.5, 0])), "IoU"),
        (Similarity.made(1.0, np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])), "IoU"),
        (
            Similarity.made(1.0, np.diag([-1.0, 1, -1]), np.array([3.0, 0, 4])),
            "of the points lie at the object, expected at least 80%: the frame is turned",
        ),
    ],
)
def test_a_wrong_frame_or_scale_is_caught(
    sample: SampleView, to_object: Similarity, message: str
) -> None:
    points, density = cloud(5_000)
    with pytest.raises(DataError, match=f"^{NAME}: .*{message}"):
        fill(Cloud(points, density, "kg/m3"), to_object, sample)


def test_a_place_is_a_matrix_or_its_parts(runs: Path, sample: SampleView) -> None:
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    whole = Similarity.made(2.0, turn, np.array([1.0, 2, 3]))
    parts = {"scale": 2.0, "rotation": turn.tolist(), "translation_cm": [1, 2, 3]}
    anywhere = Cloud(BOX, np.ones(2), "g/cm3")
    np.testing.assert_allclose(whole(np.eye(3)), [[1, 4, 3], [-1, 2, 3], [1, 2, 5]])
    for entry in ({"similarity": whole.matrix.tolist(), "run": "theirs"}, parts):
        frames = Frames.read("m", write_json(runs / "t.json", {NAME: entry}))
        np.testing.assert_allclose(frames.similarity(anywhere, sample).matrix, whole.matrix)


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({}, f"{NAME}: nothing says where the run has it"),
        ({"scale": 2.0}, r"t.json: .* expected similarity, or scale, rotation and translation_cm"),
        ({"similarity": [[1, 0], [0, 1]]}, r"similarity: shape must be \(4, 4\), got \(2, 2\)"),
    ],
)
def test_a_place_that_is_missing_or_half_given_is_named(
    runs: Path, sample: SampleView, entry: dict[str, Any], message: str
) -> None:
    frames = Frames.read(None, write_json(runs / "t.json", {NAME: entry}))
    with pytest.raises(DataError, match=message):
        frames.similarity(Cloud(BOX, np.ones(2), "g/cm3"), sample)


def test_points_that_are_one_have_no_box(sample: SampleView) -> None:
    one = Cloud(np.zeros((3, 3)), np.ones(3), "g/cm3")
    with pytest.raises(DataError, match=f"{NAME}: all points are one, so there is no box"):
        Frames.read("box", None).similarity(one, sample)


def test_a_row_that_cannot_be_written_is_refused_before_the_work(runs: Path, root: Path) -> None:
    runs.mkdir()
    options = [*GENERIC, "--method", "m" * 81]
    assert "method must be one printable line" in refused("generic_points", runs, root, *options)


@pytest.mark.parametrize(
    ("factor", "unit", "message"),
    [
        (0.001, "kg/m3", "largest density is 2.7 kg/m3: these look like g/cm3"),
        (1.0, "g/cm3", "median density is .* these look like kg/m3"),
        (10.0, "kg/m3", r"within 0.001 and 25 g/cm3, \d+ of \d+ are not, first at \d+: 27$"),
        (-1.0, "kg/m3", "look like g/cm3"),
    ],
)
def test_densities_in_the_other_unit_or_of_no_matter_are_caught(
    sample: SampleView, factor: float, unit: Any, message: str
) -> None:
    points, density = cloud(5_000)
    with pytest.raises(DataError, match=message):
        fill(Cloud(points, factor * density, unit), Similarity.made(1.0), sample)


def test_points_on_one_side_only_show_in_the_coverage(sample: SampleView) -> None:
    points, density = cloud(5_000)
    few = (points[:, 1] < 0.2) | (np.arange(len(points)) < 3)
    found = fill(Cloud(points[few], density[few], "kg/m3"), Similarity.made(1.0), sample)
    assert 0.1 < found.coverage < 0.4


def test_a_box_within_a_larger_one_overlaps_by_its_share() -> None:
    whole = np.array([[0.0, 0, 0], [2, 2, 2]])
    assert box_iou(whole, whole / 2) == pytest.approx(1 / 8)
    assert box_iou(whole, whole + 3) == 0


def test_the_row_says_what_was_adapted(runs: Path, root: Path) -> None:
    write_points(runs, "their-name")
    place = write_transforms(runs / "t.json", NAME, Similarity.made(1.0), run="their-name")
    options = (*GENERIC, "--inputs", "text", "--seconds", 7.5, "--transforms", place)
    first, second = (adapted("generic_points", runs, root, *options) for _ in range(2))
    meta = first["meta"]
    assert meta["inputs"] == ["mesh", "rgb", "text"]
    assert meta["external_data"] is True
    assert meta["seconds_per_object"] == 7.5
    assert meta["command"].startswith("python -m xden_baselines.adapters generic_points ")
    assert f"run {first['run_sha256'][:12]}; coverage 0.999 " in meta["notes"]
    assert meta == second["meta"]


def test_masses_of_the_runs_own_are_printed(runs: Path, root: Path) -> None:
    write_pugs(runs, NAME)
    said = invoke("pugs", runs, root).output
    assert "mass by its own rule, never scored: median 20 g, 1 of 1 objects" in said


def test_the_made_up_object_is_the_datasets(folder: DatasetFolder) -> None:
    points, density = cloud()
    assert density_kg_m3(points).min() == 1200
    np.testing.assert_allclose(folder.object(NAME).mass_g, 8 * 1.2 + 4 * 2.7, rtol=1e-6)
    assert density.max() == 2700
