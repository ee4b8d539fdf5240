"""Scenes for programs of others: whole, the same pictures, and of one kind in one folder."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from tests.baselines.painted import GREY, RED, painted
from tests.phantoms import BAR
from xden1k.errors import DataError, MissingObjectError
from xden1k.folder import DatasetFolder, open_folder, write_folder
from xden_baselines.views import exporting
from xden_baselines.views.__main__ import cli
from xden_baselines.views.cameras import Rig
from xden_baselines.views.exporting import export_scenes
from xden_baselines.views.page import page_of, write_page
from xden_baselines.views.source import RenderedPhantoms, SceneFolders

SOURCE = RenderedPhantoms(Rig(per_ring=1, size_px=40))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> DatasetFolder:
    root = tmp_path_factory.mktemp("exported") / "dataset"
    paint = {"plastic": RED, "steel": GREY}
    objects = [painted(f"bar-000{number}", BAR, paint, split="test") for number in (1, 2)]
    write_folder(objects, root, version="0.1.0", builder="tests")
    return open_folder(root)


def test_exported_scenes_are_read_as_the_pictures_they_were(
    folder: DatasetFolder, tmp_path: Path
) -> None:
    assert export_scenes(folder, "test", SOURCE, tmp_path / "runs") == 2
    drawn = SOURCE(folder, "bar-0001")
    found = SceneFolders(tmp_path / "runs" / "scenes")(folder, "bar-0001")
    np.testing.assert_array_equal(found.colors, drawn.colors)
    np.testing.assert_array_equal(found.masks, drawn.masks)
    scene = tmp_path / "runs" / "scenes" / "bar-0001"
    frames = json.loads((scene / "transforms.json").read_text())["frames"]
    for frame, mask in zip(frames, drawn.masks, strict=True):
        with Image.open(scene / frame["mask_path"]) as image:
            np.testing.assert_array_equal(np.array(image) == 255, mask)


def test_an_interrupted_export_goes_on_and_leaves_nothing_half_written(
    folder: DatasetFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(pictures: object, scene: Path) -> None:
        scene.mkdir()
        (scene / "transforms.json").write_text("{")
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(exporting, "write_scene", stopped)
        with pytest.raises(KeyboardInterrupt):
            export_scenes(folder, "test", SOURCE, tmp_path)
    assert not list((tmp_path / "scenes").iterdir())
    assert export_scenes(folder, "test", SOURCE, tmp_path) == 2
    assert export_scenes(folder, "test", SOURCE, tmp_path) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["pictures.json", "scenes"]
    names = sorted(path.name for path in (tmp_path / "scenes").iterdir())
    assert names == ["bar-0001", "bar-0002"]


def test_scenes_of_two_kinds_are_never_mixed(folder: DatasetFolder, tmp_path: Path) -> None:
    export_scenes(folder, "test", SOURCE, tmp_path / "scenes")
    other = RenderedPhantoms(Rig(per_ring=2, size_px=40))
    with pytest.raises(DataError, match=r"pictures\.json: scenes of another dataset, or drawn"):
        export_scenes(folder, "test", other, tmp_path / "scenes")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "note.txt").write_text("")
    with pytest.raises(DataError, match="mine: expected an empty folder or one of scenes"):
        export_scenes(folder, "test", SOURCE, tmp_path / "mine")


def test_the_command_says_what_it_wrote(folder: DatasetFolder, tmp_path: Path) -> None:
    options = ["--root", str(folder.path), "--per-ring", "1", "--size", "40", "--json"]
    ran = CliRunner().invoke(cli, ["export", str(tmp_path / "scenes"), *options])
    assert ran.exit_code == 0, ran.output
    assert json.loads(ran.output)["written"] == 2
    unknown = CliRunner().invoke(cli, ["export", str(tmp_path / "x"), *options, "--split", "tset"])
    assert unknown.exit_code == 1
    assert "no split 'tset'" in unknown.output
    assert not (tmp_path / "x").exists()


def test_a_page_has_a_row_of_views_for_each_object(folder: DatasetFolder, tmp_path: Path) -> None:
    found = page_of(folder, ["bar-0002", "bar-0001"], SOURCE)
    drawn = SOURCE(folder, "bar-0001").colors
    np.testing.assert_array_equal(found[40:, :40], drawn[0])
    assert found.shape == (80, 40 * len(drawn), 3)
    write_page(found, tmp_path / "page.png", width_px=60)
    with Image.open(tmp_path / "page.png") as image:
        assert image.size == (60, 40)
    for ids, name, message in [([], "page.png", "at least one object"), (["x-1"], "", "no object")]:
        with pytest.raises((DataError, MissingObjectError), match=message):
            write_page(page_of(folder, ids, SOURCE), tmp_path / name, width_px=60)
    with pytest.raises(DataError, match=r"page\.oil"):
        write_page(found, tmp_path / "page.oil", width_px=60)
    with pytest.raises(DataError, match=r"page\.png: height and width must be > 0"):
        write_page(found, tmp_path / "page.png", width_px=0)
