"""Shapes of PartNeXt, made up here in its layout, become solids that can be scanned."""

from __future__ import annotations

import ast
import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from builder.folders import contents
from builder.partnext_snapshots import (
    box,
    case_and_lid,
    hammer,
    lidless,
    row,
    write_glb,
    write_rows,
    write_snapshot,
)
from click.testing import CliRunner

from xden1k.cli import cli as xden
from xden1k.errors import DataError
from xden1k.folder import open_folder
from xden1k.format.manifest import Manifest
from xden1k.format.shapes import ON_PARTNEXT
from xden1k.rays import disjoint_regions, outer_surface
from xden1k.values.closed import edge_faults
from xden1k.values.materials import load_materials
from xden_builder.capture import CaptureFolder
from xden_builder.cli import cli
from xden_builder.phantoms import Scanner
from xden_builder.phantoms.partnext.annotations import find_annotations
from xden_builder.phantoms.partnext.bodies import bodies, capped
from xden_builder.phantoms.partnext.model import Leaf, Model, read_model
from xden_builder.phantoms.partnext.phantom import ModelPlan, Shaping, model_phantom
from xden_builder.phantoms.partnext.priors import (
    FILLERS,
    draw_material,
    materials_named,
    usual_materials,
)
from xden_builder.phantoms.partnext.solids import FATES, HOLLOW_SHARE, Shape, shape_model
from xden_builder.phantoms.partnext.writer import PartNeXtSet, write_partnext
from xden_builder.phantoms.phantom import random_numbers
from xden_builder.pipeline.publish.run import push

GRID = 28
"""Coarse, and quick."""
KINDS = {"filler": ["filler"], "inclusion": ["filler", "inclusion"], "void": []}
QUICK = ["--size", "16", "--grid", str(GRID), "--ideal", "--workers", "1"]


def surface(meshes: list[trimesh.Trimesh], owners: list[list[int]] | None = None) -> Model:
    """A model of some meshes, each a part of its own, or with the parts of their faces."""
    owner = [np.full(len(mesh.faces), part) for part, mesh in enumerate(meshes, 1)]
    if owners is not None:
        owner = [np.array(each) for each in owners]
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    owned = np.concatenate(owner)
    return Model(
        np.concatenate([np.asarray(mesh.vertices, dtype=np.float64) for mesh in meshes]),
        np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]),
        owned,
        tuple(Leaf((f"Part {part}",), str(part)) for part in range(1, int(owned.max()) + 1)),
        "Thing",
        "here",
    )


def shaped(model: Model, seed: int = 0, half_cm: float = 1.0, grid: int = GRID) -> Shape:
    return shape_model(model, half_cm, lambda purpose: random_numbers(seed, purpose), grid)


def volumes(shape: Shape) -> list[float]:
    return [float(solid.mesh.volume) for solid in shape.solids]


def divided_box() -> Model:
    """A box of five sides and a lid; only together do they enclose anything."""
    case, _ = lidless((2, 2, 2))
    return surface([box((2, 2, 2))], [[1 if face in case else 2 for face in range(12)]])


def seed_of(fate: str) -> int:
    """A seed by which the case of that box is a shell, and its room becomes this."""
    for seed in range(100):
        hollow = random_numbers(seed, "hollow/part_1").random() < HOLLOW_SHARE
        if hollow and random_numbers(seed, "rooms").choice(FATES) == fate:
            return seed
    raise AssertionError


# --- solids ---------------------------------------------------------------------------------------

SHAPES = {
    "ball": lambda: surface([trimesh.creation.icosphere(2)]),
    "crossed": lambda: surface([box((2, 0.6, 0.6)), box((0.6, 2, 0.6))]),
    "nested": lambda: surface([box((2, 2, 2)), box((1, 1, 1))]),
    "touching": lambda: surface([box((1, 1, 1)), box((1, 1, 1), (1, 0, 0))]),
    "divided": divided_box,
    "soup": lambda: surface([box((2, 1, 1)).submesh([range(7)], append=True), box((1, 2, 0.7))]),
}


