"""Pictures, 3D models and words of the web app, without a page."""

from __future__ import annotations

import base64
import io
import os
import re
import runpy
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from tests.bench.desks import turned_away
from tests.phantoms import BAR, HOLLOW, box_object
from xden1k.errors import DataError
from xden1k.pictures.radiographs import compare
from xden1k.predictions import CODES, Problem
from xden1k.values.types import DensityObject
from xden_bench.scoring.reference import Reference
from xden_bench.serve import figures, glb, site, words
from xden_bench.serve.explorer import PART_HEADINGS, Explorer

ROOT = Path(__file__).parents[2]
Submit = Callable[..., Path]


@pytest.fixture(scope="module")
def bar() -> DensityObject:
    return box_object("bar", BAR)


def entry(reference: Reference, **rest: Any) -> dict[str, Any]:
    data = {"manifest_sha256": reference.manifest_sha256, "split": "test"}
    method = {"name": "test"}
    return {
        **{"dataset": data, "method": method, "track": "geometry", "target": "density"},
        **{"protocol": "v1", "submission_sha256": "a" * 64},
        **rest,
    }


def explorer_of(reference: Reference, tmp_path: Path, file: Path | None) -> Explorer:
    return Explorer(reference.folder, lambda _: file, tmp_path)


def test_vertex_colours_are_linear_light(bar: DensityObject) -> None:
    scale = figures.density_scale(8.0)
    seen = np.asarray(scale.to_rgba([8.0]))[0, :3]
    linear = glb.vertex_colours(np.array([8.0]), scale)[0, :3] / 255
    back = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    np.testing.assert_allclose(back, seen, atol=0.03)


def test_unknown_values_have_a_colour_of_their_own() -> None:
    known, unknown = glb.vertex_colours(np.array([0.0, np.nan]), figures.density_scale(1.0))
    assert unknown[0] == unknown[1] == unknown[2]
    assert len(set(known[:3].tolist())) == 3


def test_a_model_holds_every_part_in_metres_with_its_colours(
    bar: DensityObject, tmp_path: Path
) -> None:
    meshes = [part.mesh for part in bar.parts]
    scale = figures.density_scale(8.0)
    colours = [
        glb.vertex_colours(np.full(len(mesh.vertices), part.density_g_cm3), scale)
        for mesh, part in zip(meshes, bar.parts, strict=True)
    ]
    glb.write_glb(tmp_path / "bar.glb", bar.parts, meshes, colours)
    scene = trimesh.load_scene(tmp_path / "bar.glb")
    assert set(scene.geometry) == {"plastic", "steel"}
    np.testing.assert_allclose(np.sort(scene.extents), [0.02, 0.02, 0.04], rtol=1e-5)
    assert scene.extents[1] == pytest.approx(0.04)  # z has become y, which is up in glTF
    for name, rgba in zip(("plastic", "steel"), colours, strict=True):
        assert (scene.geometry[name].visual.vertex_attributes["color"] == rgba[0]).all()


def test_cutting_open_leaves_closed_halves(bar: DensityObject) -> None:
    meshes = [part.mesh for part in bar.parts]
    halves = glb.cut_open(meshes, 0.5)
    for mesh, half in zip(meshes, halves, strict=True):
        assert half.is_watertight
        assert half.volume == pytest.approx(0.75 * mesh.volume)
        assert half.bounds[0, 1] == pytest.approx(0.5)
    assert all(len(half.faces) == 0 for half in glb.cut_open(meshes, 5.0))


def test_a_cut_away_part_is_no_part_of_the_model(bar: DensityObject, tmp_path: Path) -> None:
    empty = trimesh.Trimesh()
    meshes = [bar.parts[0].mesh, empty]
    colours = [np.zeros((len(mesh.vertices), 4), dtype=np.uint8) for mesh in meshes]
    glb.write_glb(tmp_path / "one.glb", bar.parts, meshes, colours)
    assert set(trimesh.load_scene(tmp_path / "one.glb").geometry) == {"plastic"}


