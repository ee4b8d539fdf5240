"""The loop: X-Field's clusters as parts that a rebuild takes."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

from tests.baselines.pixie_scenes import dataset
from xden1k.access.samples import Examples
from xden1k.folder import DatasetFolder, open_folder, write_rows
from xden1k.format.records import object_row, row_object
from xden1k.format.shards import Row
from xden1k.rays import outer_surface
from xden1k.rays.manifolds import solid_of
from xden1k.values.closed import EdgeFaults, edge_faults
from xden_baselines.xfield import XFieldGeometryContrastive, XFieldPixel
from xden_baselines.xfield.__main__ import cli
from xden_builder.audit.run import audit_folder
from xden_builder.capture import CaptureFolder
from xden_builder.evaluate.interiors import compare_interiors, interiors_markdown
from xden_builder.phantoms import write_captures
from xden_builder.pipeline.run import build
from xden_builder.reconstruct.settings import BuildSettings

SHORT: dict[str, Any] = {"epochs": 2, "batch": 4, "queries": 16}
OUTER = BuildSettings(geometry="outer", filtration="told")
pytestmark = pytest.mark.usefixtures("in_this_process", "few_points")


@pytest.fixture
def few_points(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tenth of the points, so that clusters and solids take a second."""
    monkeypatch.setattr("xden_baselines.xfield.parts.POINTS", 6_000)


@pytest.fixture(scope="module")
def captures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two phantoms, radiographs of 64 x 64 pixels."""
    root = tmp_path_factory.mktemp("loop") / "captures"
    write_captures(root, 2, 5, size=64, categories=["hammer", "mug"])
    return root


@pytest.fixture(scope="module")
def whole(captures: Path, in_this_process: None) -> DatasetFolder:
    out = captures.with_name("whole")
    build(captures, out, OUTER, workers=1)
    return open_folder(out)


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What two epochs have learned: next to nothing, so that clusters lie anyhow."""
    method = XFieldPixel(**SHORT)
    examples = dataset(tmp_path_factory.mktemp("learned") / "dataset")
    method.fit(Examples(examples, "train", method.reads), seed=0)
    folder = tmp_path_factory.mktemp("fit")
    method.save(folder)
    return folder


def run(fit: Path, whole: DatasetFolder, out: Path) -> Result:
    return CliRunner().invoke(cli, ["parts", str(fit), str(whole.root), "--out", str(out)])


def test_the_loop_closes(captures: Path, whole: DatasetFolder, fit: Path, tmp_path: Path) -> None:
    parts = tmp_path / "parts"
    done = run(fit, whole, parts)
    assert done.exit_code == 0, done.output
    assert "2 made, 0 kept, 0 refused" in done.output
    source = CaptureFolder(captures, parts)
    for obj in whole.objects():
        read, flags = source.parts(obj.object_id)
        meshes = [part.mesh for part in read]
        assert not flags
        assert all(edge_faults(mesh.faces) == EdgeFaults(0, 0) for mesh in meshes)
        outer = float(obj.parts[0].mesh.volume)
        shared = [(solid_of(a) ^ solid_of(b)).volume() for a, b in combinations(meshes, 2)]
        assert sum(map(abs, shared)) < 1e-6 * outer
        assert float(outer_surface(meshes).volume) == pytest.approx(outer, rel=1e-3)
    build(captures, tmp_path / "rebuilt", BuildSettings(filtration="told"), workers=1, parts=parts)
    rebuilt = open_folder(tmp_path / "rebuilt")
    assert set(rebuilt.ids()) == set(whole.ids())
    assert not audit_folder(rebuilt.root, captures, workers=1).failures
    assert "0 made, 2 kept" in run(fit, whole, parts).output
    found = compare_interiors(captures, [whole.root, rebuilt.root], workers=1)
    assert not found.failures
    for one, _ in found.objects.values():
        assert one.parts == 1
        assert 0 < one.errors.density_mae_g_cm3 < 20
    assert len(interiors_markdown(["whole", "x-field"], found).splitlines()) == 6


def test_parts_of_another_fit_are_made_again(
    whole: DatasetFolder, fit: Path, tmp_path: Path
) -> None:
    assert run(fit, whole, tmp_path / "parts").exit_code == 0
    first, second = whole.ids()
    about, other = (tmp_path / "parts" / one / "x-field.json" for one in (first, second))
    about.write_text(json.dumps({"made_from": "another"}))
    assert "1 made, 1 kept" in run(fit, whole, tmp_path / "parts").output
    about.write_text('{"made_from": ')
    other.write_text("[]")
    assert "2 made, 0 kept" in run(fit, whole, tmp_path / "parts").output


def test_the_folder_of_a_fit_is_as_good_as_its_state(
    whole: DatasetFolder, fit: Path, tmp_path: Path
) -> None:
    """As ``xden-bench baseline --save FIT`` writes it."""
    shutil.copytree(fit, tmp_path / "FIT" / "state")
    assert "2 made" in run(tmp_path / "FIT", whole, tmp_path / "parts").output
    assert "0 made, 2 kept" in run(tmp_path / "FIT" / "state", whole, tmp_path / "parts").output


def lightless(row: Row) -> Row:
    """Return the row with a radiograph of nothing but air."""
    obj = row_object(row)
    pa = replace(obj.views[0], transmission=np.ones_like(obj.views[0].transmission))
    return object_row(replace(obj, views=(pa, obj.views[1])))


def unseen(row: Row) -> Row:
    return object_row(replace(row_object(row), views=()))


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lightless, ": view pa shows nothing where the object is"),
        (lambda row: row | {"xray_lat": None}, ": column xray_lat: expected an array, got nothing"),
        (unseen, " has no radiographs"),
    ],
)
def test_an_object_that_is_refused_is_named_once_and_so_is_its_dataset(
    whole: DatasetFolder,
    fit: Path,
    tmp_path: Path,
    damage: Callable[[Row], Row],
    message: str,
) -> None:
    first, second = whole.ids()
    rows = [damage(whole.row(first)), whole.row(second)]
    write_rows(rows, tmp_path / "damaged", version="0.1.0", builder="tests")
    told = f"{tmp_path / 'damaged'}: {first}{message}"
    said = run(fit, open_folder(tmp_path / "damaged"), tmp_path / "parts")
    assert said.exit_code == 3, said.output
    assert said.stderr == f"refused: {told}\n"
    assert "1 made, 0 kept, 1 refused" in said.stdout
    assert [path.name for path in (tmp_path / "parts").iterdir()] == [second]


def test_a_variant_without_densities_is_refused(
    whole: DatasetFolder, fit: Path, tmp_path: Path
) -> None:
    contrastive = Path(shutil.copytree(fit, tmp_path / "fit"))
    config = contrastive / "config.json"
    values = json.loads(config.read_text()) | {"variant": XFieldGeometryContrastive.variant}
    config.write_text(json.dumps(values))
    said = run(contrastive, whole, tmp_path / "parts")
    assert said.exit_code == 1
    assert "expected a variant that gives densities" in said.output
    assert not (tmp_path / "parts").exists()
