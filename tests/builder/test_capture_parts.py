"""Part meshes: every format and unit, what is no solid, and what parts.csv says."""

import json
import re
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from xden1k.errors import DataError
from xden1k.values.ply import CM_PER_UNIT
from xden_builder.capture.meshes import read_meshes
from xden_builder.capture.parts import CapturePart, read_parts
from xden_builder.capture.solids import closed_mesh, simplified

turn = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3], [0.3, 0, 0])


def box(extents: tuple[float, float, float] = (2, 3, 4), at: float = 0.0) -> trimesh.Trimesh:
    mesh = trimesh.creation.box(extents)
    return mesh.apply_translation([at, 0, 0])


def turned_inside_out(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices, mesh.faces[:, ::-1], process=False)


def together(*meshes: trimesh.Trimesh) -> trimesh.Trimesh:
    return trimesh.util.concatenate(meshes)


def read(
    folder: Path, units: str = "cm", strict: bool = True
) -> tuple[dict[str, CapturePart], tuple[str, ...]]:
    parts, flags = read_parts(folder, folder / "parts.csv", units, strict)
    return {part.name: part for part in parts}, flags


def write_part(folder: Path, mesh: trimesh.Trimesh, name: str = "body.ply") -> Path:
    (folder / "parts").mkdir(exist_ok=True)
    mesh.export(folder / "parts" / name)
    return folder


def write_scene(folder: Path, scene: trimesh.Scene) -> None:
    (folder / "mesh.glb").write_bytes(scene.export(file_type="glb"))


@pytest.mark.parametrize("suffix", [".ply", ".stl", ".obj", ".glb", ".STL"])
def test_every_format_comes_back_closed_with_merged_vertices(tmp_path: Path, suffix: str) -> None:
    mesh = trimesh.creation.icosphere(2, 3.0).apply_transform(turn)
    (tmp_path / "parts").mkdir()
    path = tmp_path / "parts" / f"ball{suffix}"
    path.write_bytes(_bytes(mesh.export(file_type=suffix[1:].lower())))
    parts, flags = read(tmp_path)
    ball = parts["ball"].mesh
    assert flags == ()
    assert len(ball.vertices) == len(mesh.vertices)
    assert ball.is_watertight
    assert ball.volume == pytest.approx(mesh.volume, rel=1e-5)
    np.testing.assert_allclose(ball.bounds, mesh.bounds, atol=1e-5)


def _bytes(exported: str | bytes) -> bytes:
    return exported.encode() if isinstance(exported, str) else exported


def test_normals_and_texture_seams_do_not_open_a_mesh(tmp_path: Path) -> None:
    flat_shaded = box()
    flat_shaded.unmerge_vertices()
    flat_shaded.visual = trimesh.visual.TextureVisuals(
        uv=np.random.default_rng(0).random((len(flat_shaded.vertices), 2))
    )
    for name in ("a.obj", "b.ply", "c.glb"):
        write_part(tmp_path, flat_shaded, name)
    parts, _ = read(tmp_path)
    assert [len(part.mesh.vertices) for part in parts.values()] == [8, 8, 8]


@given(unit=st.sampled_from(sorted(CM_PER_UNIT)), size_cm=st.floats(0.2, 400))
def test_a_mesh_is_the_same_in_every_unit(unit: str, size_cm: float) -> None:
    stored = box((size_cm / CM_PER_UNIT[unit],) * 3)
    solid, inverted = closed_mesh(stored, CM_PER_UNIT[unit], "here")
    assert solid.volume == pytest.approx(size_cm**3)
    assert not inverted