def test_refining_keeps_the_shape_and_bounds_the_edges(bar: DensityObject) -> None:
    mesh = bar.parts[0].mesh
    fine = glb.refined(mesh, 0.1)
    assert fine.volume == pytest.approx(mesh.volume)
    assert fine.edges_unique_length.max() <= 0.3 + 1e-9


def test_refining_what_is_cut_away_leaves_nothing() -> None:
    assert not len(glb.refined(trimesh.Trimesh(), 0.1).faces)


def test_a_linear_field_is_read_half_a_voxel_below_the_surface() -> None:
    ball = trimesh.creation.icosphere(subdivisions=3, radius=2.0)
    axis = -3.75 + 0.5 * np.arange(16)
    field = np.broadcast_to(axis[:, None, None] + 10.0, (16, 16, 16)).copy()
    values = glb.surface_values(ball, field, np.full(3, -3.75), 0.5)
    np.testing.assert_allclose(values, 10 + ball.vertices[:, 0] * 1.75 / 2, atol=0.01)


def shade(picture: str) -> float:
    """Mean of the seen part of the image in an SVG."""
    data = re.findall(r"data:image/png;base64,([^\"]+)", picture)[0]
    with Image.open(io.BytesIO(base64.b64decode(data))) as image:
        grey, alpha = np.moveaxis(np.asarray(image.convert("LA")), -1, 0)
    return float(grey[alpha == 255].mean())


def test_a_slice_shows_the_cavity(reference: Reference, tmp_path: Path) -> None:
    explorer = explorer_of(reference, tmp_path, None)
    fields = explorer.fields("hollow-0002", None)
    through, *_ = explorer.slices(fields, 0, 32)
    beside, *_ = explorer.slices(fields, 0, 6)
    assert shade(through) < shade(beside) - 1  # viridis: nothing is darkest


def test_the_middle_of_the_axes_is_the_middle_of_the_object(
    reference: Reference, tmp_path: Path
) -> None:
    fields = explorer_of(reference, tmp_path, None).fields("bar-0002", None)
    np.testing.assert_allclose(fields.limits_cm, [[0, 2], [0, 2], [0, 4]], atol=0.07)


def test_without_a_file_there_is_no_prediction_and_no_error(
    reference: Reference, tmp_path: Path
) -> None:
    explorer = explorer_of(reference, tmp_path, None)
    fields = explorer.fields("bar-0002", entry(reference))
    assert fields.guess is None
    assert fields.error is None
    assert explorer.slices(fields, 1, 30)[1:] == (None, None)


def test_the_error_is_prediction_less_truth_inside_the_envelope(
    reference: Reference, tmp_path: Path, submission: Submit
) -> None:
    file = submission(lambda _, grid: grid + np.float32(0.5))
    fields = explorer_of(reference, tmp_path, file).fields("bar-0002", entry(reference))
    assert fields.error is not None
    inside = fields.obj.envelope > 0
    np.testing.assert_allclose(fields.error[inside], 0.5, atol=2e-3)
    assert not fields.error[~inside].any()
    assert fields.error_limit == pytest.approx(0.5, abs=2e-3)


def test_part_densities_are_shown_as_the_grid_they_are_scored_as(
    reference: Reference, tmp_path: Path, submission: Submit
) -> None:
    ones = {one: np.array([0.0] + [1.0] * reference.truth(one).parts) for one in reference.ids}
    file = submission(lambda one, _: ones[one], inputs=("mesh", "parts"))
    fields = explorer_of(reference, tmp_path, file).fields("bar-0002", entry(reference))
    assert fields.guess is not None
    volume_cm3 = fields.guess.sum() * fields.obj.voxel_size_cm**3
    assert volume_cm3 == pytest.approx(sum(part.mesh.volume for part in fields.obj.parts), rel=1e-3)


def test_truth_and_prediction_share_a_scale_that_holds_both(
    reference: Reference, tmp_path: Path, submission: Submit
) -> None:
    file = submission(lambda _, grid: 2 * grid)
    fields = explorer_of(reference, tmp_path, file).fields("bar-0002", entry(reference))
    assert fields.scale.get_clim() == pytest.approx((0.0, 16.0), rel=1e-3)


