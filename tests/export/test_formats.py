"""Each format says of an object what the dataset says: mass, centre, inertia, shapes, units."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import re
from functools import cache
from pathlib import Path

import h5py
import mujoco
import nibabel
import numpy as np
import pytest
import trimesh
from pxr import Usd, UsdGeom, UsdPhysics

from tests import phantoms
from tests.phantoms import Box
from xden1k import cli
from xden1k.errors import DataError
from xden1k.export import FORMATS, export, export_stack, exported
from xden1k.export.body import body_of
from xden1k.export.check import compare
from xden1k.export.exporting import format_of
from xden1k.export.place import RECORD
from xden1k.export.si import Inertial
from xden1k.export.text import read_xml, write_xml
from xden1k.values.types import DensityObject

SIMULATORS = ("mjcf", "urdf", "sdf", "usd")
TEXT = {"mjcf": ".xml", "urdf": ".urdf", "sdf": ".sdf", "usd": ".usda"}
ASKEW = (
    Box("steel head", (3, -2, 4), (5, 6, 7), 7.85, material="steel"),
    Box("handle", (-20, 1, 5), (3, 3, 6), 0.7),
)
"""Away from the origin, products of inertia not zero."""


@cache
def askew() -> DensityObject:
    return phantoms.box_object("askew-0001", ASKEW, category="hammer")


@cache
def bar() -> DensityObject:
    return phantoms.objects()[1]


@cache
def boxes() -> tuple[DensityObject, ...]:
    return askew(), bar(), phantoms.box_object("hollow-0001", phantoms.HOLLOW)


def test_formats_are_those_of_the_command() -> None:
    assert cli.FORMATS == FORMATS


@pytest.mark.parametrize("name", FORMATS)
def test_what_is_read_back_is_the_object_to_a_millionth(name: str, tmp_path: Path) -> None:
    for obj in boxes()[: 1 if name == "hdf5" else None]:
        made = exported(obj, name, tmp_path, check=True)
        assert made.path.is_file()
        assert made.deviation.largest <= 1e-6


@pytest.mark.parametrize("name", FORMATS)
def test_the_same_object_gives_the_same_bytes(name: str, tmp_path: Path) -> None:
    found = []
    for place in ("one", "two"):
        folder = export(askew(), name, tmp_path / place).parent
        files = sorted(file for file in folder.rglob("*") if file.is_file())
        sums = [hashlib.sha256(file.read_bytes()).hexdigest() for file in files]
        found.append(dict(zip([file.name for file in files], sums, strict=True)))
    assert found[0] == found[1]


@pytest.mark.parametrize("name", SIMULATORS)
def test_simulators_get_si_and_no_scale(name: str, tmp_path: Path) -> None:
    path = export(askew(), name, tmp_path)
    assert "scale" not in path.read_text()
    inertial = format_of(name).read(path, body_of(askew()))
    obj = askew().mass_properties
    assert inertial.mass_kg == pytest.approx(1e-3 * obj.mass_g)
    np.testing.assert_allclose(inertial.com_m, 1e-2 * obj.com_cm, rtol=1e-6)
    np.testing.assert_allclose(inertial.inertia_kg_m2, 1e-7 * obj.inertia_g_cm2, rtol=1e-5)
    assert obj.mass_g == pytest.approx(phantoms.exact_mass_g(ASKEW))


@pytest.mark.parametrize("name", ["mjcf", "urdf", "sdf"])
def test_meshes_are_in_metres_and_closed_for_trimesh(name: str, tmp_path: Path) -> None:
    folder = export(askew(), name, tmp_path).parent
    head = trimesh.load_mesh(folder / "meshes" / "steel_head.obj")
    np.testing.assert_allclose(head.bounds, [[0.03, -0.02, 0.04], [0.05, 0.06, 0.07]])
    for file in (folder / "meshes").iterdir():
        assert trimesh.load_mesh(file).is_watertight


def test_collision_shapes_are_convex_apart_and_cover_the_part(tmp_path: Path) -> None:
    hollow = phantoms.box_object("hollow-0001", phantoms.HOLLOW)
    path = export(hollow, "mjcf", tmp_path)
    model = mujoco.MjModel.from_xml_path(str(path))
    seen, felt = model.geom("shell"), model.geom("shell.hull0")
    assert (seen.contype[0], seen.conaffinity[0], felt.contype[0]) == (0, 0, 1)
    hull = trimesh.load_mesh(path.parent / "meshes" / "shell.hull0.obj")
    assert hull.is_convex
    assert hull.volume == pytest.approx(64e-6)


def test_pieces_follow_a_shape_better_than_its_hull() -> None:
    corner = trimesh.util.concatenate(
        [box.mesh for box in (Box("", (0, 0, 0), (6, 1, 1)), Box("", (0, 1.0, 0), (1, 6, 1)))]
    )
    solid = trimesh.Trimesh(corner.vertices, corner.faces, process=False)
    part = dataclasses.replace(bar().parts[0], mesh=solid)
    obj = dataclasses.replace(bar(), parts=(part,), density=None)
    (shape,) = body_of(obj, pieces=4).shapes
    volume = sum(float(piece.volume) for piece in shape.collision)
    assert 1 < len(shape.collision) <= 4
    assert all(piece.is_convex for piece in shape.collision)
    assert volume < 0.8 * float(solid.convex_hull.volume) * 1e-6
    with pytest.raises(DataError, match="at least one piece, got 0"):
        body_of(obj, pieces=0)


# --- MJCF


def test_mjcf_is_one_free_body_that_no_setting_of_a_scene_reweighs(tmp_path: Path) -> None:
    path = export(askew(), "mjcf", tmp_path)
    model = mujoco.MjModel.from_xml_path(str(path))
    assert (model.nbody, model.njnt, model.jnt_type[0]) == (2, 1, mujoco.mjtJoint.mjJNT_FREE)
    assert "density" not in path.read_text()
    scene = tmp_path / "scene.xml"
    include = f'<include file="{path.relative_to(tmp_path)}"/>'
    for setting in ("auto", "false", "true"):  # a scene's word on where inertia comes from
        compiler = f'<compiler inertiafromgeom="{setting}" meshdir="askew-0001"/>'
        scene.write_text(f"<mujoco>{compiler}{include}</mujoco>")
        made = mujoco.MjModel.from_xml_path(str(scene))
        assert float(made.body("askew_0001").mass[0]) == pytest.approx(0.409)
        np.testing.assert_array_equal(made.body_inertia, model.body_inertia)


def test_mjcf_paints_each_part_in_its_colour(tmp_path: Path) -> None:
    red = dataclasses.replace(bar().parts[0], color_rgb=(1.0, 0.0, 0.25))
    obj = dataclasses.replace(bar(), parts=(red, bar().parts[1]))
    model = mujoco.MjModel.from_xml_path(str(export(obj, "mjcf", tmp_path)))
    np.testing.assert_allclose(model.mat("plastic").rgba, [1, 0, 0.25, 1])


# --- URDF


def test_urdf_keeps_its_mass_in_mujoco_and_can_be_freed(tmp_path: Path) -> None:
    path = export(askew(), "urdf", tmp_path)
    model = mujoco.MjModel.from_xml_path(str(path))
    assert float(model.body("askew_0001").mass[0]) == pytest.approx(1e-3 * askew().mass_g)
    fused = tmp_path / "askew-0001" / "fused.urdf"
    text = path.read_text()
    fused.write_text(text.replace('fusestatic="false"', 'fusestatic="true"'))
    # what the element is there for (mujoco issue 1176): welded into the world, the mass is gone
    assert mujoco.MjModel.from_xml_path(str(fused)).body_mass.sum() == 0
    spec = mujoco.MjSpec.from_file(str(path))
    spec.body("askew_0001").add_freejoint()
    freed = spec.compile()
    assert freed.nv == 6
    assert float(freed.body("askew_0001").mass[0]) == pytest.approx(1e-3 * askew().mass_g)


# --- SDF


def test_sdf_puts_the_inertial_at_the_centre_of_mass(tmp_path: Path) -> None:
    path = export(askew(), "sdf", tmp_path)
    text = path.read_text()
    pose = re.search(r"<inertial>\s*<pose>([^<]*)</pose>", text)
    assert pose is not None
    values = np.array(pose[1].split(), dtype=float)
    np.testing.assert_allclose(values, [*(1e-2 * askew().com_cm), 0, 0, 0])
    assert '<sdf version="1.9">' in text
    assert "askew-0001.sdf" in (path.parent / "model.config").read_text()


# --- USD


def test_usd_has_units_and_a_right_handed_frame(tmp_path: Path) -> None:
    stage = Usd.Stage.Open(str(export(askew(), "usd", tmp_path)))
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1
    assert UsdPhysics.GetStageKilogramsPerUnit(stage) == 1
    root = stage.GetDefaultPrim()
    massive = [prim.GetPath() for prim in stage.Traverse() if prim.HasAPI(UsdPhysics.MassAPI)]
    assert massive == [root.GetPath()]
    api = UsdPhysics.MassAPI(root)
    assert not api.GetDensityAttr().HasAuthoredValue()
    moments, axes = body_of(askew()).inertial.principal()
    assert np.linalg.det(axes) == pytest.approx(1)
    np.testing.assert_allclose(api.GetDiagonalInertiaAttr().Get(), moments, rtol=1e-6)
    assert api.GetPrincipalAxesAttr().Get().GetLength() == pytest.approx(1, abs=1e-6)


def test_usds_validators_find_moments_without_axes(tmp_path: Path) -> None:
    path = export(askew(), "usd", tmp_path)
    lines = [line for line in path.read_text().splitlines() if "principalAxes" not in line]
    path.write_text("\n".join(lines))
    with pytest.raises(DataError, match=r"askew-0001\.usda: .*[Pp]rincipal"):
        format_of("usd").check(path, body_of(askew()))


@pytest.mark.parametrize("wrong", ["metersPerUnit", "kilogramsPerUnit"])
def test_other_units_are_not_taken_for_ours(wrong: str, tmp_path: Path) -> None:
    path = export(askew(), "usd", tmp_path)
    path.write_text(path.read_text().replace(f"{wrong} = 1", f"{wrong} = 0.01"))
    with pytest.raises(DataError, match="expected metersPerUnit and kilogramsPerUnit 1"):
        format_of("usd").read(path, body_of(askew()))


# --- meshes and voxels


def test_glb_has_a_named_node_and_material_for_each_part(tmp_path: Path) -> None:
    path = export(askew(), "glb", tmp_path)
    scene = trimesh.load_scene(path)
    assert set(scene.graph.nodes_geometry) == {"steel head", "handle"}
    assert scene.geometry["steel head"].visual.material.name == "steel head"
    assert scene.extents[1] == pytest.approx(0.03)  # y is up: the object's z
    chunk = path.read_bytes()[20:]
    length = int.from_bytes(path.read_bytes()[12:16], "little")
    nodes = {node["name"]: node for node in json.loads(chunk[:length])["nodes"]}
    assert nodes["steel head"]["extras"]["density_g_cm3"] == 7.85


def test_obj_has_an_object_and_a_material_for_each_part(tmp_path: Path) -> None:
    path = export(askew(), "obj", tmp_path)
    assert re.findall(r"^o (.*)$", path.read_text(), re.MULTILINE) == ["steel_head", "handle"]
    assert "newmtl steel_head" in path.with_suffix(".mtl").read_text()
    assert set(trimesh.load_scene(path).geometry) == {"steel_head", "handle"}


def test_nifti_puts_every_voxel_where_it_is_in_mm(tmp_path: Path) -> None:
    path = export(askew(), "nifti", tmp_path)
    obj, image = askew(), nibabel.load(path)
    labels = nibabel.load(path.with_name("askew-0001.labels.nii.gz"))
    assert image.header.get_xyzt_units()[0] == "mm"
    np.testing.assert_allclose(image.affine[:3, 3], 10 * obj.origin_cm, rtol=1e-6)
    for point in ([3.5, 0.0, 5.0], [-10.0, 2.0, 5.5], [-10.0, -1.0, 5.5]):
        place = np.linalg.inv(labels.affine) @ [*(10 * np.array(point)), 1]
        corners = (box.mesh.bounds for box in ASKEW)
        inside = [((low < point) & (point < high)).all() for low, high in corners]
        expected = inside.index(True) + 1 if any(inside) else 0
        assert np.asarray(labels.dataobj)[tuple(np.rint(place[:3]).astype(int))] == expected
    assert image.get_data_dtype() == np.float32


def test_vti_has_voxel_means_as_cells(tmp_path: Path) -> None:
    path = export(askew(), "vti", tmp_path)
    text, obj = path.read_text(), askew()
    assert 'WholeExtent="0 64 0 64 0 64"' in text
    origin = re.search(r'Origin="([^"]*)"', text)
    corner = obj.origin_cm - obj.voxel_size_cm / 2
    np.testing.assert_allclose(np.array(origin[1].split(), dtype=float), corner)
    assert "PointData" not in text
    labels = path.with_name("askew-0001.labels.vti").read_text()
    origin = re.search(r'Origin="([^"]*)"', labels)
    np.testing.assert_allclose(np.array(origin[1].split(), dtype=float), corner)


def test_npz_has_the_datasets_columns(tmp_path: Path) -> None:
    with np.load(export(askew(), "npz", tmp_path)) as file:
        assert file["part_names"].tolist() == ["steel head", "handle"]
        assert float(file["mass_g"]) == pytest.approx(askew().mass_g)
        assert file["density"].shape == (64, 64, 64)
        assert np.isnan(file["weighed_mass_g"])
        assert json.loads(str(file["part_flags"])) == [[], []]


def test_hdf5_stacks_what_datasets_reads(tmp_path: Path) -> None:
    objects = [askew(), bar()]
    made = export_stack(iter(objects), tmp_path, check=True)
    assert {one.object_id for one in made} == {"askew-0001", "bar-0002"}
    (path,) = {one.path for one in made}
    with h5py.File(path) as file:
        assert {column.shape[0] for column in file.values()} == {2}
        assert file["density"].shape == (2, 64, 64, 64)
        assert file["object_id"].asstr()[:].tolist() == ["askew-0001", "bar-0002"]
        assert json.loads(file["part_names"].asstr()[0]) == ["steel head", "handle"]
        assert file["mesh_vertices"][1].reshape(-1, 3).shape[1] == 3


def test_hdf5_refuses_what_cannot_be_stacked(tmp_path: Path) -> None:
    odd = phantoms.box_object("odd-0001", phantoms.CUBE, shape=(10, 12))
    with pytest.raises(DataError, match=r"odd-0001: its xray_pa has shape \(10, 12\), those befo"):
        export_stack([bar(), odd], tmp_path)
    with pytest.raises(DataError, match=r"objects\.h5: expected at least one object"):
        export_stack([], tmp_path)
    assert list(tmp_path.iterdir()) == []


# --- our own check


@pytest.mark.parametrize("name", FORMATS)
def test_a_file_that_says_something_else_is_not_put_in_place(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = format_of(name)
    true = module.expected(body_of(bar()))
    wrong = dataclasses.replace(true, mass_kg=true.mass_kg * (1 + 3e-5))
    monkeypatch.setattr(module, "read", lambda *_: wrong)
    with pytest.raises(DataError, match=r"mass, centre and inertia are off by 3\.0e-05, 0"):
        export(bar(), name, tmp_path)
    assert list(tmp_path.iterdir()) == []


def inertial(**changes: object) -> Inertial:
    sound = {"mass_kg": 1.0, "com_m": np.zeros(3), "inertia_kg_m2": np.diag([1.0, 1.5, 2.0])}
    return Inertial(**sound | changes)


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (inertial(mass_kg=0.0), "no mass"),
        (inertial(com_m=np.full(3, np.nan)), "no number"),
        (inertial(com_m=np.array([1e-4, 0, 0])), "off by 0.0e"),
        (inertial(inertia_kg_m2=np.diag([1.0, 1.5, 2.0]) + np.eye(3, k=1)), "not symmetric"),
        (inertial(inertia_kg_m2=np.diag([1.0, 1.5, 2.6])), "no body has the principal moments"),
        (inertial(inertia_kg_m2=np.diag([-1.0, 1.5, 2.0])), "no body has the principal moments"),
        (inertial(inertia_kg_m2=np.diag([1.0, 1.5, 2.0001])), "off by"),
    ],
)
def test_the_check_finds(found: Inertial, words: str) -> None:
    assert compare(Path("x"), inertial(), inertial()).largest == 0
    with pytest.raises(DataError, match=words):
        compare(Path("x"), found, inertial())


# --- errors users met elsewhere


@pytest.mark.parametrize("name", ["mjcf", "urdf", "sdf"])
def test_no_inertial_is_an_error_never_a_guess(name: str, tmp_path: Path) -> None:
    """ManiSkill 33 and Genesis 3185: inertia missing, or a mass of 1e-15."""
    path = export(bar(), name, tmp_path)
    root = read_xml(path)
    (parent,) = [one for one in root.iter() if one.find("inertial") is not None]
    parent.remove(parent.find("inertial"))
    write_xml(root, path)
    with pytest.raises(DataError, match="no inertial"):
        format_of(name).read(path, body_of(bar()))


@pytest.mark.parametrize("name", SIMULATORS)
def test_densities_are_each_parts_own(name: str, tmp_path: Path) -> None:
    """LIBERO 154 and 155, SAPIEN 8: one density everywhere, on the hull."""
    hollow = phantoms.box_object("hollow-0001", phantoms.HOLLOW)
    for obj, grams in ((bar(), 72.0), (hollow, 84.0)):
        read = format_of(name).read(export(obj, name, tmp_path), body_of(obj))
        assert read.mass_kg == pytest.approx(1e-3 * grams, rel=1e-6)


def test_masses_are_neither_clipped_nor_filled_in(tmp_path: Path) -> None:
    """RoboDojo 41: a mass of 0 became 50 g, and nothing weighed more than 0.5 kg."""
    heavy = phantoms.box_object("heavy-0001", [Box("lead", (0, 0, 0), (20, 20, 20), 11.3)])
    model = mujoco.MjModel.from_xml_path(str(export(heavy, "mjcf", tmp_path)))
    assert float(model.body_mass[1]) == pytest.approx(90.4)
    nothing = phantoms.box_object("empty-0001", [Box("void", (0, 0, 0), (2, 2, 2), 0.0)])
    with pytest.raises(DataError, match=r"empty-0001: expected a mass above 0, got 0\.0 g"):
        export(nothing, "mjcf", tmp_path)


def test_inertia_goes_with_the_size(tmp_path: Path) -> None:
    """Strands robots 1694: the same inertia for all, up to 600 times off."""
    found = []
    for edge in (2.0, 20.0):
        obj = phantoms.box_object("cube-0009", [Box("cube", (0, 0, 0), (edge,) * 3, 2.0)])
        found.append(format_of("urdf").read(export(obj, "urdf", tmp_path), body_of(obj)))
    np.testing.assert_allclose(found[1].inertia_kg_m2, 1e5 * found[0].inertia_kg_m2, atol=1e-12)
    np.testing.assert_allclose(np.diag(found[1].inertia_kg_m2), 16.0 * 0.2**2 / 6)


@pytest.mark.parametrize("name", SIMULATORS)
def test_the_centre_of_mass_is_neither_the_origin_nor_the_bottom(name: str, tmp_path: Path) -> None:
    """pybullet-object-models 2."""
    read = format_of(name).read(export(bar(), name, tmp_path), body_of(bar()))
    np.testing.assert_allclose(read.com_m, np.array([25 / 18, 1, 2]) / 100, rtol=1e-6)


def test_mass_and_densities_agree(tmp_path: Path) -> None:
    """BEHAVIOR-1K 2217."""
    path = export(bar(), "sdf", tmp_path)
    record = json.loads((path.parent / RECORD).read_text())
    volumes = [trimesh.load_mesh(path.parent / f"meshes/{name}.obj").volume for name in
               ("plastic", "steel")]  # fmt: skip
    grams = [part["density_g_cm3"] * 1e6 * volume for part, volume in
             zip(record["parts"], volumes, strict=True)]  # fmt: skip
    assert sum(grams) == pytest.approx(1e3 * record["mass_kg"])


def test_space_is_counted_once(tmp_path: Path) -> None:
    """Articraft 68: overlapping parts weighed twice."""
    filled = phantoms.box_object("filled-0001", phantoms.FILLED)
    read = format_of("mjcf").read(export(filled, "mjcf", tmp_path), body_of(filled))
    assert read.mass_kg == pytest.approx(1e-3 * (14.0 + 8.0))
    whole = dataclasses.replace(filled.parts[0], mesh=Box("", (-2, -1, -1), (2, 1, 1)).mesh)
    overlapping = dataclasses.replace(filled, parts=(whole, filled.parts[1]))
    with pytest.raises(DataError, match=r"weigh 24 g, its voxels 22 g: expected parts that do not"):
        export(overlapping, "mjcf", tmp_path / "overlapping")
