"""Phantoms on disk: capture folders that read back, truth as a dataset, always the same bytes."""

from __future__ import annotations

import hashlib
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from xden1k.errors import DataError
from xden1k.folder import open_folder
from xden1k.rays import disjoint_regions, ownership_order
from xden_builder.capture import CaptureFolder
from xden_builder.commands.phantoms import _unseen
from xden_builder.phantoms import (
    Phantom,
    Plan,
    Scanner,
    gallery,
    make_phantom,
    plan_objects,
    truth_object,
    write_captures,
    write_truth_dataset,
)
from xden_builder.phantoms.grid import TruthGrid
from xden_builder.phantoms.sheet import cut_open, shaded

SMALL = ["screwdriver", "hammer", "mug", "padlock"]


@pytest.fixture(scope="module", params=[5, pytest.param(19, marks=pytest.mark.slow)])
def plans(request: pytest.FixtureRequest) -> tuple[Plan, ...]:
    """Which objects there are."""
    return tuple(plan_objects(request.param, 1))


@pytest.fixture(scope="module")
def phantoms(plans: tuple[Plan, ...]) -> dict[str, Phantom]:
    """Them, by their ids."""
    return {plan.object_id: make_phantom(plan) for plan in plans}


@pytest.fixture(scope="module")
def captures(tmp_path_factory: pytest.TempPathFactory, plans: tuple[Plan, ...]) -> Path:
    out = tmp_path_factory.mktemp("phantoms") / "captures"
    write_captures(out, len(plans), 1, size=64)
    return out