@pytest.mark.parametrize("name", SHAPES)
def test_solids_are_closed_and_disjoint_and_fill_the_outer_surface(name: str) -> None:
    shape = shaped(SHAPES[name](), seed=5)
    meshes = [solid.mesh for solid in shape.solids]
    for mesh in meshes:
        assert edge_faults(np.asarray(mesh.faces)) == (0, 0)
        assert mesh.volume > 0
    left = disjoint_regions(meshes, range(len(meshes)))
    assert all(one is other for one, other in zip(left, meshes, strict=True))
    filled = sum(volumes(shape)) + shape.void_cm3
    assert filled == pytest.approx(float(shape.outer.volume), rel=0.005)
    if not shape.voids:
        assert sum(volumes(shape)) == pytest.approx(float(shape.outer.volume), rel=0.005)


def test_volumes_are_those_of_the_shapes() -> None:
    assert volumes(shaped(surface([box((2, 2, 2))]))) == pytest.approx([8.0], rel=0.01)
    ball = trimesh.creation.icosphere(3)
    assert volumes(shaped(surface([ball]))) == pytest.approx([float(ball.volume)], rel=0.03)
    nested = volumes(shaped(SHAPES["nested"]()))
    assert nested == pytest.approx([7.0, 1.0], rel=0.12)


@pytest.mark.parametrize("half_cm", [0.5, 7.0])
def test_size_is_half_of_the_longest_side(half_cm: float) -> None:
    shape = shaped(surface([box((1, 3, 2))]), half_cm=half_cm)
    assert shape.outer.extents.max() == pytest.approx(2 * half_cm, rel=1e-3)


def test_a_box_without_lid_gets_a_wall_of_the_thickness_that_was_drawn() -> None:
    case, _ = lidless((2, 2, 2))
    open_box = box((2, 2, 2)).submesh([case], append=True)
    shape = shaped(surface([open_box]), grid=36)
    (wall,) = shape.walls_cm.values()
    assert volumes(shape) == pytest.approx([5 * 4 * wall], rel=0.1)
    assert shape.outer.extents[0] == pytest.approx(2 + wall, rel=0.02)  # half of it on either side


@pytest.mark.parametrize("fate", FATES)
def test_a_hollow_box_gets_its_wall_and_what_is_inside_is_drawn(fate: str) -> None:
    shape = shaped(divided_box(), seed_of(fate))
    assert [solid.kind for solid in shape.solids[2:]] == KINDS[fate]
    case, lid = shape.walls_cm["part_1"], shape.walls_cm["part_2"]
    room = (2 - 2 * case) ** 2 * (2 - case - lid)
    assert shape.void_cm3 == pytest.approx(room if fate == "void" else 0, rel=0.1)
    assert sum(volumes(shape)[2:]) == pytest.approx(0 if fate == "void" else room, rel=0.1)


def test_a_box_that_is_drawn_to_be_solid_is_so() -> None:
    seed = next(k for k in range(99) if random_numbers(k, "hollow/part_1").random() > HOLLOW_SHARE)
    shape = shaped(divided_box(), seed)
    assert list(shape.walls_cm) == ["part_2"]
    assert volumes(shape)[0] + shape.walls_cm["part_2"] * 4 == pytest.approx(8, rel=0.03)


def test_a_void_does_not_reach_the_air_where_faces_are_of_no_part() -> None:
    case, _ = lidless((2, 2, 2))
    model = surface([box((2, 2, 2))], [[1 if face in case else 0 for face in range(12)]])
    shape = shaped(model, seed_of("void"))
    assert shape.voids == 1
    around = outer_surface([solid.mesh for solid in shape.solids])
    assert float(around.volume) == pytest.approx(float(shape.outer.volume), rel=1e-3)
    assert float(around.volume) - sum(volumes(shape)) == pytest.approx(shape.void_cm3, rel=0.01)


