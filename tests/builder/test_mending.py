"""Mending meshes: what was taken from a solid comes back, and nothing is made up."""

import csv

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
from xden_builder.cli import cli

BOX = trimesh.creation.box((3.0, 2.0, 1.0)).subdivide().subdivide()
BALL = trimesh.creation.icosphere(3, radius=2.0)
CAN = trimesh.creation.cylinder(1.0, 4.0, sections=48)
TUBE = trimesh.creation.annulus(0.8, 1.0, 4.0, sections=48)


def soup(vertices, faces):
    return trimesh.Trimesh(vertices, faces, process=False)


def without(mesh, gone):
    return soup(mesh.vertices, np.delete(mesh.faces, np.flatnonzero(gone), axis=0))


def at_the_ends(mesh):
    return abs(mesh.face_normals[:, 2]) > 0.99


def solid(mesh, **limits):
    found = mended(mesh, 1.0, "part")
    assert sum(edge_faults(np.asarray(found.mesh.faces))) == 0
    assert found.mesh.volume == pytest.approx(limits["volume"], rel=limits.get("rel", 1e-9))
    return found


def test_a_solid_is_left_as_it_is():
    found = solid(BALL, volume=BALL.volume)
    assert (found.deeds, found.wide) == ((), False)
    assert np.array_equal(found.mesh.vertices, BALL.vertices)


@given(st.data())
def test_triangles_missing_from_a_flat_side_come_back_whichever_they_are(data):
    side = np.flatnonzero(BOX.face_normals @ data.draw(st.sampled_from(np.eye(3).tolist())) > 0.9)
    gone = data.draw(st.lists(st.sampled_from(side.tolist()), min_size=1, unique=True))
    found = solid(without(BOX, np.isin(np.arange(len(BOX.faces)), gone)), volume=BOX.volume)
    assert "closed" in found.deeds[-1]


@pytest.mark.parametrize("mesh", [CAN, TUBE], ids=["a can", "a tube"])
def test_flat_ends_that_nobody_saw_are_closed_however_wide_and_said_to_be(mesh):
    found = solid(without(mesh, at_the_ends(mesh)), volume=mesh.volume)
    assert found.wide
    assert "2 cm wide" in found.deeds[0]


def test_the_rim_of_a_flat_end_may_be_rough():
    rng = np.random.default_rng(1)
    open_can = without(CAN, at_the_ends(CAN))
    rough = soup(
        open_can.vertices + rng.normal(0.0, 0.005, open_can.vertices.shape), open_can.faces
    )
    assert solid(rough, volume=CAN.volume, rel=0.01).wide


def test_a_wide_hole_that_is_not_flat_is_refused_with_its_width():
    around = (abs(BALL.triangles_center[:, 0]) < 1.0) & (BALL.triangles_center[:, 2] > 0.0)
    with pytest.raises(DataError, match=r"part: a hole 4(\.\d)? cm wide that is not flat"):
        mended(without(BALL, around), 1.0, "part")


def test_a_single_sheet_is_no_solid():
    sheet = soup([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    with pytest.raises(DataError, match="no volume"):
        mended(sheet, 1.0, "part")


@pytest.mark.parametrize(
    ("spoil", "deed"),
    [
        (lambda m: soup(m.vertices, np.concatenate([m.faces, m.faces[:3]])), "3 repeated"),
        (
            lambda m: soup(
                np.concatenate([m.vertices, [[9.0, 9.0, 9.0]]]),
                np.concatenate([m.faces, [[*m.faces[0, :2], len(m.vertices)]]]),
            ),
            "1 overhanging triangle left",
        ),
        (
            lambda m: trimesh.util.concatenate(
                [m, soup([[9, 9, 9], [9, 9, 9.1], [9, 9.1, 9]], [[0, 1, 2]])]
            ),
            "1 loose triangle left",
        ),
        (
            lambda m: soup(
                m.triangles.reshape(-1, 3)
                + np.random.default_rng(2).normal(0.0, 1e-6, (3 * len(m.faces), 3)),
                np.arange(3 * len(m.faces)).reshape(-1, 3),
            ),
            "joined",
        ),
        (
            lambda m: soup(
                m.vertices,
                np.where(np.arange(len(m.faces))[:, None] % 3, m.faces, m.faces[:, ::-1]),
            ),
            "turned over",
        ),
    ],
    ids=["repeated", "overhanging", "loose", "apart", "turned"],
)
def test_what_editors_leave_is_set_right_and_told(spoil, deed):
    found = solid(spoil(BALL), volume=BALL.volume, rel=1e-5)
    assert len(found.deeds) == 1
    assert deed in found.deeds[0]
    assert not found.wide


def test_holes_that_meet_in_a_corner_are_closed_each_for_itself():
    shared = np.isin(BALL.faces, BALL.faces[0]).sum(axis=1)
    gone = [0, int(np.flatnonzero(shared == 1)[0])]
    found = solid(
        without(BALL, np.isin(np.arange(len(BALL.faces)), gone)), volume=BALL.volume, rel=1e-9
    )
    assert found.deeds[0].startswith("2 holes closed")


@pytest.fixture(scope="module")
def holed(tmp_path_factory):
    captures = tmp_path_factory.mktemp("mend") / "captures"
    made = CliRunner().invoke(
        cli, ["phantoms", str(captures), "--count", "2", "--seed", "1", "--size", "64"]
    )
    assert made.exit_code == 0, made.output
    path = max(captures.glob("*/parts/*.ply"), key=lambda each: each.stat().st_size)
    mesh = trimesh.load(path, process=False)
    without(mesh, np.arange(len(mesh.faces)) == 0).export(path)
    return captures, path


def test_a_folder_with_a_hole_is_mended_beside_it_and_can_be_rebuilt_from(holed, tmp_path):
    captures, path = holed
    before, out = contents(captures), tmp_path / "mended"
    refused = CliRunner().invoke(cli, ["check", str(captures), "--workers", "1"])
    assert "not closed: 3 open edges; `xden-build mend`" in refused.output
    answer = CliRunner().invoke(cli, ["mend", str(captures), "--out", str(out), "--workers", "1"])
    assert answer.exit_code == 0, answer.output
    assert "1 objects mended, 1 sound, 0 failed" in answer.output
    assert contents(captures) == before
    with (out / "mended.csv").open() as file:
        (row,) = csv.DictReader(file)
    object_id = path.parts[-3]
    assert (row["object_id"], row["part"]) == (object_id, path.stem)
    assert row["done"].startswith("1 hole closed")
    assert {part.name for part in CaptureFolder(captures, out).read(object_id).parts} == {
        each.stem for each in path.parent.glob("*.ply")
    }
    again = CliRunner().invoke(cli, ["mend", str(captures), "--out", str(out)])
    assert (again.exit_code, "empty or does not exist" in again.output) == (1, True)


def test_an_object_that_cannot_be_mended_is_named_and_the_others_go_on(holed, tmp_path):
    captures, path = holed
    damaged, sound = path.read_bytes(), tmp_path / "mended"
    path.write_bytes(damaged[: len(damaged) // 2])
    try:
        answer = CliRunner().invoke(
            cli, ["mend", str(captures), "--out", str(sound), "--workers", "1"]
        )
    finally:
        path.write_bytes(damaged)
    assert answer.exit_code == 3
    assert f"failed: {path.parts[-3]}: {path}" in answer.output
    assert not (sound / path.parts[-3]).exists()
    assert len(list(sound.glob("*/parts"))) == 1