@pytest.fixture(scope="module")
def truths(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The truth of the first objects as a dataset."""
    out = tmp_path_factory.mktemp("phantoms") / "truth"
    write_truth_dataset(out, 2, 1, size=64)
    return out


def digests(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def test_builder_reads_every_object_and_finds_nothing_to_say(
    captures: Path, plans: tuple[Plan, ...]
) -> None:
    folder = CaptureFolder(captures)
    assert list(folder.object_ids) == [plan.object_id for plan in plans]
    for plan in plans:
        capture = folder.read(plan.object_id)
        assert capture.flags == ()
        assert (capture.category, capture.split) == (plan.category.name, plan.split)
        assert capture.source == "phantom"
        assert capture.weighed_mass_g is None
        assert capture.tube is not None
        assert capture.tube.energy_kev == 100.0
        assert capture.noise_sd["pa"] == pytest.approx(5 / 50_000, rel=0.2)


def test_parts_read_back_as_they_were_and_nothing_is_left_to_cut(
    captures: Path, phantoms: dict[str, Phantom]
) -> None:
    folder = CaptureFolder(captures)
    for object_id, phantom in phantoms.items():
        parts = folder.read(object_id).parts
        for part, made in zip(parts, phantom.parts, strict=True):
            assert (part.name, part.material) == (made.name, made.material)
            assert part.priority is None
            assert float(part.mesh.volume) == pytest.approx(float(made.mesh.volume), rel=1e-6)
        meshes = [part.mesh for part in parts]
        regions = disjoint_regions(meshes, ownership_order(meshes))
        assert all(one is other for one, other in zip(regions, meshes, strict=True))


def test_views_read_back_as_the_scanner_corrects_them(
    captures: Path, phantoms: dict[str, Phantom]
) -> None:
    scanner = Scanner(size_px=64)
    for object_id in ("hammer-0000", "water_bottle-0000"):
        for view in CaptureFolder(captures).read(object_id).views:
            ours = scanner.corrected(phantoms[object_id], view.name)
            np.testing.assert_array_equal(view.valid, ours.valid)
            np.testing.assert_allclose(view.transmission, ours.transmission, rtol=1e-6)
            for key in ("source_cm", "pixel00_cm", "column_step_cm", "row_step_cm"):
                expected = getattr(ours.geometry, key)
                np.testing.assert_array_equal(getattr(view.geometry, key), expected)


def test_truth_says_what_the_object_is(captures: Path, phantoms: dict[str, Phantom]) -> None:
    truth = json.loads((captures / "water_bottle-0000" / "truth.json").read_text())
    phantom = phantoms["water_bottle-0000"]
    mass = phantom.mass_properties
    assert truth["mass_g"] == mass.mass_g
    assert truth["com_cm"] == mass.com_cm.tolist()
    np.testing.assert_array_equal(truth["inertia_g_cm2"], mass.inertia_g_cm2)
    assert truth["energy_kev"] == 100.0
    total = 0.0
    lac_per_cm = Scanner().lac_per_cm(phantom).tolist()
    for part, made, lac in zip(truth["parts"], phantom.parts, lac_per_cm, strict=True):
        assert part["material"] == made.material
        assert part["lac_per_cm"] == lac
        total += part["density_g_cm3"] * part["volume_cm3"]
    assert total == pytest.approx(truth["mass_g"])
    assert 0.85 < truth["gain"]["pa"] < 1.15


def test_settings_of_the_simulation_are_kept(captures: Path) -> None:
    kept = json.loads((captures / "simulation.json").read_text())
    assert kept["seed"] == 1
    assert Scanner(**kept["scanner"]) == Scanner(size_px=64)


@pytest.mark.usefixtures("in_this_process")
def test_objects_are_the_same_bytes_whatever_the_count(captures: Path, tmp_path: Path) -> None:
    same_bytes_in_a_smaller_set(captures, tmp_path, count=1)


@pytest.mark.slow
def test_objects_are_the_same_bytes_whatever_the_processes(captures: Path, tmp_path: Path) -> None:
    same_bytes_in_a_smaller_set(captures, tmp_path, count=2)


def same_bytes_in_a_smaller_set(captures: Path, tmp_path: Path, count: int) -> None:
    write_captures(tmp_path / "few", count, 1, size=64, workers=2)
    few, many = digests(tmp_path / "few"), digests(captures)
    few.pop("objects.csv")
    assert few
    assert few.items() <= many.items()


def test_another_seed_gives_other_objects(captures: Path, tmp_path: Path) -> None:
    write_captures(tmp_path / "other", 1, 2, size=64)
    other, these = digests(tmp_path / "other"), digests(captures)
    same = {name for name, digest in other.items() if these.get(name) == digest}
    assert same == {"scanner.toml"}


def test_ideal_captures_hold_exact_transmission(tmp_path: Path) -> None:
    write_captures(tmp_path / "ideal", 2, 0, size=48, ideal=True, categories=SMALL)
    folder = CaptureFolder(tmp_path / "ideal")
    for object_id in folder.object_ids:
        phantom = make_phantom(Plan.of(0, object_id))
        for view in folder.read(object_id).views:
            exact = Scanner(size_px=48).transmission(phantom, view.name)
            np.testing.assert_array_equal(view.transmission, exact)
    assert not list((tmp_path / "ideal").glob("*.tif"))


def test_progress_names_each_object_once(tmp_path: Path) -> None:
    seen: list[str] = []
    write_captures(tmp_path / "out", 2, 0, size=32, categories=SMALL[:2], progress=seen.append)
    assert sorted(seen) == sorted(f"{name}-0000" for name in SMALL[:2])


def test_folder_with_something_in_it_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(DataError, match="expected a folder that is empty or does not exist"):
        write_captures(tmp_path, 1, 0, size=32)
    with pytest.raises(DataError, match="expected a folder that is empty or does not exist"):
        write_captures(tmp_path / "notes.txt", 1, 0, size=32)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


def test_bad_request_writes_nothing(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="unknown categories"):
        write_captures(tmp_path / "out", 1, 0, categories=["anvil"])
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_one_split_is_the_same_objects_as_in_the_whole_set(
    captures: Path, plans: tuple[Plan, ...], tmp_path: Path
) -> None:
    write_captures(tmp_path / "test", len(plans), 1, size=64, split="test")
    found = CaptureFolder(tmp_path / "test").object_ids
    assert list(found) == [plan.object_id for plan in plans if plan.split == "test"]
    for object_id in found:
        assert digests(tmp_path / "test" / object_id) == digests(captures / object_id)


def test_a_split_without_objects_is_a_plain_error(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="none of these 1 objects is of the split val"):
        write_captures(tmp_path / "out", 1, 0, split="val")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("told", ["mug,fork", "unseen.toml"])
def test_unseen_categories_are_named_on_the_line_or_in_a_file(
    told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("unseen.toml").write_text('unseen_categories = ["mug", "fork"]')
    assert _unseen(told) == ["mug", "fork"]


def test_a_file_without_unseen_categories_is_told(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text("unseen_categories = 3")
    with pytest.raises(DataError, match=r"a.toml: expected a list of names .* got 3"):
        _unseen(str(tmp_path / "a.toml"))


def test_truth_is_a_dataset_of_the_same_objects(captures: Path, truths: Path) -> None:
    folder = open_folder(truths)
    assert sorted(folder.ids()) == sorted(plan.object_id for plan in plan_objects(2, 1))
    for object_id in folder.ids():
        obj, capture = folder.object(object_id), CaptureFolder(captures).read(object_id)
        truth = json.loads((captures / object_id / "truth.json").read_text())
        assert obj.source == "phantom"
        assert {part.density_source for part in obj.parts} == {"truth"}
        assert obj.mass_g == pytest.approx(truth["mass_g"], rel=1e-5)
        np.testing.assert_allclose(obj.com_cm, truth["com_cm"], atol=1e-4)
        measured = capture.views[0].transmission.clip(min=0.0)  # a dataset stores no less
        np.testing.assert_allclose(obj.views[0].transmission, measured, atol=2e-5)
        assert [part.name for part in obj.parts] == [part.name for part in capture.parts]


def test_grid_beside_the_truth_is_the_datasets(captures: Path, truths: Path) -> None:
    for obj in open_folder(truths).objects():
        grid = TruthGrid.load(captures / obj.object_id / "truth.npz")
        assert obj.density is not None
        np.testing.assert_array_equal(grid.labels, obj.labels)
        theirs, ours = obj.density.density_g_cm3, grid.density.density_g_cm3
        assert ours.dtype == np.float32
        np.testing.assert_allclose(ours, theirs, rtol=6e-4, atol=1e-6)  # float16's rounding
        np.testing.assert_allclose(grid.density.origin_cm, obj.origin_cm)
        assert grid.density.voxel_size_cm == pytest.approx(obj.voxel_size_cm)
        assert grid.part_names == tuple(part.name for part in obj.parts)


def test_grid_beside_the_truth_weighs_what_the_parts_weigh(
    captures: Path, plans: tuple[Plan, ...]
) -> None:
    errors = []
    for plan in plans:
        truth = json.loads((captures / plan.object_id / "truth.json").read_text())
        total = sum(part["density_g_cm3"] * part["volume_cm3"] for part in truth["parts"])
        grid = TruthGrid.load(captures / plan.object_id / "truth.npz")
        errors.append(abs(grid.density.mass_g / total - 1))
        volumes = np.bincount(grid.labels.ravel(), minlength=len(truth["parts"]) + 1)[1:]
        thick = [part["volume_cm3"] for part in truth["parts"]]
        largest = int(np.argmax(thick))
        found = volumes[largest] * (grid.density.voxel_size_cm / 2) ** 3
        assert found == pytest.approx(thick[largest], rel=0.15)
    assert np.median(errors) < 1e-3
    assert max(errors) < 1e-2


def test_damaged_grid_is_named(tmp_path: Path) -> None:
    (tmp_path / "truth.npz").write_bytes(b"PK but not really")
    with pytest.raises(DataError, match=r"truth\.npz: not a truth grid that can be read"):
        TruthGrid.load(tmp_path / "truth.npz")


def test_builder_reads_nothing_of_the_truth(captures: Path, tmp_path: Path) -> None:
    bare = tmp_path / "bare"
    shutil.copytree(captures, bare)
    for name in ("truth.json", "truth.npz", "appearance.glb"):
        for path in bare.glob(f"*/{name}"):
            path.unlink()
    whole, without = CaptureFolder(captures), CaptureFolder(bare)
    for object_id in ("water_bottle-0000", "hammer-0000"):
        assert whole.digest(object_id) == without.digest(object_id)
        names = [
            [part.name for part in folder.read(object_id).parts] for folder in (whole, without)
        ]
        assert names[0] == names[1]


def test_appearance_reads_back_as_each_part_looks(
    captures: Path, phantoms: dict[str, Phantom]
) -> None:
    for object_id, phantom in phantoms.items():
        scene = trimesh.load_scene(captures / object_id / "appearance.glb")
        parts = phantom.parts
        assert set(scene.graph.nodes_geometry) == {part.name for part in parts}
        for part in parts:
            to_metres, name = scene.graph[part.name]
            seen = scene.geometry[name]
            surface = seen.visual.material
            assert surface.name == part.name  # the material is not to be read off
            color = np.array(surface.baseColorFactor[:3]) / 255
            np.testing.assert_allclose(color, part.color_rgb, atol=0.5 / 255 + 1e-6)
            assert surface.metallicFactor == pytest.approx(part.metalness)
            assert surface.roughnessFactor == pytest.approx(part.roughness)
            whole = seen.copy().apply_transform(to_metres)
            assert 1e6 * float(whole.volume) == pytest.approx(float(part.mesh.volume), rel=1e-3)
            low, high = part.mesh.bounds / 100
            np.testing.assert_allclose(whole.bounds[0], [low[0], low[2], -high[1]], atol=1e-6)


def test_appearance_has_the_shape_that_is_handed_over(tmp_path: Path) -> None:
    scanner = replace(Scanner(size_px=32), mesh_shift_cm=0.5)
    write_captures(tmp_path / "out", 1, 1, scanner=scanner, categories=["mug"])
    (handed,) = CaptureFolder(tmp_path / "out").read("mug-0000").parts
    scene = trimesh.load_scene(tmp_path / "out" / "mug-0000" / "appearance.glb")
    np.testing.assert_allclose(
        scene.geometry[handed.name].bounds, handed.mesh.bounds, rtol=1e-6, atol=1e-6
    )


@pytest.mark.slow
def test_truth_in_voxels_weighs_what_the_meshes_weigh() -> None:
    scanner = Scanner(size_px=32)
    for plan in plan_objects(19, 4)[::3]:
        obj = truth_object(make_phantom(plan), scanner)
        assert obj.density is not None
        assert obj.density.mass_g == pytest.approx(obj.mass_g, rel=0.01)
        np.testing.assert_allclose(obj.density.com_cm, obj.com_cm, atol=0.02)
        assert set(np.unique(obj.labels)) <= set(range(len(obj.parts) + 1))
        lacs = [part.lac_per_cm for part in obj.parts]
        apparent = [part.apparent_density_g_cm3 for part in obj.parts]
        np.testing.assert_allclose(np.array(lacs) / 0.17, apparent)


@pytest.mark.slow
def test_gallery_draws_a_picture(tmp_path: Path) -> None:
    gallery(tmp_path / "sheet.png", seed=2, categories=["bolt"])
    assert (tmp_path / "sheet.png").read_bytes()[:4] == b"\x89PNG"


def test_shaded_picture_shows_colours_on_white() -> None:
    phantom = make_phantom(Plan.of(0, "rubber_ball-0000"))
    picture = shaded([phantom.parts[0].mesh], [(1.0, 0.0, 0.0)], 30.0, 20.0, size_px=40)
    assert picture.shape == (40, 40, 3)
    np.testing.assert_array_equal(picture[0, 0], 1.0)
    assert picture[20, 20, 0] > 0.4
    assert picture[20, 20, 1] == 0.0


def test_cut_open_leaves_closed_halves() -> None:
    phantom = make_phantom(Plan.of(0, "rubber_ball-0000"))
    whole = phantom.parts[0].mesh
    (half,) = cut_open([whole], np.array([1.0, 0.0, 0.0]))
    assert half.is_volume
    assert float(half.volume) == pytest.approx(float(whole.volume) / 2, rel=0.01)
    assert half.bounds[1][0] == pytest.approx(0.0, abs=1e-3)