def test_a_closed_piece_within_another_of_the_same_part_is_a_cavity() -> None:
    both = trimesh.util.concatenate([box((2, 2, 2)), box((1, 1, 1))])
    shape = shaped(surface([both]))
    assert volumes(shape)[0] == pytest.approx(7.0, rel=0.03)
    assert sum(volumes(shape)[1:]) + shape.void_cm3 == pytest.approx(1.0, rel=0.15)


def test_a_hole_is_covered_from_its_rim() -> None:
    whole = box((4, 4, 4)).triangles
    (one,) = bodies(whole)
    assert len(capped(one)) == 12
    assert len(list(bodies(np.concatenate([whole, whole + 9.0])))) == 2
    case, _ = lidless((4, 4, 4))
    closed = trimesh.Trimesh(**trimesh.triangles.to_kwargs(capped(whole[case])))
    assert edge_faults(np.asarray(closed.faces)).open == 0


def test_parts_of_nothing_are_refused_by_name() -> None:
    speck = box((0.001, 0.001, 0.001), (0.9, 0.9, 0.9))
    twice = surface([box((2, 2, 2)), speck, speck])
    with pytest.raises(DataError, match=r"here: mask \d of Part \d: expected a closed solid after"):
        shaped(twice)


# --- an object ------------------------------------------------------------------------------------


def test_names_tell_materials() -> None:
    assert materials_named(["Steel Head"]) == ("steel",)
    assert materials_named(["Stainless Steel Rim"]) == ("stainless_steel_304",)
    assert {load_materials()[name].family for name in materials_named(["Wooden Legs"])} == {"wood"}
    assert "rubber_filled" in materials_named(["tyres"])
    assert materials_named(["Thing", "Glass Door"]) == materials_named(["Glass"])
    assert materials_named(["Gizmo", "Contraption"]) == ()
    for name in ("water", "air", "bone_cortical"):
        assert name not in usual_materials()
    assert set(FILLERS) <= set(load_materials())


def test_a_name_is_not_always_believed() -> None:
    rng = np.random.default_rng(0)
    drawn = [draw_material(rng, ("brass",)) for _ in range(2000)]
    assert 1 - drawn.count("brass") / 2000 == pytest.approx(0.2, abs=0.03)
    assert len({draw_material(rng, ()) for _ in range(500)}) > 40


def test_a_shape_is_in_one_split_whatever_the_seed() -> None:
    plans = [ModelPlan(seed, f"{k:032x}", "table") for seed in (0, 1) for k in range(500)]
    splits = [plan.split for plan in plans]
    assert splits[:500] == splits[500:]
    shares = [splits.count(split) / 1000 for split in ("train", "val", "test")]
    assert shares == pytest.approx([0.7, 0.1, 0.2], abs=0.06)


def test_parts_of_one_name_are_of_one_batch_and_numbered(tmp_path: Path) -> None:
    meshes = [box((1, 1, 1)), box((0.3, 2, 0.3), (0.3, -1, 0)), box((0.3, 2, 0.3), (-0.3, -1, 0))]
    masks = {str(k): {str(k): list(range(12))} for k in range(3)}
    write_glb(tmp_path, "x", meshes)
    write_rows(tmp_path, [row("x", meshes, masks, ["Seat", "Leg", "leg"])], "jsonl")
    (entry,) = find_annotations(tmp_path).entries
    phantom, told = model_phantom(read_model(tmp_path, entry), 1, "x", Shaping(grid=GRID))
    assert [part.name for part in phantom.parts] == ["leg-001", "leg-002", "seat"]
    assert phantom.parts[0].density_g_cm3 == phantom.parts[1].density_g_cm3
    assert phantom.plan.kind == "table"
    assert told["notes"] == ON_PARTNEXT
    points = np.concatenate([part.mesh.vertices for part in phantom.parts])
    assert points.min(axis=0) + points.max(axis=0) == pytest.approx(np.zeros(3), abs=1e-9)
    seat, legs = phantom.parts[2].mesh, phantom.parts[0].mesh
    assert seat.bounds[1, 2] > legs.bounds[1, 2]  # y of the GLB is up