def test_an_object_without_density_is_compared_by_attenuation(
    reference: Reference, tmp_path: Path
) -> None:
    bare = box_object("bare", HOLLOW, density_known=False)
    explorer = explorer_of(reference, tmp_path, None)
    explorer.object = lambda _: bare  # type: ignore[assignment]
    assert explorer.fields("bare", None).target == "apparent_density"
    with pytest.raises(DataError, match="bare has no density, only attenuation"):
        explorer.fields("bare", entry(reference))


@pytest.mark.parametrize(
    "colour",
    ["density", *(pytest.param(one, marks=pytest.mark.slow) for one in ("density sd", "error"))],
)
def test_models_are_made_whole_and_cut(
    reference: Reference, tmp_path: Path, submission: Submit, colour: Any
) -> None:
    scratch = tmp_path / "models"
    scratch.mkdir()
    explorer = explorer_of(reference, scratch, submission(lambda _, grid: 2 * grid))
    fields = explorer.fields("bar-0002", entry(reference))
    whole, bar = explorer.model(fields, colour, False)
    half, _ = explorer.model(fields, colour, True)
    assert whole != half
    assert trimesh.load_scene(whole).extents[2] == pytest.approx(0.02)
    assert trimesh.load_scene(half).extents[2] == pytest.approx(0.01)
    assert 'aria-label="Colour scale: ' in bar


