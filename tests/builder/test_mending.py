"""Mending meshes: what was taken from a solid comes back, and nothing is made up."""

import csv
import json
import shutil

import numpy as np
import pytest
import trimesh
from builder.folders import contents
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from xden1k.errors import DataError
from xden1k.values.closed import edge_faults
from xden_builder.capture import CaptureFolder
from xden_builder.capture.mending import mended
from xden_builder.capture.solids import closed_mesh
from xden_builder.cli import cli

BOX = trimesh.creation.box((3.0, 2.0, 1.0)).subdivide().subdivide()
BALL = trimesh.creation.icosphere(3, radius=2.0)
CAN = trimesh.creation.cylinder(1.0, 4.0, sections=48)
TUBE = trimesh.creation.annulus(0.8, 1.0, 4.0, sections=48)


def soup(vertices, faces):
    return trimesh.Trimesh(vertices, faces, process=False)


def without(mesh, gone):
    return soup(mesh.vertices, np.delete(mesh.faces, np.flatnonzero(gone), axis=0))


def without_faces(mesh, gone):
    return without(mesh, np.isin(np.arange(len(mesh.faces)), gone))


def beside(*meshes):
    return trimesh.util.concatenate([soup(mesh.vertices, mesh.faces) for mesh in meshes])


def moved(mesh, *way):
    return mesh.copy().apply_translation(way)


def apart(mesh, sd, seed=2):
    noise = np.random.default_rng(seed).normal(0.0, sd, (3 * len(mesh.faces), 3))
    return soup(
        mesh.triangles.reshape(-1, 3) + noise, np.arange(3 * len(mesh.faces)).reshape(-1, 3)
    )


def at_the_ends(mesh):
    return abs(mesh.face_normals[:, 2]) > 0.99


def solid(mesh, volume, rel=1e-9):
    found = mended(mesh, 1.0, "part")
    assert sum(edge_faults(np.asarray(found.mesh.faces))) == 0
    assert found.mesh.volume == pytest.approx(volume, rel=rel)
    return found


def test_a_solid_is_left_as_it_is():
    found = solid(BALL, BALL.volume)
    assert (found.deeds, found.wide) == ((), False)
    assert np.array_equal(found.mesh.vertices, BALL.vertices)


def test_a_mesh_that_is_inside_out_is_said_to_be():
    inverted = soup(BALL.vertices, BALL.faces[:, ::-1])
    assert solid(inverted, BALL.volume).deeds == ("inside out, turned over",)


@given(st.data())
def test_triangles_missing_from_a_flat_side_come_back_whichever_they_are(data):
    side = np.flatnonzero(BOX.face_normals @ data.draw(st.sampled_from(np.eye(3).tolist())) > 0.9)
    gone = data.draw(
        st.lists(st.sampled_from(side.tolist()), min_size=1, max_size=len(side) - 1, unique=True)
    )
    assert "closed" in solid(without_faces(BOX, gone), BOX.volume).deeds[-1]


@given(st.data())
def test_triangles_missing_from_a_ball_come_back_also_where_their_corners_touch(data):
    free = np.ones(len(BALL.faces), dtype=np.bool_)
    gone = []
    for _ in range(data.draw(st.integers(1, 40))):
        face = data.draw(st.sampled_from(np.flatnonzero(free).tolist()))
        gone.append(face)
        pairs = BALL.face_adjacency
        free[[face, *pairs[(pairs == face).any(axis=1)].ravel()]] = False
    found = solid(without_faces(BALL, gone), BALL.volume)
    assert found.deeds[-1].startswith(f"{len(gone)} hole")


def test_holes_that_meet_at_two_corners_are_each_closed_in_their_own_plane():
    cube = trimesh.creation.box((4.0, 4.0, 4.0))
    for _ in range(4):
        cube = cube.subdivide()
    middles, normals = cube.triangles_center, cube.face_normals
    frame = (abs(middles[:, 1]) < 1.0) & ~((abs(middles[:, 1]) < 0.5) & (middles.max(axis=1) < 1.7))
    top = frame & (normals[:, 2] > 0.9) & (middles[:, 0] > 1.0)
    right = frame & (normals[:, 0] > 0.9) & (middles[:, 2] > 1.0)
    assert solid(without(cube, top), 64.0).wide
    assert solid(without(cube, right), 64.0).wide