# --- annotations ----------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["parquet", "jsonl", "arrow"])
def test_annotations_are_read_in_every_form(tmp_path: Path, kind: str) -> None:
    folder = write_snapshot(tmp_path, kind)
    entries = find_annotations(folder).entries
    assert [entry.model_id for entry in entries] == ["aaaa01", "bbbb02"]
    models = [read_model(folder, entry) for entry in entries]
    assert [leaf.names[0] for leaf in models[0].leaves] == ["Case", "Wooden Lid"]
    assert np.bincount(models[0].owner).tolist() == [0, 10, 2]
    head = models[1].vertices[models[1].faces[models[1].owner == 2]]
    assert np.ptp(head.reshape(-1, 3), axis=0) == pytest.approx([0.9, 0.5, 0.4])


def test_literals_of_python_are_read_too(tmp_path: Path) -> None:
    meshes, told = hammer("x")
    told |= {"masks": repr(ast.literal_eval(told["masks"])), "hierarchyList": told["hierarchyList"]}
    write_glb(tmp_path, "x", meshes)
    write_rows(tmp_path, [told])
    (entry,) = find_annotations(tmp_path).entries
    assert len(read_model(tmp_path, entry).leaves) == 2


def test_face_counts_tell_in_which_order_meshes_were_annotated(tmp_path: Path) -> None:
    meshes = [box((1, 1, 1)), trimesh.creation.icosphere(1).apply_translation((2, 0, 0))]
    masks = {"0": {"0": [0]}}
    write_glb(tmp_path, "x", meshes)
    for order in (meshes, meshes[::-1]):
        write_rows(tmp_path, [row("x", order, masks, ["Corner"])])
        (entry,) = find_annotations(tmp_path).entries
        model = read_model(tmp_path, entry)
        at = model.vertices[model.faces[model.owner == 1]].reshape(-1, 3)[:, 0].mean()
        assert (at > 1) == (order is not meshes)


def test_of_several_annotations_the_one_with_the_greatest_time_is_taken(tmp_path: Path) -> None:
    meshes, told = hammer("x")
    rows = [told | {"anno_time": time, "user_id": user} for time, user in
            (("9.5", "1"), ("100", "2"), ("100", "3"), ("20", "4"))]  # fmt: skip
    write_glb(tmp_path, "x", meshes)
    write_rows(tmp_path, rows)
    found = find_annotations(tmp_path)
    assert found.repeated == 3
    assert (found.entries[0].block, found.entries[0].row) == (1, 0)  # the third of four
    assert found.entries[0].seconds == 100


# --- bad input ------------------------------------------------------------------------------------


def changed(field: str, change: Any) -> dict[str, Any]:
    """A hammer's row in which a field's parsed value is changed."""
    _, told = hammer("bad")
    value = json.loads(told[field])
    made = change(value)
    return told | {field: json.dumps(value if made is None else made)}


def nested(depth: int) -> str:
    """A tree of one node in another."""
    return '[{"name": "a", "children": ' * depth + "[]" + "}]" * depth


