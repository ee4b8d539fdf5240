"""A withheld row holds no answer, and still is a sound row of the dataset."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings

import xden1k
from tests import phantoms
from tests.strategies import density_objects
from xden1k.errors import DataError
from xden1k.folder import open_folder, write_rows
from xden1k.folder.verify import row_problems, verify_folder
from xden1k.folder.withheld import ANSWER_COLUMNS, leaks, withhold
from xden1k.format.records import decode_target, object_row, row_object
from xden1k.format.schema import COLUMNS
from xden1k.values.types import PRIVATE, DensityObject

INPUTS = {
    *("object_id", "category", "source", "part_names", "preview_pa", "preview_lat", "xray_pa"),
    *("grid_origin_cm", "voxel_size_cm", "xray_lat", "xray_pa_shape", "xray_lat_shape", "labels"),
    *("occupancy", "envelope", "mesh_vertices", "mesh_faces", "face_part"),
}


def test_every_column_is_an_input_or_an_answer() -> None:
    """A new column has to be put on one of the two lists."""
    names = [column.name for column in COLUMNS]
    assert {*INPUTS, "split", *ANSWER_COLUMNS} == set(names)
    assert list(ANSWER_COLUMNS) == [name for name in names if name in ANSWER_COLUMNS]


@settings(max_examples=8, deadline=None)
@given(density_objects())
def test_a_withheld_row_is_sound_and_keeps_the_inputs(obj: DensityObject) -> None:
    row = object_row(obj)
    kept = withhold(row)
    assert row_problems(kept) == []
    assert leaks(kept) == []
    assert repr(withhold(kept)) == repr(kept)
    assert {name: kept[name] for name in INPUTS} == {name: row[name] for name in INPUTS}
    read = row_object(kept)
    assert (read.split, read.density, read.apparent_density) == (PRIVATE, None, None)
    assert repr(object_row(read)) == repr(kept)


def test_two_objects_that_differ_in_their_answers_alone_are_withheld_alike() -> None:
    one = phantoms.box_object("a", phantoms.CUBE, weighed_mass_g=15.9, flags=("dense",))
    part = replace(
        one.parts[0],
        density_g_cm3=7.0,
        material="steel",
        flags=("hidden",),
        lac_per_cm=3.0,
        color_rgb=(0.1, 0.2, 0.3),
    )
    other = replace(
        one, parts=(part,), density=None, weighed_mass_g=None, flags=(), meta={"fit": {"a": 1}}
    )
    assert repr(withhold(object_row(one))) == repr(withhold(object_row(other)))


@pytest.mark.parametrize(
    ("column", "value"),
    [
        ("mass_g", 1.0),
        ("com_cm", [0.0, 0.0, 0.0]),
        ("part_materials", ["steel"]),
        ("part_color_rgb", [[0.1, 0.2, 0.3]]),
        ("part_flags", [["prior"]]),
        ("flags", ["heavy"]),
        ("weighed_mass_g", 16.0),
        ("part_density_source", ["none"]),
    ],
)
def test_verify_names_the_column_that_leaks(column: str, value: Any) -> None:
    row = withhold(object_row(phantoms.box_object("a", phantoms.CUBE)))
    assert f"answers of the split private are published, in {column}" in row_problems(
        row | {column: value}
    )


def test_verify_finds_a_fit_report() -> None:
    row = withhold(object_row(phantoms.box_object("a", phantoms.CUBE)))
    meta = json.dumps(json.loads(row["meta_json"]) | {"fit": {}}, sort_keys=True)
    (problem,) = row_problems(row | {"meta_json": meta})
    assert problem.endswith("in meta_json")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    rows = [object_row(obj) for obj in phantoms.objects()]
    root = tmp_path_factory.mktemp("withheld") / "folder"
    write_rows(
        [withhold(row) if row["split"] == "test" else row for row in rows],
        root,
        version="1.0.0",
        builder="test",
        more=lambda checksum: {"commitments.json": checksum},
    )
    return root


def test_every_way_in_reads_a_folder_with_a_private_split(folder: Path, tmp_path: Path) -> None:
    assert verify_folder(folder) == []
    rows = xden1k.load_dataset(root=folder, split=PRIVATE, cache_dir=tmp_path)
    assert rows["object_id"][:] == ["bar-0002", "filled-0001", "hollow-0001"]
    assert rows[0]["density"] is None
    sample = xden1k.XDen1K(folder, split=PRIVATE)[0]
    assert sample["density"].isnan().all()
    assert sample["apparent_density"].isnan().all()
    assert sample["xray_pa"].max() > 0


def test_documents_of_the_folder_say_what_is_withheld(folder: Path) -> None:
    checksum = (folder / "commitments.json").read_text()
    assert checksum == open_folder(folder).manifest_sha256
    assert "commitments.json" in (folder / "SHA256SUMS").read_text()
    assert "In the split `private` every answer is withheld" in (folder / "README.md").read_text()
    assert "5 withheld (the split private)" in (folder / "README.md").read_text()
    assert "`private` is sealed" in (folder / "DATASHEET.md").read_text()


@pytest.mark.parametrize("target", ["density", "apparent_density"])
def test_there_is_no_field_to_draw_or_score(folder: Path, target: str) -> None:
    row = open_folder(folder).row("bar-0002")
    with pytest.raises(DataError, match=f"^bar-0002 has no {target}"):
        decode_target(row, "bar-0002", target)
    with pytest.raises(DataError, match="bar-0002: its density is withheld"):
        _ = row_object(row).best_field


def test_rows_are_written_again_as_they_are_read(folder: Path, tmp_path: Path) -> None:
    read = open_folder(folder)
    rows = [read.row(object_id) for object_id in sorted(read.ids())]
    write_rows(rows, tmp_path / "again", version="1.0.0", builder="test")
    assert open_folder(tmp_path / "again").manifest.files == read.manifest.files