def test_scene_nodes_are_parts_with_their_transforms(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    shift = trimesh.transformations.translation_matrix([10, 0, 0])
    scene.add_geometry(box(), node_name="handle", geom_name="g", transform=shift)
    scene.add_geometry(
        box((1, 1, 1)), node_name="screw", parent_node_name="handle", transform=shift
    )
    scene.add_geometry(box(), node_name="tip", geom_name="g", transform=turn)
    write_scene(tmp_path, scene)
    parts, _ = read(tmp_path, "mm")
    assert list(parts) == ["handle", "screw", "tip"]
    np.testing.assert_allclose(parts["handle"].mesh.bounds, [[0.9, -0.15, -0.2], [1.1, 0.15, 0.2]])
    np.testing.assert_allclose(parts["screw"].mesh.centroid, [2, 0, 0], atol=1e-7)
    np.testing.assert_allclose(
        parts["tip"].mesh.bounds, box().apply_transform(turn).bounds / 10, atol=1e-7
    )


def test_a_mirrored_node_keeps_its_solid_outwards(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    scene.add_geometry(box(at=5), node_name="left", transform=np.diag([-1.0, 1, 1, 1]))
    write_scene(tmp_path, scene)
    parts, flags = read(tmp_path)
    assert flags == ()
    assert parts["left"].mesh.bounds[0, 0] == pytest.approx(-6)


def rewrite_scene(path: Path, change: str) -> None:
    """Edit the JSON of a binary glTF file."""
    data = path.read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    scene = json.loads(data[20 : 20 + length])
    if change == "two materials":
        scene["meshes"][0]["primitives"] += scene["meshes"][1]["primitives"]
        scene["nodes"] = [node for node in scene["nodes"] if node.get("name") != "b"]
        scene["scenes"][0]["nodes"] = [0]
    for node in scene["nodes"]:
        if change == "no names":
            node.pop("name", None)
        elif change == "one name":
            node["name"] = "a"
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    head = struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A)
    path.write_bytes(head + text + rest)


def test_a_node_of_several_materials_is_one_part(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    scene.add_geometry(box(), node_name="a")
    scene.add_geometry(box(at=10), node_name="b")
    write_scene(tmp_path, scene)
    rewrite_scene(tmp_path / "mesh.glb", "two materials")
    parts, _ = read(tmp_path)
    assert list(parts) == ["a"]
    assert parts["a"].mesh.volume == pytest.approx(48)


@pytest.mark.parametrize("change", ["no names", "one name"])
def test_scene_nodes_need_names_of_their_own(tmp_path: Path, change: str) -> None:
    scene = trimesh.Scene()
    scene.add_geometry(box(), node_name="a")
    scene.add_geometry(box(at=10), node_name="b")
    write_scene(tmp_path, scene)
    rewrite_scene(tmp_path / "mesh.glb", change)
    with pytest.raises(DataError, match=r"mesh\.glb: expected a name of its own at each node"):
        read_meshes(tmp_path)


def test_an_inside_out_mesh_is_set_right_and_flagged(tmp_path: Path) -> None:
    write_part(tmp_path, box(), "good.stl")
    write_part(tmp_path, turned_inside_out(box(at=9)), "shell.stl")
    parts, flags = read(tmp_path)
    assert flags == ("shell:mesh_inverted",)
    assert parts["shell"].mesh.volume == pytest.approx(24)
    assert (parts["shell"].mesh.face_normals @ [1, 0, 0] > 0.9).sum() == 2


def test_a_cavity_is_a_piece_wound_inwards(tmp_path: Path) -> None:
    hollow = together(box((4, 4, 4)), turned_inside_out(box((2, 2, 2))))
    solid, inverted = closed_mesh(hollow, 1.0, "here")
    assert solid.volume == pytest.approx(56)
    assert not inverted
    solid, inverted = closed_mesh(turned_inside_out(hollow), 1.0, "here")
    assert solid.volume == pytest.approx(56)
    assert inverted


def test_a_solid_in_a_cavity_and_solids_side_by_side_are_fine() -> None:
    nested = together(
        box((6, 6, 6)), turned_inside_out(box((4, 4, 4))), box((2, 2, 2)), box((2, 2, 2), at=20)
    )
    assert closed_mesh(nested, 1.0, "here")[0].volume == pytest.approx(216 - 64 + 16)


def test_a_cavity_most_of_whose_corners_lie_on_the_surface_is_one() -> None:
    top = np.nextafter(2, 3)  # as a cut leaves it
    corners = np.array([[-1, -0.5, top], [1, -0.6, top], [0.2, 1, top], [0, 0, 0]])
    inwards = [[1, 0, 2], [0, 1, 3], [3, 1, 2], [3, 2, 0]]
    pocket = trimesh.Trimesh(corners, inwards, process=False)
    solid, _ = closed_mesh(together(box((4, 4, 4)), pocket), 1.0, "here")
    assert solid.volume == pytest.approx(64 + pocket.volume)


def test_a_sliver_without_area_is_no_piece() -> None:
    cube = box()
    line = cube.vertices[0] + np.outer([0.1, 0.2, 0.3], [0.3, 0.1, 0.2]) * 1.1
    sliver = trimesh.Trimesh(line, [[0, 1, 2], [2, 1, 0]], process=False)
    solid, _ = closed_mesh(together(cube, sliver), 1.0, "here")
    assert solid.volume == pytest.approx(24)


def test_a_shell_so_thin_that_its_large_faces_cut_through_it_is_one() -> None:
    outer = trimesh.creation.icosphere(subdivisions=2, radius=2.0)
    inner = trimesh.creation.icosphere(subdivisions=4, radius=1.97)
    solid, _ = closed_mesh(together(outer, turned_inside_out(inner)), 1.0, "here")
    assert solid.volume == pytest.approx(outer.volume - inner.volume)


def test_pieces_that_touch_are_fine() -> None:
    touching = together(box((2, 2, 2)), box((2, 1, 1), at=2))
    assert closed_mesh(touching, 1.0, "here")[0].volume == pytest.approx(10)
    along_an_edge = together(box((2, 2, 2)), box((2, 2, 2)).apply_translation([2, 2, 0]))
    assert closed_mesh(along_an_edge, 1.0, "here")[0].volume == pytest.approx(16)


def test_faces_without_area_and_unused_vertices_are_dropped() -> None:
    cube = box()
    vertices = np.vstack([cube.vertices, [[99, 99, 99]]])
    faces = np.vstack([cube.faces, [[0, 0, 1]]])
    solid, _ = closed_mesh(trimesh.Trimesh(vertices, faces, process=False), 1.0, "here")
    assert (len(solid.vertices), len(solid.faces)) == (8, 12)


def without_faces(mesh: trimesh.Trimesh, count: int) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices, mesh.faces[count:], process=False)


def one_face_turned(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    faces = mesh.faces.copy()
    faces[0] = faces[0, ::-1]
    return trimesh.Trimesh(mesh.vertices, faces, process=False)


def with_nan(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    vertices = mesh.vertices.copy()
    vertices[0, 0] = np.nan
    return trimesh.Trimesh(vertices, mesh.faces, process=False)


sheet = together(box((1, 1, 0)), box((1, 1, 0)))


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        (without_faces(box(), 1), "the mesh is not closed: 3 open edges"),
        (without_faces(box(), 12), "the mesh has no triangles"),
        (one_face_turned(box()), "triangles are wound against each other at 3 edges: expected all"),
        (with_nan(box()), "the mesh has vertices that are not finite"),
        (box((1, 1, 0)), "the mesh encloses no volume"),
        (box(at=1e20), "a vertex is 1e+20 cm from the origin: check mesh_units"),
        (together(box(), turned_inside_out(box(at=9))), "the mesh encloses no volume"),
        (
            together(box(), turned_inside_out(box((1, 1, 1), at=9))),
            "one of the mesh's 2 closed pieces, at [9.5, 0.5, 0.5] cm, is wound wrongly",
        ),
        (together(box((9, 9, 9)), box((1, 1, 1))), "wound wrongly: expected outwards for a solid"),
    ],
)
def test_what_is_no_solid_is_refused(mesh: trimesh.Trimesh, message: str) -> None:
    with pytest.raises(
        DataError,
        match="^here: .*"
        + re.escape(message).replace("0\\.5", r"-?0\.5").replace("9\\.5", r"[89]\.5"),
    ):
        closed_mesh(mesh, 1.0, "here")


def test_an_open_part_is_named_with_its_file(tmp_path: Path) -> None:
    write_part(tmp_path, without_faces(box(), 2))
    with pytest.raises(
        DataError, match=r"parts/body\.ply, part body: the mesh is not closed: 4 open edges"
    ):
        read(tmp_path)


@pytest.mark.parametrize(
    ("extent", "unit", "is_wrong"),
    [
        (500.0, "cm", False),
        (501.0, "cm", True),
        (0.1, "cm", False),
        (0.09, "cm", True),
        (60.0, "m", True),
        (0.2, "mm", True),
        (2.6, "mm", False),
    ],
)
def test_a_wrong_unit_shows_in_the_largest_extent(
    tmp_path: Path, extent: float, unit: str, is_wrong: bool
) -> None:
    write_part(tmp_path, box((extent, extent / 30, extent / 30)), "body.obj")
    if not is_wrong:
        read(tmp_path, unit)
        return
    with pytest.raises(
        DataError, match=rf"with mesh_units {unit} the largest .* cm, expected 0\.1 to 500 cm"
    ):
        read(tmp_path, unit)


def test_the_extent_is_the_object_s_not_a_part_s(tmp_path: Path) -> None:
    write_part(tmp_path, box((0.05, 0.05, 0.05)), "a.ply")
    write_part(tmp_path, box((0.05, 0.05, 0.05), at=1), "b.ply")
    assert len(read(tmp_path)[0]) == 2


def test_parts_csv_arrives(tmp_path: Path) -> None:
    for name in ("blade", "handle", "pin"):
        write_part(tmp_path, box(), f"{name}.ply")
    (tmp_path / "parts.csv").write_text(
        "name,material,priority,hollow\nhandle,Polypropylene,-1,yes\nblade,METAL,,no\n"
    )
    parts, _ = read(tmp_path)
    told = [(p.name, p.material, p.priority, p.hollow) for p in parts.values()]
    assert told == [
        ("blade", "metal", None, False),
        ("handle", "pp", -1, True),
        ("pin", "", None, False),
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "name,material\nbody,unobtainium",
            r"row 2, material: unknown material 'unobtainium': exp",
        ),
        (
            "name,priority\nbody,1.5",
            r"row 2, priority: must be a whole number or empty, got '1\.5'",
        ),
        ("name,priority\nbody,--1", r"row 2, priority: must be a whole number or empty, got '--1'"),
        ("name,hollow\nbody,true", r"row 2, hollow: must be one of yes, no, got 'true'"),
        ("name\nbody\n\nboddy", r"row 4, name: no mesh of that name; meshes are body"),
        ("name\nbody\nbody", r"row 3, name: 'body' stands in row 2 too"),
        ("name,density\nbody,1", r"unknown column 'density'; columns are name, material, priority"),
        ("material\niron", r"column name is missing"),
    ],
)
def test_a_wrong_parts_csv_is_named(tmp_path: Path, text: str, message: str) -> None:
    write_part(tmp_path, box())
    (tmp_path / "parts.csv").write_text(text)
    with pytest.raises(DataError, match=r"parts\.csv: " + message):
        read(tmp_path)


