"""Every way a dataset folder can be wrong is found and named."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings

from tests import phantoms
from tests.strategies import density_objects
from xden1k.folder import write_rows
from xden1k.folder.verify import row_problems, verify_folder
from xden1k.format.checksums import file_sha256
from xden1k.format.codec import from_planes, to_planes
from xden1k.format.records import decode_array, object_row
from xden1k.format.schema import ARRAY_COLUMNS
from xden1k.values.types import DensityObject

Row = dict[str, Any]


@pytest.fixture(scope="module")
def rows() -> list[Row]:
    return [object_row(obj) for obj in phantoms.objects()]


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory, rows: list[Row]) -> Path:
    out = tmp_path_factory.mktemp("dataset") / "folder"
    write_rows(rows, out, version="1.0.0", builder="test")
    return out


@pytest.fixture
def folder(sound: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(sound, tmp_path / "folder"))


def test_a_sound_folder_has_no_problem_and_reports_each_row(sound: Path) -> None:
    seen = []
    assert verify_folder(sound, on_row=lambda: seen.append(1)) == []
    assert len(seen) == 6


@settings(max_examples=8, deadline=None)
@given(density_objects())
def test_any_valid_object_makes_a_sound_row(obj: DensityObject) -> None:
    row = object_row(obj)
    # the strategy draws attenuations apart from the fields
    assert [problem for problem in row_problems(row) if "apparent" not in problem] == []


def shorten(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-10])


def flip_a_bit(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 1
    path.write_bytes(data)


SHARD = "data/test-00000-of-00003.parquet"


@pytest.mark.parametrize(
    ("name", "damage", "message"),
    [
        (SHARD, Path.unlink, f"{SHARD}: missing, manifest.json lists it"),
        (SHARD, shorten, f"{SHARD}: .* bytes, manifest.json says"),
        (SHARD, flip_a_bit, f"{SHARD}: its sha256 is not the one in manifest.json"),
        ("SHA256SUMS", Path.unlink, "SHA256SUMS: missing"),
        ("SHA256SUMS", shorten, "metadata/val.parquet: its sha256|SHA256SUMS does not list it"),
        ("manifest.json", shorten, "manifest.json: not a manifest of schema xden-dataset/1"),
        *(
            pytest.param(*one, marks=pytest.mark.slow)
            for one in (
                (SHARD, shorten, "test-0.*: not a whole Parquet file"),
                ("metadata/test.parquet", flip_a_bit, "metadata/test.parquet: its sha256"),
                ("README.md", shorten, "README.md: its sha256 is not the one in SHA256SUMS"),
                ("eval.yaml", Path.unlink, "eval.yaml: missing, SHA256SUMS lists it"),
                ("manifest.json", Path.unlink, "not a dataset folder: no manifest.json"),
            )
        ),
    ],
)
def test_a_damaged_file_is_named(
    folder: Path, name: str, damage: Callable[[Path], None], message: str
) -> None:
    damage(folder / name)
    problems = "\n".join(verify_folder(folder))
    assert re.search(message, problems), problems


def test_a_stray_shard_that_would_be_loaded_is_named(folder: Path) -> None:
    shutil.copy(folder / SHARD, folder / "data/test-00003-of-00004.parquet")
    assert verify_folder(folder) == [
        "data/test-00003-of-00004.parquet: manifest.json does not list it, but it would be loaded"
    ]


def consistent(folder: Path, path: str) -> None:
    """Make manifest and checksums agree with a file that was changed."""
    manifest = json.loads((folder / "manifest.json").read_text())
    for file in manifest["files"]:
        if file["path"] == path:
            changed = folder / path
            file |= {"bytes": changed.stat().st_size, "sha256": file_sha256(changed)}
    (folder / "manifest.json").write_text(json.dumps(manifest))
    lines = [f"{file['sha256']}  {file['path']}\n" for file in manifest["files"]]
    lines.append(f"{file_sha256(folder / 'manifest.json')}  manifest.json\n")
    (folder / "SHA256SUMS").write_text("".join(lines))


def test_a_shard_of_other_columns_or_rows_is_named(folder: Path) -> None:
    table = pq.read_table(folder / SHARD)
    pq.write_table(table.drop_columns("labels"), folder / SHARD)
    consistent(folder, SHARD)
    assert verify_folder(folder) == [f"{SHARD}: no column labels"]
    pq.write_table(table.slice(0, 0), folder / SHARD)
    consistent(folder, SHARD)
    assert verify_folder(folder) == [f"{SHARD}: 0 rows, manifest.json says 1"]


def test_metadata_that_differ_from_the_data_are_named(folder: Path) -> None:
    path = "metadata/val.parquet"
    table = pq.read_table(folder / path)
    column = table.schema.get_field_index("category")
    pq.write_table(table.set_column(column, "category", [["sphere"]]), folder / path)
    consistent(folder, path)
    assert verify_folder(folder) == [
        "data/val-00000-of-00001.parquet: cube-0002: differs from the metadata in category"
    ]


def changed(row: Row, name: str, change: Callable[[np.ndarray], np.ndarray]) -> Row:
    """The row with the stored values of one grid changed."""
    codec = ARRAY_COLUMNS[name]
    stored = from_planes(row[name], np.dtype(codec.stored), codec.shape)
    return row | {name: to_planes(change(stored).astype(stored.dtype))}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda row: changed(row, "labels", lambda x: x + 1), "labels reach 3"),
        (lambda row: changed(row, "labels", lambda x: x * 0), "labels are empty"),
        (lambda row: changed(row, "envelope", lambda x: x * 0), "occupancy exceeds the envelope"),
        (lambda row: changed(row, "density", lambda x: x + 1), "voxels are denser than their"),
        (lambda row: changed(row, "density", lambda x: x * 0.5), "field holds 36.* meshes 72"),
        (lambda row: changed(row, "density", lambda x: x * np.nan), "negative or non-finite"),
        (lambda row: changed(row, "density", lambda x: -x), "negative or non-finite"),
        (lambda row: changed(row, "apparent_density", lambda x: x * 2), "apparent_density: "),
        (lambda row: row | {"density": None}, "density must be null exactly where"),
        (lambda row: row | {"mass_g": 73.0}, "mass_g is 73.0, the meshes and densities give 72"),
        (lambda row: row | {"com_cm": [0.0, 0.0, 0.0]}, "com_cm is"),
        (lambda row: row | {"inertia_g_cm2": [1.0] * 6}, "inertia_g_cm2 is"),
        (lambda row: row | {"weighed_mass_g": -1.0}, "weighed_mass_g must be positive"),
        (lambda row: row | {"source": "dream"}, "source must be one of"),
        (lambda row: row | {"object_id": "a b"}, "object_id must be of"),
        (lambda row: row | {"preview_pa": b"GIF"}, "preview_pa is not a PNG"),
        (lambda row: row | {"labels": None, "category": None}, "null in category, labels"),
        (lambda row: row | {"face_part": bytes(24)}, "face_part must be 1 to 2"),
        (lambda row: row | {"xray_pa": bytes(960)}, "view pa: no valid pixel"),
        (lambda row: row | {"labels": bytes(5)}, "column labels: 5 bytes"),
        (lambda row: row | {"part_names": ["a", "a"]}, "part names must be unique"),
        (lambda row: row | {"part_density_g_cm3": [1.0, -8.0]}, "density_g_cm3 must be finite"),
        (lambda row: row | {"mesh_faces": row["mesh_faces"][::-1]}, "mesh"),
    ],
)
def test_a_broken_row_is_named(rows: list[Row], change: Callable[[Row], Row], message: str) -> None:
    problems = row_problems(change(rows[0]))
    assert any(re.search(message, problem) for problem in problems), problems


def test_an_open_mesh_is_named(rows: list[Row]) -> None:
    faces = decode_array(rows[0], "mesh_faces")[1:]
    row = rows[0] | {"mesh_faces": to_planes(faces), "face_part": rows[0]["face_part"][1:]}
    assert "mesh of part plastic is not closed" in row_problems(row)


def test_a_mesh_wound_inwards_is_named(rows: list[Row]) -> None:
    faces = decode_array(rows[0], "mesh_faces")[:, ::-1].copy()
    problems = row_problems(rows[0] | {"mesh_faces": to_planes(faces)})
    assert "mesh of part plastic has volume -8 cm³" in problems