def test_only_the_models_made_last_are_kept(
    reference: Reference, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("xden_bench.serve.explorer.MODELS_KEPT", 2)
    scratch = tmp_path / "models"
    scratch.mkdir()
    for age, name in enumerate(("third", "second", "first")):
        (scratch / f"{name}.glb").touch()
        os.utime(scratch / f"{name}.glb", ns=(10**9 - age, 10**9 - age))
    explorer_of(reference, scratch, None)._forget_old_models()
    assert sorted(path.stem for path in scratch.iterdir()) == ["second", "third"]


def test_methods_are_those_of_the_dataset_and_split(reference: Reference, tmp_path: Path) -> None:
    mine = entry(reference)
    elsewhere = entry(reference, dataset={**mine["dataset"], "manifest_sha256": "b" * 64})
    val = entry(reference, dataset={**mine["dataset"], "split": "val"})
    explorer = explorer_of(reference, tmp_path, None)
    (label,) = explorer.methods((mine, elsewhere, val), "test")
    assert label == "test · geometry · density · v1 · aaaaaaaa"
    assert not explorer.stored(mine)


def test_the_part_table_has_what_its_headings_say(reference: Reference, tmp_path: Path) -> None:
    explorer = explorer_of(reference, tmp_path, None)
    plastic, steel = (
        dict(zip(PART_HEADINGS, row, strict=True)) for row in explorer.parts("bar-0002")
    )
    assert steel["density, g/cm³"] == 8.0
    assert steel["sd, g/cm³"] == 0.08
    assert plastic["volume, cm³"] == 8.0
    assert plastic["source"] == "truth"


def test_splits_for_testing_come_first(reference: Reference, tmp_path: Path) -> None:
    assert explorer_of(reference, tmp_path, None).splits == ("test", "val", "train")


def test_radiographs_say_how_they_came_to_be(
    bar: DensityObject, monkeypatch: pytest.MonkeyPatch
) -> None:
    titles: list[str] = []
    monkeypatch.setattr(figures, "_radiograph", lambda *how: titles.append(how[3]) or "")
    figures.radiograph_pictures(compare(bar, bar.views[0]), "phantom", "PA")
    assert titles[:2] == ["PA simulated", "PA reprojected parts"]
    assert titles[2].startswith("PA residual, mean |r| = ")


def test_names_of_strangers_are_drawn_as_text() -> None:
    found = {"density_mae_g_cm3": {"mean": 1.0, "ci95": [0.5, 2.0]}}
    rows = [{"method": {"name": "$\\frac{x}$<b>\u202e" * 2}, "metrics": found}]
    picture = figures.interval_picture(rows, "density_mae_g_cm3", "density MAE", [""])
    assert "$\\frac{x}$&lt;b&gt;?" in picture


def test_a_picture_has_the_pages_colour_no_ground_and_words_for_who_does_not_see_it() -> None:
    picture = figures.bar_picture(figures.density_scale(2.0), 'density "x", g/cm³')
    assert picture.startswith('<svg role="img" aria-label="Colour scale: density &quot;x&quot;')
    assert "currentColor" in picture
    assert "fill: #ffffff" not in picture
    assert "<style" not in picture


def test_an_oracle_is_a_dashed_line_and_a_row_without_a_rank_is_grey_and_last() -> None:
    def row(name: str, mean: float) -> dict[str, Any]:
        found = {"mean": mean, "ci95": [mean, mean + 1]}
        return {"method": {"name": name}, "metrics": {"com_l1_cm": found}}

    rows = [row("oracle", 0.1), row("trivial", 0.2), row("ranked", 0.3)]
    reasons = ["oracle: it is told", "trivial", ""]
    picture = figures.interval_picture(rows, "com_l1_cm", "CoM", reasons)
    assert picture.count("stroke-dasharray: 4.8,3.6") == 1
    assert picture.count(figures.RANKED) < picture.count(figures.FAINT)
    assert picture.index(">ranked<") < picture.index(">oracle<") < picture.index(">trivial<")


def test_problems_are_listed_with_code_object_and_meaning() -> None:
    found = (Problem("E403", "mug", "3 values"), Problem("E301", None, "1 missing"))
    headings, rows = words.problem_rows(found)
    assert len(headings) == 4
    assert rows == [
        ["E403", "mug", CODES["E403"], "3 values"],
        ["E301", "file", CODES["E301"], "1 missing"],
    ]


def test_a_result_has_its_mean_by_category_and_its_interval_or_a_dash() -> None:
    known = {"mean": 0.25, "macro_mean": 0.3, "ci95": [0.125, 0.5]}
    found = {"mass_mape": known, "mass_alde": {"mean": 0.5, "ci95": None}}
    assert words.result_rows(found)[1] == [
        ["mass MAPE ↓", "0.2500", "0.3000", "0.1250 to 0.5000"],
        ["mass ALDE ↓", "0.5000", "-", "-"],
    ]


def test_the_line_of_an_object_says_that_it_was_never_on_a_scanner(bar: DensityObject) -> None:
    line = words.object_line(replace(bar, flags=("dusty",), weighed_mass_g=71.5))
    assert "simulated, never on a scanner" in line
    assert "72 g · weighed 71.5 g" in line
    assert "flag dusty" in line


def test_users_are_counted_by_address_or_by_account(monkeypatch: pytest.MonkeyPatch) -> None:
    visitor: Any = SimpleNamespace(client=SimpleNamespace(host="10.0.0.1"), session={})
    assert words.user_of(visitor, login=False) == "10.0.0.1"
    with turned_away("not_here", "log in"):
        words.user_of(visitor, login=True)
    user = SimpleNamespace(preferred_username="ada")
    found = SimpleNamespace(user_info=user)
    monkeypatch.setattr("huggingface_hub.parse_huggingface_oauth", lambda _: found)
    assert words.user_of(visitor, login=True) == "ada"


def test_the_space_starts_the_same_app_behind_a_login(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[Any] = []
    monkeypatch.setattr(site, "take_address", lambda *where: nullcontext(where))
    monkeypatch.setattr(site, "run", lambda *args: started.append(args))
    monkeypatch.setenv("XDEN1K_ROOT", str(dataset))
    monkeypatch.setenv("XDEN_DESK", str(tmp_path))
    runpy.run_path(str(ROOT / "benchmarks" / "space" / "app.py"), run_name="__main__")
    ((made, *how),) = started
    assert made.login
    assert made.results == tmp_path / "results"
    assert how == [("0.0.0.0", 7860), print]  # noqa: S104