def test_every_wrong_row_of_a_parts_csv_is_told(tmp_path: Path) -> None:
    for name in ("body.ply", "a_lid.ply", "spout.ply"):
        write_part(tmp_path, box(), name)
    (tmp_path / "parts.csv").write_text("name,material\nspout,Stahl\nbody,pp\na_lid,n/a\nlid,pp\n")
    with pytest.raises(DataError, match=r"row 2, material: .*'Stahl'.*too: row 4, 5$"):
        read(tmp_path)


def test_an_umlaut_of_a_file_of_macos_is_that_of_the_table(tmp_path: Path) -> None:
    write_part(tmp_path, box(), "ko\u0308rper.ply")
    (tmp_path / "parts.csv").write_text("name,material\nk\u00f6rper,iron", encoding="utf-8")
    parts, _ = read(tmp_path)
    assert {name: part.material for name, part in parts.items()} == {"k\u00f6rper": "iron"}


def test_two_files_whose_names_differ_in_how_an_umlaut_is_told_are_one_part_too_many(
    tmp_path: Path,
) -> None:
    write_part(tmp_path, box(), "ko\u0308rper.ply")
    write_part(tmp_path, box(at=9.0), "k\u00f6rper.ply")
    if len(list((tmp_path / "parts").iterdir())) == 1:
        return  # a file system that takes both for one
    with pytest.raises(DataError, match=r"is a part of the same name"):
        read_meshes(tmp_path)


