"""Objects without radiographs are whole objects; nothing stands in for what there is not."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from matplotlib.image import imread

from tests import phantoms
from xden1k.cli import cli
from xden1k.errors import DataError
from xden1k.export import export_stack
from xden1k.export.arrays import arrays_of
from xden1k.folder import open_folder, write_folder
from xden1k.folder.verify import row_problems, verify_folder
from xden1k.format.manifest import Manifest
from xden1k.format.records import decode_geometry, object_row, row_object
from xden1k.format.schema import RADIOGRAPH_COLUMNS
from xden1k.format.shards import Row
from xden1k.pictures import figures
from xden1k.values.notebook import object_html
from xden1k.values.types import DensityObject


@pytest.fixture(scope="module")
def bar() -> DensityObject:
    return phantoms.published_object("bar-0001", phantoms.BAR)


@pytest.fixture(scope="module")
def row(bar: DensityObject) -> Row:
    return object_row(bar)


@pytest.fixture(scope="module")
def complete(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("complete") / "folder"
    write_folder([phantoms.objects()[0]], out, version="1.0.0", builder="test")
    return out


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory, bar: DensityObject) -> Path:
    """Two without radiographs and one with, in one split."""
    out = tmp_path_factory.mktemp("mixed") / "folder"
    objects = [bar, replace(bar, object_id="bar-0002"), phantoms.box_object("c", phantoms.CUBE)]
    write_folder(objects, out, version="1.0.0", builder="test")
    return out


def test_a_row_without_radiographs_has_null_in_all_their_columns_and_comes_back(row: Row) -> None:
    assert {name for name, value in row.items() if value is None} == {
        *RADIOGRAPH_COLUMNS,
        "weighed_mass_g",
    }
    back = row_object(row)
    assert (back.views, back.source, back.flags) == ((), "published", ("no_radiographs",))
    assert decode_geometry(row) == {}
    again = object_row(back)
    assert all(repr(again[name]) == repr(row[name]) for name in row)


def test_a_folder_of_some_without_radiographs_is_sound_and_counts_them(mixed: Path) -> None:
    assert verify_folder(mixed) == []
    folder = open_folder(mixed)
    assert folder.manifest.without_radiographs == {"test": 2}
    assert folder.without_radiographs("test") == {"bar-0001", "bar-0002"}
    assert [len(obj.views) for obj in folder.objects()] == [0, 0, 2]
    light = pq.read_table(mixed / "metadata" / "test.parquet")
    assert light["preview_pa"].null_count == light["preview_lat"].null_count == 2


def test_xden_info_counts_them(mixed: Path, complete: Path) -> None:
    told, whole = (
        CliRunner().invoke(cli, ["info", "--root", str(root)]).stdout for root in (mixed, complete)
    )
    assert "\nno X-rays   test 2\n" in told
    assert "X-rays" not in whole


def test_a_folder_with_all_radiographs_says_nothing_of_them_and_is_of_the_first_schema(
    complete: Path, mixed: Path
) -> None:
    values = json.loads((complete / "manifest.json").read_text())
    assert values["schema"] == "xden-dataset/1"
    assert "without_radiographs" not in values
    assert "no radiographs" not in (complete / "README.md").read_text()
    assert json.loads((mixed / "manifest.json").read_text())["schema"] == "xden-dataset/2"


def test_one_radiograph_alone_cannot_be_missing(row: Row) -> None:
    whole = object_row(phantoms.box_object("bar-0001", phantoms.BAR))
    assert row_problems(whole | {"xray_lat": None}) == ["null in xray_lat"]
    none = dict.fromkeys(RADIOGRAPH_COLUMNS)
    assert row_problems(whole | none) == ["column xray_pa: expected an array, got nothing"]
    (problem,) = row_problems(whole | {"meta_json": row["meta_json"]})
    assert problem == "it has radiographs, and meta_json no geometry of any"


def test_a_count_that_the_rows_belie_is_found(mixed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told = replace(Manifest.read(mixed), without_radiographs={"test": 1})
    monkeypatch.setattr(Manifest, "read", lambda *_, **__: told)
    assert "test: 2 objects without radiographs, manifest.json says 1" in verify_folder(mixed)


def test_two_views_of_one_side_are_refused(bar: DensityObject) -> None:
    view = phantoms.box_object("x", phantoms.CUBE).views[0]
    with pytest.raises(DataError, match=r"views must be pa and lat, or none, got \['pa', 'pa'\]"):
        replace(bar, views=(view, view))


def test_documents_say_what_is_not_there_and_whose_the_densities_are(
    tmp_path: Path, bar: DensityObject
) -> None:
    write_folder([bar], tmp_path / "folder", version="1.0.0", builder="test")
    said = {
        path.name: path.read_text() for path in (tmp_path / "folder").iterdir() if path.is_file()
    }
    for name in ("README.md", "DATASHEET.md", "croissant.json"):
        assert "1 of 1 objects have no radiographs" in said[name], name
        assert "`density` with its standard deviation is this project's estimate" in said[name], (
            name
        )
    card = said["README.md"]
    assert "# XDen-1K, imported from the authors' release, version 1.0.0" in card
    assert 'row["xray_pa"]' not in card
    assert "annotators" not in card
    assert "Biplanar" not in said["croissant.json"]


def test_an_export_leaves_out_radiographs_that_there_are_none_of(bar: DensityObject) -> None:
    left_out = arrays_of(phantoms.objects()[0]).keys() - arrays_of(bar).keys()
    assert left_out == {"xray_pa", "xray_lat", "xray_pa_shape", "xray_lat_shape"}


def test_a_stack_of_objects_with_and_without_radiographs_is_refused(
    tmp_path: Path, bar: DensityObject
) -> None:
    with pytest.raises(DataError, match=r"bar-0001: it and those before it do not both have xray_"):
        export_stack([phantoms.box_object("a", phantoms.CUBE), bar], tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_pictures_show_slices_and_parts_alone(
    tmp_path: Path, bar: DensityObject, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("xden1k.pictures.page.DPI", 20)
    figures.object_sheet(bar, tmp_path / "page.png")
    figures.contact_sheet([bar], tmp_path / "sheet.png")
    page, sheet = (imread(tmp_path / name).shape for name in ("page.png", "sheet.png"))
    assert page[0] == pytest.approx(20 * 4.25, abs=1)
    assert sheet[1] == pytest.approx(20 * 1.95, abs=1)
    assert [word in object_html(bar) for word in ("radiograph, ", "density, ")] == [False, True]


def test_mass_and_grids_need_no_radiograph(bar: DensityObject, row: Row) -> None:
    assert row["mass_g"] == pytest.approx(phantoms.exact_mass_g(phantoms.BAR), rel=1e-6)
    np.testing.assert_array_equal(row_object(row).labels, bar.labels)
