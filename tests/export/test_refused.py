"""What cannot be exported is one line, and nothing is left half written."""

from __future__ import annotations

import dataclasses
import json
import math
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner, Result

from tests import phantoms
from tests.phantoms import Box
from xden1k.cli import cli
from xden1k.errors import DataError, MissingExtraError
from xden1k.export import FORMATS, export
from xden1k.folder import write_folder
from xden1k.values.types import DensityObject


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("dataset") / "folder"
    write_folder(phantoms.objects(), out, version="1.0.0", builder="test 1")
    return out


def run(*arguments: object) -> Result:
    return CliRunner().invoke(cli, ["export", *(str(argument) for argument in arguments)])


def with_part(obj: DensityObject, **changes: Any) -> DensityObject:
    first, *rest = obj.parts
    return dataclasses.replace(obj, parts=(dataclasses.replace(first, **changes), *rest))


@pytest.mark.parametrize("name", FORMATS)
def test_an_unknown_density_is_never_made_up(name: str, tmp_path: Path) -> None:
    unknown = phantoms.box_object("cube-0002", phantoms.CUBE, density_known=False)
    words = r"cube-0002: part cube: expected a density, but only its attenuation is known; none is"
    with pytest.raises(DataError, match=words):
        export(unknown, name, tmp_path / "out")
    figures = dict.fromkeys(("density_g_cm3", "density_sd_g_cm3"), math.nan)
    withheld = with_part(phantoms.objects()[1], **figures, density_source="withheld")
    with pytest.raises(DataError, match="part plastic: expected a density, but its density is wi"):
        export(withheld, name, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_mesh_that_is_not_closed_is_refused(tmp_path: Path) -> None:
    box = trimesh.creation.box((1, 1, 1))
    holed = trimesh.Trimesh(box.vertices, box.faces[1:], process=False)
    obj = with_part(phantoms.objects()[1], mesh=holed)
    with pytest.raises(DataError, match=r"bar-0002: part plastic: expected a closed mesh, got 3 o"):
        export(obj, "obj", tmp_path)
    turned = trimesh.Trimesh(box.vertices, box.faces[:, ::-1], process=False)
    with pytest.raises(DataError, match=r"part plastic: expected a solid, got a volume of -1 cm³"):
        export(with_part(phantoms.objects()[1], mesh=turned), "obj", tmp_path)


@pytest.mark.parametrize("name", ["mjcf", "npz"])
def test_a_part_of_no_volume_is_refused(name: str, tmp_path: Path) -> None:
    box = trimesh.creation.box((1, 1, 1))
    flat = trimesh.Trimesh(box.vertices * [1, 1, 0], box.faces, process=False)
    for mesh in (flat, trimesh.Trimesh()):
        obj = with_part(phantoms.objects()[1], mesh=mesh)
        with pytest.raises(DataError, match=r"part plastic: expected a solid, got a volume of 0"):
            export(obj, name, tmp_path)


def test_a_format_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"unknown format 'stl'; there are mjcf, urdf, sdf, usd"):
        export(phantoms.objects()[1], "stl", tmp_path)


def test_a_light_object_is_written_with_a_warning(tmp_path: Path) -> None:
    light = phantoms.box_object("seed-0001", [Box("seed", (0, 0, 0), (1, 1, 1), 1.5)])
    with pytest.warns(UserWarning, match=r"seed-0001: 1\.5 g .* moment of 2\.5e-08 kg·m² is writt"):
        path = export(light, "mjcf", tmp_path, check=True)
    assert 'mass="0.0015"' in path.read_text()


@pytest.mark.parametrize(
    ("name", "module", "extra", "checked"),
    [
        ("mjcf", "mujoco", "sim", True),
        ("urdf", "yourdfpy", "sim", True),
        ("usd", "pxr", "usd", False),
        ("nifti", "nibabel", "volumes", False),
    ],
)
def test_a_missing_extra_is_named_and_leaves_nothing(
    name: str,
    module: str,
    extra: str,
    checked: bool,
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    out = tmp_path / "out"
    how = ["--check"] if checked else []
    result = run("bar-0002", "--root", folder, "--format", name, "-o", out, *how)
    assert result.exit_code == 1
    assert re.search(rf"pip install .*\[{extra}\]'", result.stderr)
    assert result.stderr.count("\n") == 1
    assert not out.exists()
    if checked:
        assert run("bar-0002", "--root", folder, "--format", name, "-o", out).exit_code == 0


def test_pieces_ask_for_their_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "vhacdx", None)
    with pytest.raises(MissingExtraError, match="vhacdx is needed here: pip install"):
        export(phantoms.objects()[1], "mjcf", tmp_path, pieces=2)