def test_a_table_of_other_meshes_may_name_absent_ones(tmp_path: Path) -> None:
    write_part(tmp_path, box())
    (tmp_path / "parts.csv").write_text("name,material\nlost,iron\nbody,iron")
    parts, _ = read(tmp_path, strict=False)
    assert [part.material for part in parts.values()] == ["iron"]


def test_other_files_in_parts_are_ignored(tmp_path: Path) -> None:
    write_part(tmp_path, box())
    for name in ("README.md", "body.mtl", "._body.ply", "wood.png"):
        (tmp_path / "parts" / name).write_text("not a mesh")
    assert list(read(tmp_path)[0]) == ["body"]


def test_no_mesh_both_forms_two_of_one_name_and_other_formats_are_errors(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"no mesh: expected parts/NAME\.ply, stl, obj or glb, or"):
        read_meshes(tmp_path)
    write_part(tmp_path, box())
    write_part(tmp_path, box(), "body.stl")
    with pytest.raises(DataError, match=r"body\.stl: body\.ply is a part of the same name"):
        read_meshes(tmp_path)
    (tmp_path / "parts" / "body.stl").rename(tmp_path / "parts" / "body.step")
    with pytest.raises(
        DataError, match=r"body\.step: expected a mesh as \.ply, \.stl, \.obj, \.gl"
    ):
        read_meshes(tmp_path)
    write_scene(tmp_path, trimesh.Scene(box()))
    with pytest.raises(DataError, match=r"expected parts/ or mesh\.glb, got both"):
        read_meshes(tmp_path)


