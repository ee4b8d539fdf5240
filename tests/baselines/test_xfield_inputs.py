"""What X-Field is shown: crops, projections, the outer surface, and nothing of the inside."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import binary_erosion

from tests.baselines.pixie_scenes import written
from tests.phantoms import APPARENT, BAR, CUBE, NAN, Box, box_object, geometry
from xden1k.access.samples import Example, Examples, SampleView
from xden1k.errors import DataError
from xden1k.folder import DatasetFolder, open_folder, write_rows
from xden1k.format.cache import LIMIT_VARIABLE, PieceCache
from xden1k.format.records import object_row
from xden1k.format.schema import RADIOGRAPH_COLUMNS
from xden1k.predictions import Target
from xden1k.values.modality import Modality
from xden1k.values.physics import PAPER_MAC_CM2_G
from xden1k.values.types import DensityObject
from xden1k.values.views import ViewGeometry
from xden_baselines.xfield import lessons
from xden_baselines.xfield.__main__ import cli
from xden_baselines.xfield.batches import gathered, inputs_of, mirrored
from xden_baselines.xfield.crops import Crop, Cube, projection
from xden_baselines.xfield.lessons import Lesson, kept_lesson, lesson, third_view
from xden_baselines.xfield.rays import projected, ray_channels, sampled
from xden_baselines.xfield.seen import seen
from xden_baselines.xfield.sizes import SIZES
from xden_baselines.xray import mean_lac_per_cm

READS = Modality.GEOMETRY | Modality.XRAY
TINY = SIZES["tiny"]
SHELL = Box("shell", (-2, -2, -2), (2, 2, 2), 1.5, hole=((-1, -1, -1), (1, 1, 1)))
FULL = (SHELL, Box("core", (-1, -1, -1), (1, 1, 1), 4.0))
HALF = (SHELL, Box("core", (-1, -0.5, -0.5), (1, 0.5, 0.5), 8.0))


def folder_of(root: Path, obj: DensityObject, **columns: object) -> DatasetFolder:
    """A dataset of one object, with these columns in place of its own."""
    write_rows([object_row(obj) | columns], root, version="0.1.0", builder="tests")
    return open_folder(root)


def example(folder: DatasetFolder, reads: Modality = READS) -> Example:
    return next(iter(Examples(folder, "train", reads)))


@st.composite
def views(draw: st.DrawFn) -> ViewGeometry:
    """Cone and parallel beams onto skewed detectors of any pixel, about along y."""
    some = st.floats(-0.2, 0.2)
    beam = np.array([draw(some), 1, draw(some)])
    place = {
        "cone": {"source_cm": -40 * beam},
        "parallel": {"direction": beam},
    }
    kind = draw(st.sampled_from(sorted(place)))
    return ViewGeometry(
        beam=kind,
        pixel00_cm=np.array([-8.0, 9.0, 8.0]),
        column_step_cm=np.array([draw(st.floats(0.1, 0.3)), draw(some) / 10, 0]),
        row_step_cm=np.array([0, draw(some) / 10, -draw(st.floats(0.1, 0.3))]),
        shape=(80, 70),
        **place[kind],
    )


@given(views(), st.sampled_from([8, 33]))
def test_a_point_lies_in_the_crop_where_its_ray_meets_the_radiograph(
    view: ViewGeometry, size: int
) -> None:
    cube = Cube(np.array([0.5, -0.25, 1.0]), 2.0)
    places = np.random.default_rng(0).uniform(-1, 1, (50, 3))
    crop = Crop.around(cube, view, size)
    column, row, _ = view.project(cube.centre_cm + cube.half_cm * places).T
    wanted = np.stack([column - crop.left, row - crop.top], axis=1) / crop.side * 2 - 1
    matrix = torch.from_numpy(projection(crop.geometry(view), cube))
    found = projected(matrix[None, None], torch.from_numpy(places)[None])[0, 0].numpy()
    assert np.abs(found - wanted).max() < 1e-4 / size
    assert (np.abs(found) <= 1 / 1.05 + 1e-9).all(), "the crop is the cube with its margin"


@given(views(), st.sampled_from([8, 33]))
def test_places_go_from_the_crop_to_the_radiograph_and_back(view: ViewGeometry, size: int) -> None:
    crop = Crop.around(Cube(np.array([0.5, -0.25, 1.0]), 2.0), view, size)
    window = crop.geometry(view)
    column, row = np.random.default_rng(0).uniform(-0.5, size - 0.5, (2, 50))
    there = view.project(window.pixel_centres_cm(row, column))[:, :2]
    back = (there - [crop.left, crop.top]) / crop.width - 0.5
    assert np.allclose(back, np.stack([column, row], axis=1), atol=1e-6)
    again = window.project(view.pixel_centres_cm(there[:, 1], there[:, 0]))[:, :2]
    assert np.allclose(again, back, atol=1e-6)


def test_averaging_keeps_a_ramp_and_passes_over_dead_pixels() -> None:
    rows, columns = np.indices((30, 40))
    ramp = (2 * rows - columns).astype(np.float32)
    valid = np.ones(ramp.shape, dtype=bool)
    crop = Crop(left=3.5, top=6.5, side=20, size=5)  # four pixels to each of the crop
    means, covered = crop.averaged(ramp, valid)
    at = 4 * np.arange(5) + 1.5
    assert covered.all()
    assert np.allclose(means, 2 * (7 + at)[:, None] - (4 + at))
    some = valid & (columns != 12)
    same, _ = crop.averaged(np.where(some, 7, np.nan).astype(np.float32), some)
    assert np.allclose(same, 7)
    none, left = crop.averaged(ramp, valid & (columns < 4))
    assert not left.any()
    assert not none.any()


def test_area_is_averaged_exactly() -> None:
    image = np.array([[1, 2, 3], [4, 5, 6], [7, 8, 9]], dtype=np.float32)
    means, _ = Crop(0, 0, 2, 1).averaged(image, np.ones((3, 3), dtype=bool))
    # from the middle of pixel (0, 0) to that of (2, 2)
    weights = np.outer([0.5, 1, 0.5], [0.5, 1, 0.5]) / 4
    assert means.item() == pytest.approx((weights * image).sum())


def test_a_homogeneous_body_has_its_density_along_every_chord(tmp_path: Path) -> None:
    one = example(written(tmp_path, CUBE))
    shown = inputs_of([seen(one.sample, 64, 32)])
    mean = 4 * ray_channels(shown.transmission, shown.chord, shown.half_cm)[0, :, 2]
    length_cm = (shown.chord * shown.half_cm)[0]
    lac_per_cm = 2.0 * APPARENT * PAPER_MAC_CM2_G
    inside = torch.from_numpy(binary_erosion(length_cm > 1.9, np.ones((1, 5, 5))))
    wanted = lac_per_cm * length_cm / (0.2 * length_cm + 0.02)
    assert inside.sum() > 200
    assert torch.allclose(mean[inside], wanted[inside], rtol=0.02)


def test_the_brightness_of_a_radiograph_does_not_matter(tmp_path: Path) -> None:
    obj = box_object("cube-0001", CUBE, shape=(48, 48), split="train")
    brighter = replace(
        obj,
        views=tuple(replace(view, transmission=0.93 * view.transmission) for view in obj.views),
    )
    one, two = (
        seen(example(folder_of(tmp_path / name, each)).sample, 8, 32).transmission
        for name, each in (("one", obj), ("two", brighter))
    )
    assert np.allclose(one, two, atol=2e-3)


def test_nothing_of_the_inside_is_seen_but_by_the_radiographs(tmp_path: Path) -> None:
    full, half = (
        example(written(tmp_path / str(number), boxes)).sample
        for number, boxes in enumerate((FULL, HALF))
    )
    one, two = seen(full, 256, 32), seen(half, 256, 32)
    for name in ("surface", "chord", "projection", "half_cm"):
        assert np.array_equal(getattr(one, name), getattr(two, name)), name
    assert not np.array_equal(one.transmission, two.transmission)


def test_surface_points_lie_on_the_outside_and_look_outwards(tmp_path: Path) -> None:
    sample = example(written(tmp_path, FULL)).sample
    surface = seen(sample, 500, 32).surface
    places, normals = surface[:, :3], surface[:, 3:]
    assert np.allclose(np.abs(places).max(axis=1), 1 / 1.06, atol=1e-4)
    assert np.allclose((places * normals).sum(axis=1), 1 / 1.06, atol=1e-4)


def test_geometry_alone_has_no_views(tmp_path: Path) -> None:
    folder = written(tmp_path, CUBE)
    shown = seen(example(folder, Modality.GEOMETRY).sample, 8, 16)
    assert shown.transmission.shape == shown.chord.shape == (0, 16, 16)
    assert shown.projection.shape == (0, 3, 4)


@pytest.fixture(scope="module")
def full(tmp_path_factory: pytest.TempPathFactory) -> tuple[Example, Lesson]:
    one = example(written(tmp_path_factory.mktemp("lesson"), FULL))
    return one, lesson(one, TINY)


def test_a_lesson_knows_the_part_and_density_of_its_points(full: tuple[Example, Lesson]) -> None:
    _, made = full
    places = made.places(slice(None)) * made.half_cm
    core = np.abs(places).max(axis=1) < 1
    assert len(places) == 8192
    assert np.array_equal(made.owner == 2, core)
    assert made.densities_g_cm3.tolist() == [0, 1.5, 4.0]


def test_the_third_view_is_the_line_integral_along_z(full: tuple[Example, Lesson]) -> None:
    one, made = full
    box = box_object("flat", [Box("flat", (-2, -1, 0), (2, 0, 0.5), 1.0)])
    cube = Cube(np.zeros(3), 2.0)
    found = third_view(box, cube, 8)
    wanted = np.zeros((8, 8))
    wanted[:, 2:4] = 0.5 * APPARENT * PAPER_MAC_CM2_G  # rows along x, columns along y
    assert np.allclose(found, wanted, atol=1e-6)
    assert made.third.shape == (2 * TINY.plane,) * 2
    assert one.sample.object_id


def test_points_are_drawn_from_all_and_from_each_part_alike(full: tuple[Example, Lesson]) -> None:
    _, made = full
    batch = gathered([made] * 40, 400, np.random.default_rng(0))
    share = (made.owner == 2).mean()
    assert (batch.owner == 2).float().mean().item() == pytest.approx(share / 2 + 1 / 4, abs=0.02)
    density = (batch.weight * batch.density_g_cm3).mean().item()
    assert density == pytest.approx(4 * share + 1.5 * (1 - share), rel=0.02)


def test_a_mirrored_object_is_seen_as_one_that_was_made_so(tmp_path: Path) -> None:
    boxes = (Box("foot", (-2, -1, -1), (1, 1, 1), 1.0), Box("head", (1, -1, -1), (2, 0, 0), 4.0))
    turned = tuple(
        replace(one, low=(-one.high[0], *one.low[1:]), high=(-one.low[0], *one.high[1:]))
        for one in boxes
    )
    one, two = (
        lesson(example(written(tmp_path / str(number), each)), TINY)
        for number, each in enumerate((boxes, turned))
    )
    found = mirrored(one, [0])
    # the other view looks along x: a mirrored object is nearer to another source
    for name in ("transmission", "chord", "projection"):
        assert np.allclose(getattr(found, name)[0], getattr(two, name)[0], atol=5e-3), name
    assert np.allclose(found.third, two.third, atol=1e-3)
    head = found.places(found.owner == 2) * found.half_cm
    assert (head[:, 0] < -0.99).all()
    assert (found.surface[:, 0] == -one.surface[:, 0]).all()
    chords = sampled(
        torch.from_numpy(found.chord[:1].astype(np.float32))[None, 0:1],
        projected(
            torch.from_numpy(found.projection)[None, :1],
            torch.from_numpy(found.places(slice(99)))[None],
        )[:, 0],
    )
    assert (chords > 0).all(), "points lie in their own shadow"


def test_what_is_kept_is_what_is_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = PieceCache(tmp_path / "kept", 10**8)
    one = example(written(tmp_path / "dataset", FULL))
    made = kept_lesson(one, TINY, kept)
    monkeypatch.setattr(lessons, "lesson", lambda *_: pytest.fail("it was kept"))
    again = kept_lesson(one, TINY, kept)
    for name in ("surface", "voxels", "owner", "third", "transmission"):
        assert np.array_equal(getattr(made, name), getattr(again, name)), name
    other = example(written(tmp_path / "other", HALF))
    with pytest.raises(pytest.fail.Exception, match="it was kept"):
        kept_lesson(other, TINY, kept)


def dark(obj: DensityObject) -> DensityObject:
    empty = np.ones_like(obj.views[0].transmission)
    return replace(obj, views=(replace(obj.views[0], transmission=empty), obj.views[1]))


def away(obj: DensityObject) -> DensityObject:
    return replace(
        obj, views=(obj.views[0], replace(obj.views[1], geometry=geometry("lat", (48, 48), 0.8)))
    )


def masked(obj: DensityObject) -> DensityObject:
    nothing = np.zeros_like(obj.views[0].valid)
    nothing[0, 0] = True
    return replace(obj, views=(replace(obj.views[0], valid=nothing), obj.views[1]))


def same(obj: DensityObject) -> DensityObject:
    return obj


NO_LAT = {name: None for name in RADIOGRAPH_COLUMNS if "lat" in name}
Damage = Callable[[DensityObject], DensityObject]


@pytest.mark.parametrize(
    ("damage", "columns", "message"),
    [
        (dark, {}, "cube-0001: view pa shows nothing where the object is"),
        (away, {}, "cube-0001: view lat .* must show the whole object, .* pixels beyond it"),
        (masked, {}, "cube-0001: view pa must have valid pixels on and beside the object"),
        (lambda obj: replace(obj, views=()), {}, "cube-0001 has no radiographs"),
        (same, NO_LAT, "cube-0001: column xray_lat: expected an array, got nothing"),
    ],
)
def test_radiographs_that_do_not_show_the_object_are_refused_with_it_and_its_dataset_named_once(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    damage: Damage,
    columns: dict[str, None],
    message: str,
) -> None:
    monkeypatch.setenv(LIMIT_VARIABLE, "1")
    obj = damage(box_object("cube-0001", CUBE, shape=(48, 48), split="train"))
    folder = folder_of(tmp_path / "dataset", obj, **columns)
    with pytest.raises(DataError, match=message):
        seen(example(folder).sample, 8, 32)
    assert re.fullmatch(f"Error: {folder.root}: {message}\n", refused_training(folder))


def refused_training(folder: DatasetFolder) -> str:
    ran = CliRunner().invoke(cli, ["train", "x-field", "--root", str(folder.root)])
    assert ran.exit_code == 1
    return ran.stderr


def test_an_object_without_target_is_refused_with_it_and_its_dataset_named_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(LIMIT_VARIABLE, "1")
    obj = box_object("cube-0001", CUBE, shape=(48, 48), split="train", density_known=False)
    folder = folder_of(tmp_path / "dataset", obj)
    told = "cube-0001 has no density, only attenuation: take apparent_density"
    assert refused_training(folder) == f"Error: {folder.root}: {told}\n"


def test_a_dark_radiograph_divides_nothing_either(tmp_path: Path) -> None:
    obj = dark(box_object("cube-0001", CUBE, shape=(48, 48), split="train"))
    sample: SampleView = example(folder_of(tmp_path / "dataset", obj)).sample
    with pytest.raises(DataError, match="cube-0001: view pa shows nothing where the object is"):
        mean_lac_per_cm(sample, np.zeros((3, 3)))


@pytest.mark.parametrize(
    ("target", "unknown"),
    [
        ("density", {"density_g_cm3": NAN, "density_source": "none"}),
        ("apparent_density", {"apparent_density_g_cm3": NAN}),
        ("density", {"lac_per_cm": NAN}),
    ],
)
def test_a_part_whose_figure_is_to_be_learned_and_is_unknown_is_refused_by_name(
    tmp_path: Path, target: Target, unknown: dict[str, Any]
) -> None:
    obj = box_object("bar-0001", BAR, shape=(48, 48), split="train")
    steel = replace(obj.parts[1], **unknown)
    folder = folder_of(tmp_path / "dataset", replace(obj, parts=(obj.parts[0], steel)))
    sample = SampleView(folder, "bar-0001", READS, target=target)
    wanted = f"bar-0001: the part steel must have a finite {next(iter(unknown))} to be learned from"
    with pytest.raises(DataError, match=f"^{wanted}, got nan$"):
        lesson(Example(sample, sample.envelope), TINY)
