"""What is written stays closed, its names can be held, and its place is its own."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from tests import phantoms
from xden1k.access.hub import SAMPLE
from xden1k.errors import DataError
from xden1k.export import export
from xden1k.export.closed import closed_mesh
from xden1k.export.hulls import convex_shapes
from xden1k.export.names import LONGEST, file_name, written_names
from xden1k.export.place import RECORD, in_place
from xden1k.folder import open_folder
from xden1k.values.closed import edge_faults

SLIVERS = ("ballpoint_pen-0001", "power_drill-0000")
"""Objects of which `trimesh.load` finds parts that are not watertight."""


def boxes(*bounds: list[list[float]]) -> trimesh.Trimesh:
    made = [trimesh.creation.box(bounds=one) for one in bounds]
    both = trimesh.util.concatenate(made)
    return trimesh.Trimesh(both.vertices, both.faces, process=False)


def as_read(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """By the defaults of trimesh: vertices are merged."""
    return trimesh.Trimesh(np.array(mesh.vertices), np.array(mesh.faces))


TOUCHING = {
    "an edge": boxes([[0, 0, 0], [1, 1, 1]], [[1, 1, 0], [2, 2, 1]]),
    "a corner": boxes([[0, 0, 0], [1, 1, 1]], [[1, 1, 1], [2, 2, 2]]),
    "a face": boxes([[0, 0, 0], [1, 1, 1]], [[1, 0, 0], [2, 1, 1]]),
    "an edge of three": boxes(
        [[0, 0, 0], [1, 1, 1]], [[1, 1, 0], [2, 2, 1]], [[1, 0, 1], [2, 1, 2]]
    ),
    "nearly": boxes([[0, 0, 0], [1, 1, 1]], [[1 + 3e-9, 1, 0], [2, 2, 1]]),
}


@pytest.mark.parametrize("single", [False, True])
@pytest.mark.parametrize("where", TOUCHING)
def test_solids_that_touch_are_drawn_apart(where: str, single: bool) -> None:
    mesh = TOUCHING[where]
    read = as_read(closed_mesh(mesh, single=single))
    assert read.is_watertight
    assert read.is_winding_consistent
    assert read.volume == pytest.approx(mesh.volume, rel=2e-6)
    np.testing.assert_allclose(read.center_mass, mesh.center_mass, atol=2e-6)


def test_a_sliver_that_merging_folds_vanishes() -> None:
    box = trimesh.creation.box((1, 1, 1))
    cut = box.vertices[box.faces[0]].mean(axis=0)
    near = cut + 4e-9 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    a, b, c = box.faces[0]
    ring = [[a, b, 9], [b, c, 10], [c, a, 8], [a, 9, 8], [b, 10, 9], [c, 8, 10], [8, 9, 10]]
    mesh = trimesh.Trimesh([*box.vertices, *near], [*box.faces[1:], *ring], process=False)
    assert edge_faults(mesh.faces) == (0, 0)
    assert mesh.is_watertight
    assert not as_read(mesh).is_watertight
    assert as_read(closed_mesh(mesh)).is_watertight


def test_a_sound_mesh_is_written_as_it_is() -> None:
    ball = trimesh.creation.icosphere(subdivisions=2)
    kept = closed_mesh(ball)
    assert len(kept.faces) == len(ball.faces)
    assert set(map(tuple, kept.vertices)) == set(map(tuple, ball.vertices))


def test_the_samples_slivers_are_closed_in_both_units() -> None:
    folder, opened = open_folder(SAMPLE), 0
    for object_id in SLIVERS:
        for part in folder.object(object_id).parts:
            opened += not as_read(part.mesh).is_watertight
            for factor, single in ((0.01, False), (1.0, True)):
                vertices = np.asarray(part.mesh.vertices) * factor
                mesh = trimesh.Trimesh(vertices, part.mesh.faces, process=False)
                read = as_read(closed_mesh(mesh, single=single))
                assert read.is_watertight
                assert read.volume == pytest.approx(float(mesh.volume), rel=1e-6)
    assert opened > 3  # else this shows nothing


def test_hulls_are_closed_where_qhull_leaves_a_hole() -> None:
    scissors = open_folder(SAMPLE).object("scissors-0001")
    (handle,) = [part.mesh for part in scissors.parts if part.name == "lower_handle"]
    solid = trimesh.Trimesh(np.asarray(handle.vertices) / 100, handle.faces, process=False)
    assert edge_faults(solid.convex_hull.faces).open  # else this shows nothing
    (hull,) = convex_shapes(solid, 1)
    assert as_read(hull).is_watertight
    assert hull.volume == pytest.approx(float(solid.convex_hull.volume), rel=1e-6)


def test_what_is_told_apart_is_told_apart_in_single_precision() -> None:
    folder = open_folder(SAMPLE)
    for part in folder.object("thermos-0001").parts:
        vertices = np.asarray(part.mesh.vertices) / 100
        mesh = closed_mesh(trimesh.Trimesh(vertices, part.mesh.faces, process=False))
        single = mesh.vertices.astype(np.float32)
        assert len(np.unique(single, axis=0)) == len(single)


def test_an_open_mesh_is_refused() -> None:
    box = trimesh.creation.box((1, 1, 1))
    with pytest.raises(DataError, match=r"got 11 triangles with 3 open and 0 twisted edges"):
        closed_mesh(trimesh.Trimesh(box.vertices, box.faces[1:], process=False))
    with pytest.raises(DataError, match=r"got 0 triangles"):
        closed_mesh(trimesh.Trimesh())


@given(st.lists(st.text(max_size=80), max_size=12))
def test_names_are_identifiers_and_unique_whatever_the_case(names: list[str]) -> None:
    written = written_names(names)
    assert len({name.lower() for name in written}) == len(names)
    assert all(name.isascii() and name.isidentifier() and name[0] != "_" for name in written)
    assert all(len(name) <= LONGEST + 5 for name in written)


@given(st.text(min_size=1, max_size=80))
def test_files_stay_in_their_folder(object_id: str) -> None:
    name = file_name(object_id)
    assert Path("out", name).resolve().parent == Path("out").resolve()
    assert name.isascii()


@pytest.mark.parametrize("name", ["world", "AUX", "com1", "NUL"])
def test_reserved_names_are_mapped(name: str) -> None:
    assert written_names([name]) == [f"n_{name}"]
    assert file_name(name) == f"n_{name}"


def test_a_name_that_is_mapped_is_kept_beside(tmp_path: Path) -> None:
    names = ("left half", "left/half", "Körper", "2nd")
    parts = [
        phantoms.Box(name, (2.0 * k, 0, 0), (2.0 * k + 1, 3, 3)) for k, name in enumerate(names)
    ]
    obj = phantoms.box_object("a b/ü", parts)
    path = export(obj, "urdf", tmp_path)
    record = json.loads((path.parent / RECORD).read_text(encoding="utf-8"))
    written = ["left_half", "left_half_2", "Korper", "n_2nd"]
    assert path == tmp_path / "a_b_u" / "a_b_u.urdf"
    assert (record["object_id"], record["written_as"]) == ("a b/ü", "a_b_u")
    assert [one["name"] for one in record["parts"]] == list(names)
    assert [one["written_as"] for one in record["parts"]] == written
    assert {file.name for file in (path.parent / "meshes").iterdir()} == {
        f"{name}{kind}.obj" for name in written for kind in ("", ".hull0")
    }


def test_a_failure_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError), in_place(tmp_path / "a", "mjcf", "a") as folder:  # noqa: PT012
        (folder / "half").write_text("x")
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []


def test_an_earlier_export_is_replaced_and_nothing_else(tmp_path: Path) -> None:
    bar, cube = phantoms.objects()[1], phantoms.box_object("bar-0002", phantoms.CUBE)
    path = export(bar, "mjcf", tmp_path)
    before = {file.name for file in (path.parent / "meshes").iterdir()}
    export(cube, "mjcf", tmp_path)
    assert (
        {file.name for file in (path.parent / "meshes").iterdir()}
        == {
            "cube.obj",
            "cube.hull0.obj",
        }
        != before
    )
    with pytest.raises(DataError, match=r"an earlier urdf export of bar-0002, got a folder that"):
        export(bar, "urdf", tmp_path)
    (path.parent / "notes.txt").write_text("mine")
    with pytest.raises(DataError, match=r"bar-0002: expected a new .* that holds notes.txt"):
        export(bar, "mjcf", tmp_path)
    assert (path.parent / "notes.txt").read_text() == "mine"
    (tmp_path / "cube-0001").write_text("a file")
    with pytest.raises(DataError, match=r"cube-0001: expected a folder, got a file"):
        export(phantoms.objects()[2], "mjcf", tmp_path)


def test_ids_that_are_written_alike_do_not_replace_each_other(tmp_path: Path) -> None:
    export(phantoms.box_object("a b", phantoms.CUBE), "obj", tmp_path)
    with pytest.raises(DataError, match=r"earlier obj export of a/b, got a folder that holds"):
        export(phantoms.box_object("a/b", phantoms.CUBE), "obj", tmp_path)