@pytest.mark.parametrize("mesh", [CAN, TUBE], ids=["a can", "a tube"])
def test_flat_ends_that_nobody_saw_are_closed_however_wide_and_said_to_be(mesh):
    found = solid(without(mesh, at_the_ends(mesh)), mesh.volume)
    assert found.wide
    assert "2 cm wide" in found.deeds[0]


@pytest.mark.parametrize(
    "mesh",
    [
        trimesh.creation.cylinder(0.2, 21.0, sections=32),
        trimesh.creation.cylinder(1.0, 4.0, sections=3),
    ],
)
def test_a_wide_hole_of_something_thin_or_coarse_is_wide_too(mesh):
    assert solid(without(mesh, at_the_ends(mesh)), mesh.volume).wide


@pytest.mark.parametrize(("rough_cm", "flat"), [(0.005, True), (0.2, False)])
def test_the_rim_of_a_flat_end_may_be_a_little_rough(rough_cm, flat):
    rng = np.random.default_rng(1)
    open_can = without(CAN, at_the_ends(CAN))
    rough = soup(
        open_can.vertices + rng.normal(0.0, rough_cm, open_can.vertices.shape), open_can.faces
    )
    if flat:
        assert solid(rough, CAN.volume, rel=0.01).wide
    else:
        with pytest.raises(DataError, match=r"2 holes up to 2(\.\d)? cm wide, not flat"):
            mended(rough, 1.0, "part")


def test_a_wide_hole_that_is_not_flat_is_refused_with_its_width_whatever_lies_beside():
    ball = trimesh.creation.icosphere(4, radius=2.0)
    around = (abs(ball.triangles_center[:, 0]) < 1.0) & (ball.triangles_center[:, 2] > 0.0)
    crumb = moved(trimesh.creation.icosphere(0, radius=0.01), 200.0, 0.0, 0.0)
    for mesh in (without(ball, around), beside(without(ball, around), crumb)):
        with pytest.raises(DataError, match=r"part: 1 hole up to 4(\.\d)? cm wide, not flat"):
            mended(mesh, 1.0, "part")


@pytest.mark.parametrize("higher_cm", [-0.5, 0.1, 0.3])
def test_two_walls_that_do_not_end_in_one_plane_are_refused(higher_cm):
    outer = without(CAN, CAN.face_normals[:, 2] > 0.99)
    inner = trimesh.creation.cylinder(0.8, 3.0 + higher_cm, sections=48)
    inner = moved(without(inner, inner.face_normals[:, 2] > 0.99), 0.0, 0.0, 0.5 + higher_cm / 2)
    cup = beside(outer, soup(inner.vertices, inner.faces[:, ::-1]))
    with pytest.raises(DataError, match="of two walls, one within the other"):
        mended(cup, 1.0, "part")


def test_a_cup_whose_lip_was_not_seen_is_closed_if_it_is_even():
    outer = without(CAN, CAN.face_normals[:, 2] > 0.99)
    room = trimesh.creation.cylinder(0.8, 3.0, sections=48)
    inner = moved(without(room, room.face_normals[:, 2] > 0.99), 0.0, 0.0, 0.5)
    cup = beside(outer, soup(inner.vertices, inner.faces[:, ::-1]))
    assert solid(cup, CAN.volume - room.volume).wide


@pytest.mark.parametrize("turn", [0.0, 0.3])
def test_a_flat_island_in_a_flat_hole_goes(turn):
    slab = trimesh.creation.box((4.0, 4.0, 1.0))
    for _ in range(4):
        slab = slab.subdivide()
    far = np.linalg.norm(slab.triangles_center[:, :2], axis=1)
    ring = (far > 0.5) & (far < 1.0) & (slab.face_normals[:, 2] > 0.9)
    turned = without(slab, ring)
    turned.apply_transform(trimesh.transformations.rotation_matrix(turn, [1, 2, 3]))
    assert "loose triangles left out" in solid(turned, 16.0).deeds[0]


