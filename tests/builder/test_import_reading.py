"""A release is read whatever its files are called, and only if they mean what is known of them."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path, PurePosixPath

import numpy as np
import pytest
import trimesh

from tests.builder import releases
from tests.builder.releases import TABLE, VOLUME, copied
from xden1k.errors import DataError
from xden1k.values.physics import PAPER_MAC_CM2_G
from xden_builder.published.given import PublishedObject
from xden_builder.published.reading import (
    FolderSource,
    Roles,
    chosen_folders,
    open_release,
    read_item,
    read_roles,
    unit_of,
)
from xden_builder.published.reading.layout import lay_out
from xden_builder.published.reading.mesh import read_mesh
from xden_builder.published.reading.metadata import find_metadata
from xden_builder.published.report import DryRun, dry_run

ROLES = Roles()


@pytest.fixture
def release(tmp_path: Path) -> Path:
    return copied(tmp_path)


def read(release: Path, number: int, roles: Roles = ROLES) -> PublishedObject:
    opened = open_release(FolderSource(release), roles)
    (item,) = opened.items(chosen_folders(opened, str(number)), release, "cm")
    return read_item(item)


def looked(release: Path, objects: str = "", roles: Roles = ROLES) -> DryRun:
    opened = open_release(FolderSource(release), roles)
    return dry_run(opened, chosen_folders(opened, objects))


# Tolerant about names


@pytest.mark.parametrize("above", ["", "dataset", ".."])
def test_a_release_is_found_at_and_above_its_folders(release: Path, above: str) -> None:
    opened = open_release(FolderSource((release / above).resolve()), ROLES)
    assert [folder.key for folder in opened.layout.objects] == list("012345")
    assert opened.metadata is not None


def test_metadata_on_top_are_found_as_well(release: Path) -> None:
    (release / "dataset" / "metadata.json").rename(release / "metadata.json")
    assert not looked(release, "0").mismatches


def test_other_names_and_endings_serve_as_well(release: Path) -> None:
    folder = release / "dataset" / "1"
    mesh = trimesh.load_mesh(folder / "mesh.glb")
    (folder / "mesh.glb").unlink()
    mesh.export(folder / "surface.ply")
    (folder / VOLUME).rename(folder / "volume.nii.gz")
    (folder / TABLE).rename(folder / "parts.json")
    given = read(release, 1)
    assert len(given.mesh.faces) == len(mesh.faces)
    assert given.table_lac_per_cm


def test_of_several_volumes_the_one_named_after_the_coefficient_is_read(release: Path) -> None:
    folder = release / "dataset" / "1"
    shutil.copy(folder / VOLUME, folder / "mask.nii.gz")
    assert read(release, 1).lac_per_cm.max() > 0


def test_folders_are_numbers_with_zeros_or_names(release: Path) -> None:
    (release / "dataset" / "3").rename(release / "dataset" / "0003")
    (release / "dataset" / "4").rename(release / "dataset" / "red mug")
    releases.metadata(release, lambda told: told.update({"red mug": told.pop("4")}))
    opened = open_release(FolderSource(release), ROLES)
    items = opened.items(opened.layout.objects, release, "cm")
    assert [item.object_id for item in items] == [
        "red-mug",
        *(f"xden1k-000{number}" for number in (0, 1, 2, 3, 5)),
    ]
    assert not any(item.problem for item in items)


@pytest.mark.parametrize("field", ["size", "Scale", "DIMENSIONS", "bbox"])
def test_a_size_may_be_called_otherwise(release: Path, field: str) -> None:
    releases.metadata(release, lambda told: told["2"].update({field: told["2"].pop("size")}))
    assert read(release, 2).size_cm.shape == (3,)


def test_one_number_is_the_longest_side_and_said_so(release: Path) -> None:
    releases.metadata(release, lambda told: told["1"].update(size=12.0))
    given = read(release, 1)
    extents = np.ptp(given.mesh.bounds, axis=0)
    np.testing.assert_allclose(given.size_cm, 12.0 * extents / extents.max())
    assert given.meta["flags"] == ["longest_side_only"]


def test_a_category_becomes_snake_case_and_is_kept_as_it_was(release: Path) -> None:
    releases.metadata(release, lambda told: told["1"].update(category="Tea-Cup (large)"))
    given = read(release, 1)
    assert (given.category, given.meta["category"]) == ("tea_cup_large", "Tea-Cup (large)")


def test_keys_that_begin_with_one_fit_where_all_do(release: Path) -> None:
    before = read(release, 0).size_cm
    releases.metadata(release, lambda told: {f"{int(key) + 1:02d}": told[key] for key in told})
    assert looked(release, "0").values["metadata"]["keys"] == "by from one"
    np.testing.assert_array_equal(read(release, 0).size_cm, before)


def test_a_size_of_another_object_is_told_before_anything_is_made(release: Path) -> None:
    releases.metadata(release, lambda told: {str(int(key) - 1): told[key] for key in told})
    seen = looked(release, "0-2")
    assert len(seen.mismatches) == 2  # a mug is about as wide as high, as the ball after it
    assert all("with the proportions of the mesh, got sides" in line for line in seen.mismatches)


def test_keys_that_only_some_folders_fit_are_not_shifted(release: Path) -> None:
    releases.metadata(release, lambda told: told.pop("0") and told)
    where = re.escape(str(release / "dataset" / "metadata.json"))
    with pytest.raises(DataError, match=f"^{where}: expected an entry for folder 0, got none"):
        read(release, 0)
    assert read(release, 1).category == "mug"


# Strict about meaning: one line, and the other objects go on

DAMAGE: dict[str, tuple[Callable[[Path], object], str]] = {
    "a renamed field": (
        lambda root: releases.table(root, 1, lambda t: {"body": {"lac_value": 1.0, "Density": 2}}),
        rf'{TABLE}: part "body": expected a field LAC, got lac_value, Density',
    ),
    "a coefficient that nothing has": (
        lambda root: releases.table(root, 1, lambda t: {"body": {"LAC": 61}}),
        rf'{TABLE}: part "body": LAC must be from 0 to 60 1/cm, got 61',
    ),
    "a coefficient that is not a number": (
        lambda root: releases.table(root, 1, lambda t: {"body": {"LAC": float("nan")}}),
        rf'{TABLE}: part "body": LAC must be from 0 to 60 1/cm, got nan',
    ),
    "a table that is no JSON": (
        lambda root: (root / "dataset" / "1" / TABLE).write_text("part,LAC"),
        rf"{TABLE}: expected JSON, got Expecting value",
    ),
    "a volume cut off": (lambda root: releases.cut_off(root, 1), rf"{VOLUME}: .*NIfTI"),
    "a file cut off": (lambda root: releases.cut_off_file(root, 1), rf"{VOLUME}: .*NIfTI"),
    "a volume that is no NIfTI": (
        lambda root: (root / "dataset" / "1" / VOLUME).write_bytes(b"nothing of the kind"),
        rf"{VOLUME}: .*NIfTI",
    ),
    "a negative voxel": (
        lambda root: releases.save_volume(root, 1, _with(releases.volume(root, 1), -1.0)),
        rf"{VOLUME}: expected attenuation coefficients from 0 up, got -1.0 at \(3, 4, 5\)",
    ),
    "a voxel that is not a number": (
        lambda root: releases.save_volume(root, 1, _with(releases.volume(root, 1), np.nan)),
        rf"{VOLUME}: expected attenuation coefficients from 0 up, got nan at \(3, 4, 5\)",
    ),
    "no air around the object": (
        lambda root: releases.save_volume(root, 1, releases.volume(root, 1) + 1),
        rf"{VOLUME}: expected air around the object, .* got 1: no volume of attenuation",
    ),
    "nothing but air": (
        lambda root: releases.save_volume(root, 1, 0 * releases.volume(root, 1)),
        rf"{VOLUME}: expected an object, above 0.001 1/cm, got 0 at most: nothing but air",
    ),
    "two axes": (
        lambda root: releases.save_volume(root, 1, releases.volume(root, 1)[:, :, 30]),
        rf"{VOLUME}: expected a volume of three axes, got shape \(64, 64\)",
    ),
    "a Draco mesh": (
        lambda root: releases.compressed(root, 1, "KHR_draco_mesh_compression"),
        r"mesh\.glb: .* got KHR_draco_mesh_compression: unpack it by `gltf-transform copy",
    ),
    "a meshopt mesh": (
        lambda root: releases.compressed(root, 1, "EXT_meshopt_compression"),
        r"mesh\.glb: .* got EXT_meshopt_compression: unpack it",
    ),
    "a mesh without faces": (
        lambda root: releases.without_faces(root, 1),
        r"mesh\.glb: expected a mesh with faces, got none",
    ),
    "a mesh that is none": (
        lambda root: (root / "dataset" / "1" / "mesh.glb").write_bytes(b"<html>404</html>" * 9),
        r"mesh\.glb: expected a binary glTF mesh, got one that begins b'<htm'",
    ),
    "a mesh without a byte": (
        lambda root: (root / "dataset" / "1" / "mesh.glb").write_bytes(b""),
        r"mesh\.glb: expected a binary glTF mesh, got one that begins b''",
    ),
    "no mesh": (
        lambda root: (root / "dataset" / "1" / "mesh.glb").unlink(),
        r"dataset/1: expected one file for the mesh, got none",
    ),
    "no volume": (
        lambda root: (root / "dataset" / "1" / VOLUME).unlink(),
        r"dataset/1: expected one file for the volume, got none",
    ),
    "two meshes": (
        lambda root: (root / "dataset" / "1" / "low.obj").write_text("v 0 0 0"),
        r"dataset/1: expected one file for the mesh, got low\.obj, mesh\.glb",
    ),
    "no category": (
        lambda root: releases.metadata(root, lambda told: told["1"].pop("category") and told),
        r"metadata\.json: entry 1: expected a category, got None",
    ),
    "two sides": (
        lambda root: releases.metadata(root, lambda told: told["1"].update(size=[1, 2])),
        r"metadata\.json: entry 1: expected a size of three positive numbers, got \[1, 2\]",
    ),
    "a side of nothing": (
        lambda root: releases.metadata(root, lambda told: told["1"].update(size=[1, 0, 2])),
        r"metadata\.json: entry 1: expected a size of three positive numbers, got \[1, 0, 2\]",
    ),
}


def _with(values: np.ndarray, value: float) -> np.ndarray:
    values[3, 4, 5] = value
    return values


@pytest.mark.parametrize("name", DAMAGE)
def test_one_bad_object_is_one_line_and_the_others_are_read(release: Path, name: str) -> None:
    damage, message = DAMAGE[name]
    damage(release)
    with pytest.raises(DataError, match=message) as raised:
        read(release, 1)
    assert "\n" not in str(raised.value)
    seen = looked(release, "1,2")
    assert seen.mismatches == (str(raised.value),)
    assert f"first mismatch {raised.value}" in seen.text
    assert read(release, 2).category == "rubber_ball"


def test_another_grid_is_read_as_it_is(release: Path) -> None:
    before = read(release, 1).lac_per_cm
    releases.save_volume(release, 1, before.repeat(2, 0).repeat(2, 1).repeat(2, 2))
    assert looked(release, "1").values["volumes"]["shapes"] == {"128 128 128": 1}


def test_a_last_axis_of_one_is_no_axis(release: Path) -> None:
    releases.save_volume(release, 1, releases.volume(release, 1)[..., None])
    assert read(release, 1).lac_per_cm.shape == (64, 64, 64)


def test_a_volume_of_densities_is_taken_back_to_attenuation_and_said_so(release: Path) -> None:
    before = read(release, 1).lac_per_cm
    releases.save_volume(release, 1, before / np.float32(PAPER_MAC_CM2_G))
    given = read(release, 1)
    np.testing.assert_allclose(given.lac_per_cm, before, rtol=1e-6)
    assert given.meta["flags"] == ["density_volume"]


def test_another_rule_for_densities_keeps_the_coefficient_and_is_counted(release: Path) -> None:
    releases.table(release, 1, lambda parts: parts["body"].update(Density=9.0))
    assert read(release, 1).meta["other_density_rule"] == ["body"]
    assert looked(release, "1").values["tables"]["Density = LAC / 0.17"] == 0


def test_an_object_without_a_table_has_no_named_parts(release: Path) -> None:
    (release / "dataset" / "1" / TABLE).unlink()
    assert read(release, 1).table_lac_per_cm == {}


@pytest.mark.parametrize(("factor", "unit"), [(10.0, "mm"), (0.01, "m")])
def test_sizes_in_another_unit_are_refused_with_the_factor(
    release: Path, factor: float, unit: str
) -> None:
    def scale(told: dict[str, dict[str, list[float]]]) -> None:
        for entry in told.values():
            entry["size"] = [factor * side for side in entry["size"]]

    releases.metadata(release, scale)
    opened = open_release(FolderSource(release), ROLES)
    with pytest.raises(DataError, match=rf"expected sizes in cm, .* --size-unit {unit}"):
        unit_of(opened)
    assert any("expected sizes in cm" in line for line in looked(release, "1").mismatches)


def test_one_unlikely_size_is_flagged(release: Path) -> None:
    releases.metadata(release, lambda told: told["1"].update(size=[0.1, 0.2, 0.1]))
    assert read(release, 1).meta["flags"] == ["size_unlikely"]


# The release as a whole


def test_a_folder_that_is_no_release_says_so(tmp_path: Path) -> None:
    (tmp_path / "photo.jpg").write_bytes(b"")
    with pytest.raises(DataError, match=r"expected folders with a mesh .* got none among 1 files"):
        open_release(FolderSource(tmp_path), ROLES)


def test_missing_metadata_name_what_was_met(release: Path) -> None:
    (release / "dataset" / "metadata.json").write_text("[]")
    (line, *_) = looked(release, "0").mismatches
    assert "dataset/metadata.json: expected a JSON object, got list" in line
    (release / "dataset" / "metadata.json").unlink()
    (line, *_) = looked(release, "0").mismatches
    assert "expected metadata.json, with category and size of each object" in line


def test_two_folders_of_one_name_are_refused() -> None:
    paths = [PurePosixPath(f"{above}/7/mesh.glb") for above in ("a", "b")]
    with pytest.raises(DataError, match=r"expected one folder for object 7, got a/7, b/7"):
        lay_out(paths, ROLES)


def test_an_object_that_is_not_there_is_named(release: Path) -> None:
    opened = open_release(FolderSource(release), ROLES)
    with pytest.raises(DataError, match=r"no object 9 among 6, 0 to 5"):
        chosen_folders(opened, "0-2,9")


def test_ranges_and_single_objects_are_chosen_once_each(release: Path) -> None:
    opened = open_release(FolderSource(release), ROLES)
    assert [each.key for each in chosen_folders(opened, "4,0-2,1")] == ["4", "0", "1", "2"]


def test_images_and_unknown_files_are_counted_and_named_and_never_used(release: Path) -> None:
    (release / "dataset" / "1" / "view_0.png").write_bytes(b"no picture")
    (release / "dataset" / "1" / "notes.bin").write_bytes(b"?")
    seen = looked(release, "1")
    assert seen.values["image"]["names"] == {"view_0.png": 1}
    assert "notes.bin (1, first dataset/1/notes.bin)" in seen.values["other files"]
    assert not seen.mismatches


def test_colours_of_the_texture_belong_to_the_vertices() -> None:
    mesh, colors = read_mesh(releases.TWIN / "dataset" / "1" / "mesh.glb")
    assert colors is not None
    assert colors.shape == (len(mesh.vertices), 3)
    assert 0 <= colors.min() < colors.max() <= 1


def test_checksums_follow_each_file_and_the_metadata(release: Path) -> None:
    def digest() -> str:
        opened = open_release(FolderSource(release), ROLES)
        (item,) = opened.items(chosen_folders(opened, "1"), release, "cm")
        return item.digest

    seen = {digest()}
    releases.table(release, 1, lambda parts: parts["body"].update(Density=9.0))
    seen.add(digest())
    releases.metadata(release, lambda told: told["1"].update(category="Cup"))
    seen.add(digest())
    releases.metadata(release, lambda told: told["2"].update(category="Cup"))  # not of this one
    seen.add(digest())
    assert len(seen) == 3


def test_a_broken_file_beside_the_metadata_does_no_harm() -> None:
    good = json.dumps({"0": {"category": "Mug", "size": [1, 2, 3]}}).encode()
    files = [(PurePosixPath("a.json"), b"{"), (PurePosixPath("metadata.json"), good)]
    assert find_metadata(files, ["0"]).entry("0").size == (1, 2, 3)


# A mapping file


def test_a_mapping_file_finds_files_of_any_name(release: Path, tmp_path: Path) -> None:
    folder = release / "dataset" / "1"
    (folder / "mesh.glb").rename(folder / "scan.GLB")
    shutil.copy(folder / "scan.GLB", folder / "low.glb")
    (tmp_path / "map.toml").write_text('[roles]\nmesh = ["mesh.glb", "scan.*"]\n')
    roles = read_roles(tmp_path / "map.toml")
    assert len(read(release, 1, roles).mesh.faces) > 0
    assert (
        "low.glb (1, first dataset/1/low.glb)" in looked(release, "1", roles).values["other files"]
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[roles]\nmehs = '*.glb'", r"map\.toml: roles\.mehs is not a known key"),
        ("[roles]\nmesh = 3", r"map\.toml: roles\.mesh must be a glob such as \*\.glb"),
        ("[roles]\nmesh = []", r"map\.toml: roles\.mesh must be a glob such as \*\.glb"),
        ("scanner = 'none.toml'", r"map\.toml: scanner must name a scanner\.toml"),
        ("roles", r"map\.toml: not valid TOML"),
    ],
)
def test_a_wrong_mapping_file_names_the_key(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "map.toml").write_text(text)
    with pytest.raises(DataError, match=message):
        read_roles(tmp_path / "map.toml")