@settings(max_examples=150, deadline=None, derandomize=True)
@pytest.mark.filterwarnings("ignore")  # what the library remarks of damaged files is its own
@given(
    suffix=st.sampled_from(["ply", "stl", "obj", "glb"]),
    changes=st.dictionaries(st.integers(0, 9999), st.integers(0, 255), max_size=3),
    cut=st.none() | st.integers(0, 3000),
    as_scene=st.booleans(),
)
def test_damage_is_a_solid_or_one_error(
    tmp_path_factory: pytest.TempPathFactory,
    suffix: str,
    changes: dict[int, int],
    cut: int | None,
    as_scene: bool,
) -> None:
    content = bytearray(_bytes(box().export(file_type=suffix)))
    for place, value in changes.items():
        content[place % len(content)] = value
    folder = tmp_path_factory.mktemp("damaged")
    path = folder / "mesh.glb" if as_scene else folder / "parts" / f"body.{suffix}"
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(content[:cut])
    message = str(folder)
    try:
        read(folder)
    except DataError as err:
        message = str(err)
    assert str(folder) in message
    assert "\n" not in message


def test_weighed_objects_have_the_volume_of_their_mass(shared_data: Path) -> None:
    lines = (shared_data / "weighed" / "weighed.csv").read_text().splitlines()[1:]
    for line in lines:
        name, file, units, mass_g, density_g_cm3 = line.split(",")
        mesh = trimesh.load_mesh(shared_data / "weighed" / file, process=False)
        solid, inverted = closed_mesh(mesh, CM_PER_UNIT[units], name)
        assert not inverted
        assert solid.volume * float(density_g_cm3) == pytest.approx(float(mass_g), rel=1e-3), name


def test_a_rod_whose_sides_would_fall_together_stays_as_it_is() -> None:
    """Two sheets upon each other have no volume, and no middle."""
    rod = trimesh.creation.cylinder(0.25, 3.0, sections=32)
    assert simplified(rod, 0.25) is rod