def test_a_single_sheet_is_no_solid():
    sheet = soup([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    with pytest.raises(DataError, match="part: the mesh encloses no volume"):
        mended(sheet, 1.0, "part")


def test_a_needle_beside_a_solid_is_no_piece_of_it():
    needle = soup([[9, 9, 9], [9, 9, 10], [9, 9, 11]], [[0, 1, 2]])
    assert solid(beside(BALL, needle), BALL.volume).deeds == ("1 loose triangle left out",)


def spoiled_by_a_fin(mesh):
    fin = [[*mesh.faces[0, :2], len(mesh.vertices)]]
    return soup(np.concatenate([mesh.vertices, [[9.0] * 3]]), np.concatenate([mesh.faces, fin]))


def spoiled_by_turning(mesh):
    some = np.arange(len(mesh.faces))[:, None] % 3 == 0
    return soup(mesh.vertices, np.where(some, mesh.faces[:, ::-1], mesh.faces))


SCRAP = soup([[9, 9, 9], [9, 9, 9.1], [9, 9.1, 9]], [[0, 1, 2]])


@pytest.mark.parametrize(
    ("spoiled", "deed"),
    [
        (soup(BALL.vertices, np.concatenate([BALL.faces, BALL.faces[:3]])), "3 repeated triangles"),
        (
            beside(BALL, BALL),
            f"{len(BALL.faces)} repeated triangles left out, 50.0% of the surface",
        ),
        (spoiled_by_a_fin(BALL), "1 overhanging triangle left"),
        (beside(BALL, SCRAP), "1 loose triangle left"),
        (apart(BALL, 1e-6), "joined"),
        (spoiled_by_turning(BALL), "turned over"),
    ],
    ids=["repeated", "twice", "overhanging", "loose", "apart", "turned"],
)
def test_what_editors_leave_is_set_right_and_told(spoiled, deed):
    found = solid(spoiled, BALL.volume, rel=1e-5)
    assert len(found.deeds) == 1
    assert deed in found.deeds[0]
    assert not found.wide


def test_a_face_between_two_boxes_that_touch_is_no_repeated_one():
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    below = soup(box.vertices * [1, 1, -1] + [0, 0, -1], box.faces[:, ::-1])
    both = beside(box, below)
    gone = len(box.faces) + int(np.argmax(below.face_normals[:, 0]))
    assert solid(without_faces(both, [gone]), 2.0).deeds[0].startswith("1 hole closed")


def test_nothing_that_is_there_is_joined_away():
    """Vertices in a row, each near the next, are no copies of one another."""
    coin = trimesh.creation.cylinder(1.0, 0.5, sections=40_000)
    block = moved(trimesh.creation.box((4.0, 4.0, 4.0)), 10.0, 0.0, 0.0)
    solid(without_faces(beside(block, coin), [20]), 64.0 + coin.volume, rel=1e-6)


def test_pieces_that_hardly_meet_are_not_thrown_away_one_by_one():
    ball = moved(apart(trimesh.creation.icosphere(3, radius=1.5), 3e-3), 6.0, 0.0, 0.0)
    with pytest.raises(DataError, match="part: "):
        mended(beside(trimesh.creation.box((4.0, 4.0, 4.0)), ball), 1.0, "part")


def test_a_rim_of_many_vertices_is_closed_within_memory():
    can = trimesh.creation.cylinder(1.0, 4.0, sections=20_000)
    assert solid(without(can, at_the_ends(can)), can.volume).wide


@pytest.fixture(scope="module")
def sound_captures(tmp_path_factory):
    captures = tmp_path_factory.mktemp("mend") / "captures"
    arguments = ["phantoms", str(captures), "--count", "2", "--seed", "1", "--size", "64"]
    made = CliRunner().invoke(cli, arguments)
    assert made.exit_code == 0, made.output
    return captures


@pytest.fixture
def holed(sound_captures, tmp_path):
    captures = tmp_path / "captures"
    shutil.copytree(sound_captures, captures)
    head, *rows = (captures / "objects.csv").read_text().splitlines()
    told = [f"{head},mesh_units", *(f"{row},mm" for row in rows)]
    (captures / "objects.csv").write_text("\n".join(told) + "\n")
    for each in captures.glob("*/parts/*.ply"):
        trimesh.load(each, process=False).apply_scale(10.0).export(each)
    path = max(captures.glob("*/parts/*.ply"), key=lambda each: each.stat().st_size)
    without_faces(trimesh.load(path, process=False), [0]).export(path)
    return captures, path


def mend(captures, out, *more):
    return CliRunner().invoke(
        cli, ["mend", str(captures), "--out", str(out), "--workers", "1", *more]
    )


def test_a_folder_with_a_hole_is_mended_beside_it_and_can_be_rebuilt_from(holed, tmp_path):
    captures, path = holed
    before, out = contents(captures), tmp_path / "mended"
    refused = CliRunner().invoke(cli, ["check", str(captures), "--workers", "1"])
    assert "not closed: 3 open edges; `xden-build mend`" in refused.output
    answer = mend(captures, out)
    assert answer.exit_code == 0, answer.output
    assert "1 object mended, 1 sound, 0 failed" in answer.output
    assert contents(captures) == before
    (row,) = csv.DictReader((out / "mended.csv").read_text().splitlines())
    object_id = path.parts[-3]
    assert (row["object_id"], row["part"]) == (object_id, path.stem)
    assert row["done"].startswith("1 hole closed")
    there = ["check", str(captures), "--parts", str(out), "--workers", "1"]
    assert "2 objects, 2 sound, 0 refused" in CliRunner().invoke(cli, there).output
    given, found = (
        trimesh.load(each, process=False) for each in (path, out / path.relative_to(captures))
    )
    assert found.extents == pytest.approx(given.extents)
    assert {part.name for part in CaptureFolder(captures, out).read(object_id).parts} == {
        each.stem for each in path.parent.glob("*.ply")
    }
    again = mend(captures, out)
    assert (again.exit_code, "empty or does not exist" in again.output) == (1, True)


def test_an_object_that_cannot_be_mended_is_named_and_the_others_go_on(holed, tmp_path):
    captures, path = holed
    (captures / path.parts[-3] / "parts" / "zz.ply").write_bytes(path.read_bytes())
    sheet = soup([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    sheet.export(captures / path.parts[-3] / "parts" / "zz.ply")
    answer = mend(captures, tmp_path / "mended", "--json")
    assert answer.exit_code == 3
    said = json.loads(answer.output)
    (failure,) = said["failures"]
    assert failure["object_id"] == path.parts[-3]
    assert "part zz: the mesh encloses no volume" in failure["message"]
    assert not (tmp_path / "mended" / path.parts[-3]).exists()
    assert list(said["objects"].values()) == [[]]
    assert len(list((tmp_path / "mended").glob("*/parts"))) == 1


def test_where_nothing_can_be_mended_nothing_is_written(holed, tmp_path):
    captures, _ = holed
    for folder in captures.glob("*/parts"):
        soup([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]).export(folder / "zz.ply")
    answer = mend(captures, tmp_path / "mended")
    assert answer.exit_code == 1
    assert "no object could be mended" in answer.output
    assert not (tmp_path / "mended").exists()


@pytest.mark.parametrize("name", ["../out", ".hidden", "a/b", "a\\b"])
def test_a_part_in_a_scene_may_not_be_named_like_a_path(holed, tmp_path, name):
    captures, path = holed
    folder = captures / path.parts[-3]
    scene = trimesh.Scene()
    for number, part in enumerate(sorted((folder / "parts").glob("*.ply"))):
        scene.add_geometry(trimesh.load(part), node_name=part.stem if number else name)
        part.unlink()
    (folder / "parts").rmdir()
    scene.export(folder / "mesh.glb")
    answer = mend(captures, tmp_path / "mended")
    assert answer.exit_code == 3
    assert f"mesh.glb: part {name!r}" in answer.output
    assert not list(tmp_path.glob("*.ply"))


@pytest.mark.parametrize(("level", "taken"), [(6, True), (2, False)])
def test_a_flap_that_is_there_twice_is_refused_only_where_it_is_of_some_size(level, taken):
    """One triangle of a ball twice more, and twice the other way round: closed, of no volume."""
    ball = trimesh.creation.icosphere(level)
    flap = ball.faces[[0, 0]]
    flapped = soup(ball.vertices, np.concatenate([ball.faces, flap, flap[:, ::-1]]))
    if taken:
        closed, _ = closed_mesh(flapped, 1.0, "part")
        assert closed.volume == pytest.approx(ball.volume, rel=1e-9)
    else:
        with pytest.raises(DataError, match="3 triangles are there twice"):
            closed_mesh(flapped, 1.0, "part")