BAD: dict[str, tuple[dict[str, Any], str]] = {
    "mask of no mesh": (
        changed("masks", lambda masks: masks["1"].update({"2": [0]})),
        "mask 1 of Steel Head: names mesh 2, but there are 2 from 0",
    ),
    "mask of no face": (
        changed("masks", lambda masks: masks["1"]["1"].append(12)),
        "mask 1 of Steel Head: names face 12 of mesh 1, which has 12 from 0",
    ),
    "negative face": (
        changed("masks", lambda masks: masks["1"]["1"].append(-1)),
        "names face -1 of mesh 1",
    ),
    "words for faces": (
        changed("masks", lambda masks: masks["1"].update({"1": ["a"]})),
        "expected faces of mesh 1 as whole numbers",
    ),
    "halves of faces": (
        changed("masks", lambda masks: masks["1"].update({"1": [0.5, 1.7]})),
        "expected faces of mesh 1 as whole numbers in a list, got [0.5, 1.7]",
    ),
    "truths for faces": (
        changed("masks", lambda masks: masks["1"].update({"1": [True, False]})),
        "expected faces of mesh 1 as whole numbers in a list, got [True, False]",
    ),
    "lists of faces in a list": (
        changed("masks", lambda masks: masks["1"].update({"1": [[0, 1], [2, 3]]})),
        "expected faces of mesh 1 as whole numbers in a list, got [[0, 1], [2, 3]]",
    ),
    "a face beyond all counting": (
        changed("masks", lambda masks: masks["1"].update({"1": [10**30]})),
        "expected faces of mesh 1 as whole numbers in a list, got [1000",
    ),
    "brackets without end": (
        hammer("bad")[1] | {"masks": "[" * 100_000},
        "masks: expected JSON in a string, got '[[[",
    ),
    "nodes deeper than can be followed": (
        hammer("bad")[1] | {"hierarchyList": nested(1200)},
        "hierarchyList: expected ",
    ),
    "face in two masks": (
        changed("masks", lambda masks: masks["1"].update({"0": [3, 4]})),
        "mask 1 of Steel Head: 2 faces are in mask 0 of Handle too",
    ),
    "missing mask": (
        changed("masks", lambda masks: {"0": masks["0"]}),
        "masks: expected mask 1 of Steel Head, found none",
    ),
    "no face at all": (
        changed("masks", lambda masks: {key: {} for key in masks}),
        "masks: expected a face in a mask of a leaf, found none",
    ),
    "masks in a list": (changed("masks", lambda _: [1]), "masks: expected faces by mask and mesh"),
    "other face count": (
        changed("mesh_face_num", lambda counts: counts.update({"1": 13})),
        "mesh_face_num: expected 12 faces of mesh 1 as in the GLB, got 13",
    ),
    "other mesh count": (
        changed("mesh_face_num", lambda counts: {"0": counts["0"]}),
        "mesh_face_num: expected 2 meshes as the GLB, got 1",
    ),
    "counts in a word": (
        changed("mesh_face_num", lambda _: "many"),
        "mesh_face_num: expected face counts by mesh, got 'many'",
    ),
    "no leaf": (
        changed("hierarchyList", lambda tree: [leaf.pop("maskId") for leaf in tree[0]["children"]]
                and None),
        "hierarchyList: expected a leaf with a maskId, found none",
    ),
    "nameless node": (
        changed("hierarchyList", lambda _: [{"nodeId": 0}]),
        "hierarchyList: expected nodes with a name",
    ),
    "one mask twice": (
        changed("hierarchyList", lambda tree: tree[0]["children"][1].update({"maskId": 0})),
        "hierarchyList: two leaves have the maskId 0",
    ),
    "empty tree": (changed("hierarchyList", lambda _: []), "expected a list of nodes, got []"),
    "no JSON": (
        hammer("bad")[1] | {"masks": '{"0": {"0": [1, 2'},
        "masks: expected JSON in a string, got",
    ),
    "nothing": (hammer("bad")[1] | {"masks": None}, "masks: expected JSON in a string, got None"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_a_bad_annotation_is_one_line_that_names_file_and_object(tmp_path: Path, name: str) -> None:
    told, expected = BAD[name]
    write_glb(tmp_path, "bad", hammer("bad")[0])
    path = write_rows(tmp_path, [told], "jsonl")
    (entry,) = find_annotations(tmp_path).entries
    with pytest.raises(DataError) as error:
        read_model(tmp_path, entry)
    line = str(error.value)
    assert line.startswith(f"{path}: object bad: ")
    assert expected in line
    assert "\n" not in line


def test_a_bad_glb_is_one_line_too(tmp_path: Path) -> None:
    write_rows(tmp_path, [hammer("bad")[1]])
    (entry,) = find_annotations(tmp_path).entries
    with pytest.raises(DataError, match=r"object bad: expected glbs/000-000/bad.glb, found no"):
        read_model(tmp_path, entry)
    path = write_glb(tmp_path, "bad", hammer("bad")[0])
    whole = path.read_bytes()
    for damaged in (b"", b"glTF", whole[: len(whole) // 2]):
        path.write_bytes(damaged)
        with pytest.raises(DataError, match=r"bad\.glb: not a GLB that can be read"):
            read_model(tmp_path, entry)
    cloud = trimesh.Scene(trimesh.PointCloud(np.eye(3)))
    path.write_bytes(cloud.export(file_type="glb"))
    with pytest.raises(
        DataError, match=r"object bad: expected meshes alone, got (none|PointCloud)"
    ):
        read_model(tmp_path, entry)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("{", "line 1: expected a row as JSON"),
        ("[1]", "line 1: expected a row as a JSON object"),
        (
            '{"model_id": "../x", "type_id": "000-000"}',
            "model_id: expected 1 to 128 letters",
        ),
        ('{"model_id": "x", "type_id": ".."}', "line 1: type_id: expected 1 to 128 letters"),
        ('{"model_id": "x", "type_id": "0", "anno_time": "soon"}', "anno_time: expected a number"),
        ('{"model_id": "x", "type_id": "0", "anno_time": "nan"}', "anno_time: expected a number"),
        ('{"model_id": "%s", "type_id": "0"}' % ("x" * 300), "model_id: expected 1 to 128"),
        ("[" * 100_000, "line 1: expected a row as JSON"),
    ],
)
def test_a_row_that_names_no_model_is_told_by_its_place(
    tmp_path: Path, line: str, said: str
) -> None:
    (tmp_path / "rows.jsonl").write_text(f"{line}\n")
    found = find_annotations(tmp_path)
    assert not found.entries
    ((_, why),) = [(at, f"{at}: {why}") for at, why in found.faults]
    assert said in why


def test_a_folder_without_annotations_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"expected annotations as \.arrow, \.jsonl, \.parquet"):
        find_annotations(tmp_path)
    path = write_rows(tmp_path, [{"model_id": "x", "type_id": "0"}])
    with pytest.raises(DataError, match="expected a column anno_time, got model_id, type_id"):
        find_annotations(tmp_path)
    path.write_bytes(b"PAR1")
    with pytest.raises(DataError, match="not a Parquet file that can be read"):
        find_annotations(tmp_path)


# --- the command ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def snapshot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two good models, one bad one, and one annotated twice."""
    folder = tmp_path_factory.mktemp("partnext")
    rows = []
    for make, model_id in ((case_and_lid, "aaaa01"), (hammer, "bbbb02"), (hammer, "cccc03")):
        meshes, told = make(model_id)
        write_glb(folder, model_id, meshes)
        rows.append(told)
    rows[2]["masks"] = "{"
    write_rows(folder / "data", [*rows, rows[0]])
    return folder


def simulate(snapshot: Path, out: Path, *more: str) -> Any:
    asked = ["partnext", str(snapshot), "--out", str(out), "--seed", "3", *QUICK, *more]
    return CliRunner().invoke(cli, asked)


@pytest.fixture(scope="module")
def captured(snapshot: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any]:
    out = tmp_path_factory.mktemp("captured") / "captures"
    return out, simulate(snapshot, out)


def test_what_fails_is_told_and_the_others_go_on(captured: tuple[Path, Any]) -> None:
    out, answer = captured
    assert answer.exit_code == 3
    assert "failed: cccc03: " in answer.stderr
    assert "masks: expected JSON in a string" in answer.stderr
    assert "2 objects, 1 failed; 1 more rows of the same models" in answer.stdout
    assert not (out / "cccc03").exists()
    folder = CaptureFolder(out)
    assert list(folder.object_ids) == ["aaaa01", "bbbb02"]
    for object_id in folder.object_ids:
        capture = folder.read(object_id)
        assert (capture.source, capture.notes, capture.flags) == ("phantom", ON_PARTNEXT, ())


def test_every_document_says_what_it_is(captured: tuple[Path, Any]) -> None:
    out, answer = captured
    assert ON_PARTNEXT in answer.stdout
    rows = list(csv.DictReader((out / "objects.csv").read_text().splitlines()))
    assert {(each["source"], each["notes"]) for each in rows} == {("phantom", ON_PARTNEXT)}
    for file in (out / "simulation.json", out / "aaaa01" / "truth.json"):
        assert json.loads(file.read_text())["notes"] == ON_PARTNEXT


def test_an_object_depends_on_seed_and_model_alone(
    snapshot: Path, captured: tuple[Path, Any], tmp_path: Path
) -> None:
    alone = tmp_path / "alone"
    answer = simulate(snapshot, alone, "--objects", "bbbb02")
    assert answer.exit_code == 0
    assert contents(alone / "bbbb02") == contents(captured[0] / "bbbb02")


def test_without_one_good_object_there_is_an_error_and_no_capture(
    snapshot: Path, tmp_path: Path
) -> None:
    answer = simulate(snapshot, tmp_path / "out", "--objects", "cccc03")
    assert answer.exit_code == 1
    assert "not one of 1 objects could be made, first: " in answer.stderr
    assert not (tmp_path / "out").exists()
    (tmp_path / "out").mkdir()
    simulate(snapshot, tmp_path / "out", "--objects", "cccc03")
    assert not any((tmp_path / "out").iterdir())
    answer = simulate(snapshot, tmp_path / "out", "--objects", "none")
    assert (answer.exit_code, "no annotation of object none" in answer.stderr) == (1, True)


def test_the_truth_as_a_dataset_says_whose_shapes_and_is_not_published(
    snapshot: Path, tmp_path: Path
) -> None:
    out = tmp_path / "truth"
    answer = simulate(snapshot, out, "--as-dataset", "--objects", "bbbb02", "--json")
    assert answer.exit_code == 0
    told = json.loads(answer.stdout)
    assert (told["kind"], told["made"], told["failed"]) == ("dataset", 1, 0)
    for name in ("README.md", "DATASHEET.md", "croissant.json", "CITATION.cff"):
        assert ON_PARTNEXT in (out / name).read_text()
    assert "license: other" in (out / "README.md").read_text()
    assert Manifest.read(out).on_partnext == 1
    info = CliRunner().invoke(xden, ["info", "--root", str(out)])
    assert f"shapes      1 are {ON_PARTNEXT}" in info.stdout
    obj = open_folder(out).object("bbbb02")
    assert (obj.source, obj.meta["notes"]) == ("phantom", ON_PARTNEXT)
    with pytest.raises(DataError, match="have shapes of PartNeXt, each under a licence"):
        push(out, "someone/something")


@pytest.mark.parametrize("wrong", [("5", "2"), ("0", "2")])
def test_sizes_must_ascend(snapshot: Path, tmp_path: Path, wrong: tuple[str, str]) -> None:
    answer = simulate(snapshot, tmp_path / "out", "--size-cm", *wrong)
    assert answer.exit_code == 1
    assert "sizes must be positive and ascending" in answer.stderr


@pytest.mark.slow
def test_captures_are_sound_and_rebuild(snapshot: Path, tmp_path: Path) -> None:
    out, built = tmp_path / "captures", tmp_path / "built"
    models = PartNeXtSet(snapshot, 1, Scanner.realistic(96), objects=("bbbb02",))
    assert write_partnext(out, models, models.chosen()).objects == ("bbbb02",)
    runner = CliRunner()
    assert runner.invoke(cli, ["check", str(out), "--workers", "1"]).exit_code == 0
    ran = runner.invoke(cli, ["run", str(out), "--out", str(built), "--workers", "1"])
    assert ran.exit_code == 0, ran.output
    obj = open_folder(built).object("bbbb02")
    assert obj.meta["notes"] == ON_PARTNEXT
    assert ON_PARTNEXT in (built / "README.md").read_text()
    truth = json.loads((out / "bbbb02" / "truth.json").read_text())
    assert obj.mass_g == pytest.approx(truth["mass_g"], rel=0.3)
