"""Masses as published against ours: exact on boxes, told by category with the flags."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from tests.phantoms import APPARENT, BAR, CUBE, box_object, published_object
from xden1k.errors import DataError
from xden1k.folder import DatasetFolder, open_folder, write_folder
from xden1k.values.types import DensityObject
from xden_builder.published.compare import by_category, change_table, mass_changes


def heavier(obj: DensityObject, factor: float, *flags: str) -> DensityObject:
    """Give the last part another published density, and flags."""
    part = obj.parts[-1]
    published = factor * part.apparent_density_g_cm3
    changed = replace(part, apparent_density_g_cm3=published, flags=flags)
    return replace(obj, parts=(*obj.parts[:-1], changed))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> DatasetFolder:
    root = tmp_path_factory.mktemp("published") / "folder"
    bar = published_object("bar-0001", BAR, category="bar")
    objects = [
        bar,
        heavier(replace(bar, object_id="bar-0002"), 2, "material_guessed"),
        replace(heavier(bar, 4), object_id="bar-0003"),
        published_object("cube-0001", CUBE, category="cube"),
        published_object("cube-0002", CUBE, category="cube", density_known=False),
        box_object("cube-0003", CUBE, category="cube"),
    ]
    write_folder(objects, root, version="0.1.0", builder="tests")
    return open_folder(root)


def test_masses_are_volumes_times_both_densities(folder: DatasetFolder) -> None:
    first, second, third, cube = mass_changes(folder)
    plastic_g, steel_g = 8.0, 64.0
    assert (first.ours_g, first.published_g) == pytest.approx((72, APPARENT * 72))
    assert second.published_g == pytest.approx(APPARENT * (plastic_g + 2 * steel_g))
    assert third.ratio == pytest.approx(APPARENT * (plastic_g + 4 * steel_g) / 72)
    assert (second.part, second.flags) == ("steel", ("no_radiographs", "material_guessed"))
    assert (cube.object_id, cube.ratio) == ("cube-0001", pytest.approx(APPARENT))


def test_categories_come_by_the_factor_of_their_change(folder: DatasetFolder) -> None:
    bar, cube = by_category(mass_changes(folder))
    assert (bar.category, bar.objects, bar.largest.object_id) == ("bar", 3, "bar-0003")
    assert bar.ratio == pytest.approx(APPARENT * 136 / 72)
    assert (cube.category, cube.objects) == ("cube", 1)


def test_the_table_names_the_object_the_part_and_the_flags(folder: DatasetFolder) -> None:
    told = change_table(mass_changes(folder))
    assert told.startswith("4 objects: 0.61 kg as published, 0.232 kg by ours; published / ours: ")
    (line,) = [line for line in told.splitlines() if line.startswith("bar ")]
    assert re.sub(" +", " ", line) == "bar 3 170 72 2.36 bar-0003, steel 4.58 no_radiographs"
    assert change_table([]) == "0 objects have a mass as published and one of ours."


def test_a_folder_of_other_objects_is_refused(tmp_path: Path) -> None:
    write_folder([box_object("a", CUBE)], tmp_path / "d", version="0.1.0", builder="tests")
    with pytest.raises(DataError, match="there are 0 objects among phantom"):
        list(mass_changes(open_folder(tmp_path / "d")))