def test_the_command_writes_and_names_the_files(folder: Path, tmp_path: Path) -> None:
    result = run("bar-0002", "cube-0001", "--root", folder, "--format", "mjcf", "-o", tmp_path)
    paths = [tmp_path / name / f"{name}.xml" for name in ("bar-0002", "cube-0001")]
    assert (result.exit_code, result.stderr) == (0, "")
    assert result.stdout.splitlines() == [str(path) for path in paths]
    assert all(path.is_file() for path in paths)


def test_the_command_gives_json(folder: Path, tmp_path: Path) -> None:
    asked = ["bar-0002", "--root", folder, "--format", "obj", "-o", tmp_path, "--check", "--json"]
    values = json.loads(run(*asked).stdout)
    (made,) = values["exported"]
    assert (made["object_id"], values["failed"]) == ("bar-0002", {})
    assert made["deviation"].keys() == {"mass", "com", "inertia"}


def test_what_fails_is_told_and_the_rest_is_done(folder: Path, tmp_path: Path) -> None:
    asked = ("bar-0002", "bar-9", "cube-0002")
    result = run(*asked, "--root", folder, "--format", "sdf", "-o", tmp_path)
    assert result.exit_code == 3
    assert result.stdout == f"{tmp_path / 'bar-0002' / 'bar-0002.sdf'}\n"
    assert "no object 'bar-9' among 6; did you mean bar-0002 or bar-0001?" in result.stderr
    assert "cube-0002: part cube: expected a density" in result.stderr
    assert result.stderr.count("\n") == 2
    result = run("bar-9", "--root", folder, "--format", "sdf", "-o", tmp_path)
    assert (result.exit_code, result.stdout, result.stderr.count("\n")) == (1, "", 1)


def test_a_split_is_exported_as_a_whole(folder: Path, tmp_path: Path) -> None:
    asked = ["--split", "test", "--root", folder, "--format", "vti", "-o", tmp_path]
    assert run(*asked).exit_code == 0
    assert {path.name for path in tmp_path.iterdir()} == {"bar-0002", "filled-0001", "hollow-0001"}
    result = run("--split", "nope", "--root", folder, "--format", "vti", "-o", tmp_path)
    assert (result.exit_code, "no split 'nope'" in result.stderr) == (1, True)


def test_hdf5_is_one_file_of_all_or_none(folder: Path, tmp_path: Path) -> None:
    asked = ["--root", folder, "--format", "hdf5", "-o", tmp_path]
    result = run("bar-0001", "bar-0002", *asked)
    assert result.stdout == f"{tmp_path / 'objects' / 'objects.h5'}\n"
    before = (tmp_path / "objects" / "objects.h5").read_bytes()
    result = run("bar-0001", "cube-0002", *asked)
    assert (result.exit_code, result.stderr.count("\n")) == (1, 1)
    assert "cube-0002: part cube: expected a density" in result.stderr
    assert (tmp_path / "objects" / "objects.h5").read_bytes() == before


@pytest.mark.parametrize("asked", [[], ["bar-0002", "--split", "test"]])
def test_either_ids_or_a_split(asked: list[str], folder: Path, tmp_path: Path) -> None:
    result = run(*asked, "--root", folder, "--format", "obj", "-o", tmp_path)
    assert (result.exit_code, "give the ids of objects, or --split" in result.stderr) == (2, True)


def test_a_folder_of_other_files_is_left_alone(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "bar-0002").mkdir()
    (tmp_path / "bar-0002" / "thesis.tex").write_text("mine")
    result = run("bar-0002", "--root", folder, "--format", "obj", "-o", tmp_path)
    assert result.exit_code == 1
    assert "got a folder that holds thesis.tex" in result.stderr
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["thesis.tex"]


def test_a_light_object_is_a_note(tmp_path: Path) -> None:
    light = phantoms.box_object("seed-0001", [Box("seed", (0, 0, 0), (1, 1, 1), 1.5)])
    root = tmp_path / "dataset"
    write_folder([light], root, version="1.0.0", builder="test 1")
    result = run("seed-0001", "--root", root, "--format", "obj", "-o", tmp_path / "out")
    assert result.exit_code == 0
    assert result.stderr.startswith("note: seed-0001: 1.5 g with a smallest principal moment")
    assert result.stderr.count("\n") == 1


def test_a_rigid_body_that_cannot_be_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bar = phantoms.objects()[1]
    mass = bar.mass_properties
    long = dataclasses.replace(mass, inertia_g_cm2=np.diag([1.0, 1.0, 3.0]))
    monkeypatch.setitem(bar.__dict__, "mass_properties", long)
    with pytest.raises(DataError, match=r"bar-0002: no rigid body has the principal moments"):
        export(bar, "mjcf", tmp_path)
    away = dataclasses.replace(mass, com_cm=np.array([9.0, 0, 0]))
    monkeypatch.setitem(bar.__dict__, "mass_properties", away)
    with pytest.raises(DataError, match=r"bar-0002: its centre of mass .* is outside its box"):
        export(bar, "mjcf", tmp_path)
