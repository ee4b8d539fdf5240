"""Disturbed radiographs: each disturbance in closed form, and copies that say what they are."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from click.testing import CliRunner, Result

from tests.phantoms import BAR, CUBE, FILLED, Box, box_object
from xden1k.errors import DataError
from xden1k.folder import DatasetFolder, open_folder, write_folder
from xden1k.folder.verify import verify_folder
from xden1k.format.schema import RADIOGRAPH_COLUMNS
from xden1k.values.types import DensityObject
from xden1k.values.views import XRayView
from xden_bench.cli import cli
from xden_bench.datasets import exchange
from xden_bench.datasets.disturbances import (
    Averaged,
    Disturbance,
    Enlarged,
    Misplaced,
    Noisier,
    Shifted,
    noise_sd,
)
from xden_bench.datasets.exchange import Exchanged

NOISE = 0.004


def noisy(object_id: str, boxes: Sequence[Box], split: str = "test") -> DensityObject:
    """Boxes in fine radiographs, with noise as counting makes it."""
    obj = box_object(object_id, boxes, shape=(128, 112), split=split, category=object_id[:-5])
    rng = np.random.default_rng(zlib.crc32(object_id.encode()))

    def exposed(view: XRayView) -> XRayView:
        light = view.transmission
        noise = NOISE * np.sqrt(light) * rng.standard_normal(light.shape)
        return replace(view, transmission=(light + noise).astype(np.float32))

    first, second = obj.views
    return replace(obj, views=(exposed(first), exposed(second)))


@pytest.fixture(scope="module")
def bar() -> DensityObject:
    return noisy("bar-0001", BAR)


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("disturbing") / "dataset"
    objects = [
        noisy("bar-0001", BAR, split="train"),
        noisy("bar-0002", BAR),
        noisy("bar-0003", BAR),
        noisy("cube-0001", CUBE),
        noisy("filled-0001", FILLED),
    ]
    write_folder(objects, path, version="0.1.0", builder="tests")
    return path


def run(*words: object) -> Result:
    return CliRunner().invoke(cli, [str(word) for word in words])


def after(disturbance: Disturbance, obj: DensityObject, seed: int = 0) -> tuple[XRayView, ...]:
    return disturbance(obj, np.random.default_rng(seed))


def test_a_shift_is_a_roll_away_from_the_edge_and_leaves_the_geometry(bar: DensityObject) -> None:
    directions = set()
    for seed in range(16):
        for old, new in zip(bar.views, after(Shifted(3), bar, seed), strict=True):
            assert new.geometry is old.geometry
            inner = np.s_[3:-3, 3:-3]
            rolls = {
                (axis, by): np.roll(old.transmission, by, axis) for axis in (0, 1) for by in (3, -3)
            }
            (found,) = (
                which
                for which, rolled in rolls.items()
                if np.array_equal(rolled[inner], new.transmission[inner])
            )
            directions.add((new.name, *found))
            np.testing.assert_array_equal(np.roll(old.valid, found[1], found[0])[inner],
                                          new.valid[inner])  # fmt: skip
    assert len(directions) == 8, "either way, along rows and columns, each view by itself"


@pytest.mark.parametrize("nothing", [Shifted(0), Enlarged(1.0), Noisier(1.0), Misplaced(0, 0)])
def test_nothing_done_changes_no_bit(bar: DensityObject, nothing: Disturbance) -> None:
    for old, new in zip(bar.views, after(nothing, bar), strict=True):
        np.testing.assert_array_equal(new.transmission[old.valid], old.transmission[old.valid])
        np.testing.assert_array_equal(new.valid, old.valid)
        np.testing.assert_allclose(new.geometry.matrix, old.geometry.matrix, atol=1e-12)


def test_enlarging_spreads_a_ramp_about_the_centre_and_keeps_dead_pixels_out(
    bar: DensityObject,
) -> None:
    (view, _) = bar.views
    rows, columns = np.indices(view.geometry.shape, dtype=np.float32)
    middle = [(size - 1) / 2 for size in view.geometry.shape]
    ramp = 0.5 + 0.001 * (rows - middle[0]) + 0.002 * (columns - middle[1])
    ramp[~view.valid] = np.nan
    flat = replace(bar, views=(replace(view, transmission=ramp), bar.views[1]))
    (new, _) = after(Enlarged(1.25), flat)
    expected = 0.5 + (0.001 * (rows - middle[0]) + 0.002 * (columns - middle[1])) / 1.25
    near = new.valid & ~np.isclose(new.transmission, expected, atol=1e-5)
    assert np.isfinite(new.transmission[new.valid]).all()
    assert near.sum() <= 12, "only about the dead pixel, by less than a pixel's step"
    np.testing.assert_allclose(new.transmission[new.valid], expected[new.valid], atol=0.003)


def test_noise_is_doubled_beside_the_object_and_in_its_shade(bar: DensityObject) -> None:
    (old, _) = bar.views
    (new, _) = after(Noisier(2.0), bar)
    added = (new.transmission - old.transmission)[old.valid]
    light = old.transmission[old.valid]
    beside = old.valid & (old.transmission > 0.95)
    assert noise_sd(new.transmission, beside) == pytest.approx(2 * NOISE, rel=0.05)
    in_shade = light < 0.9
    assert in_shade.sum() > 200
    there = NOISE * np.sqrt(light[in_shade])
    assert np.std(added[in_shade] / there) == pytest.approx(np.sqrt(3), rel=0.1)


def test_what_has_no_noise_cannot_have_more_of_it() -> None:
    with pytest.raises(DataError, match=r"bar-0001, view pa: no noise beside the object"):
        after(Noisier(2.0), box_object("bar-0001", BAR))


def test_a_mean_keeps_the_shadow_its_mean_and_all_beside_it(bar: DensityObject) -> None:
    for old, new in zip(bar.views, after(Averaged(), bar), strict=True):
        changed = (old.transmission != new.transmission) & old.valid
        assert len(np.unique(new.transmission[changed])) == 1
        assert changed.sum() > 200
        assert old.transmission[old.valid & ~changed].min() > 0.9
        assert new.transmission[changed][0] == pytest.approx(old.transmission[changed].mean())


def test_an_exchange_is_a_derangement_within_each_split(root: Path, tmp_path: Path) -> None:
    objects = [noisy(f"{name}-000{i}", boxes) for name, boxes in KINDS for i in (1, 2)]
    write_folder(objects, tmp_path / "dataset", version="0.1.0", builder="tests")
    folder = open_folder(tmp_path / "dataset")
    drawn = [Exchanged.drawn(folder, ["test"], seed).givers for seed in range(12)]
    for givers in drawn:
        assert sorted(givers) == sorted(givers.values()) == sorted(folder.ids("test"))
        assert not [one for one, giver in givers.items() if one == giver]
    assert len({tuple(sorted(givers.items())) for givers in drawn}) > 3
    with pytest.raises(DataError, match="the split train has nobody to exchange with"):
        Exchanged.drawn(open_folder(root), ["train"], 0)


def test_what_fills_its_cube_shows_nothing_of_others_and_another_gives_twice(root: Path) -> None:
    folder = open_folder(root)
    assert not exchange._is_shown(folder, "bar-0002", "cube-0001")
    for seed in range(3):
        found = Exchanged.drawn(folder, ["test"], seed)
        assert sorted(found.givers) == sorted(folder.ids("test"))
        assert "cube-0001" not in found.givers.values()
        assert found.left_out == ()


def dimmed(view: XRayView) -> XRayView:
    return replace(view, transmission=(view.transmission / 1.06).astype(np.float32))


APART = (Box("left", (-4, -1, -1), (-3, 1, 1), 1.0), Box("right", (3, -1, -1), (4, 1, 1), 2.0))
"""Nothing where a rod in the middle would be."""
ROD = (Box("rod", (-0.3, -0.3, -4), (0.3, 0.3, 4), 1.0),)
KINDS = (("bar", BAR), ("filled", FILLED))
"""Each shows something of each other."""


def test_nobody_gets_radiographs_that_show_nothing_of_it(tmp_path: Path) -> None:
    objects = [
        noisy("pair-0001", APART),
        noisy("pair-0002", APART),
        *(noisy(f"rod-000{number}", ROD) for number in (1, 2, 3)),
    ]
    write_folder(objects, tmp_path / "dataset", version="0.1.0", builder="tests")
    folder = open_folder(tmp_path / "dataset")
    assert not exchange._is_shown(folder, "rod-0001", "pair-0001")
    for seed in range(3):
        givers = Exchanged.drawn(folder, ["test"], seed).givers
        assert sorted(givers) == sorted(givers.values())
        assert all(exchange._is_shown(folder, *pair) for pair in givers.items())


def test_a_shadow_brighter_than_air_should_be_shows_nothing(tmp_path: Path) -> None:
    rod = noisy("rod-0001", ROD)
    faint = [
        replace(view, transmission=(1 - 0.5 * (1 - view.transmission)) * 1.06) for view in rod.views
    ]
    for name, views in (("over", faint), ("right", [dimmed(one) for one in faint])):
        giver = replace(rod, object_id="rod-0002", views=tuple(views))
        write_folder([rod, giver], tmp_path / name, version="0.1.0", builder="tests")
    assert not exchange._is_shown(open_folder(tmp_path / "over"), "rod-0001", "rod-0002")
    assert exchange._is_shown(open_folder(tmp_path / "right"), "rod-0001", "rod-0002")


def test_who_is_shown_nothing_by_anybody_is_left_out_and_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    objects = [noisy("pair-0001", APART), noisy("pair-0002", APART), noisy("rod-0001", ROD)]
    write_folder(objects, tmp_path / "dataset", version="0.1.0", builder="tests")
    done = run("disturb", "dataset", "--out", "copy", "--swap")
    assert done.exit_code == 0, done.output
    named = "(left out, for want of any that show something of them: rod-0001)"
    assert done.stdout.startswith("copy: 2 objects")
    assert named in done.stdout
    copy = open_folder(tmp_path / "copy")
    assert copy.ids() == ("pair-0001", "pair-0002")
    assert copy.manifest.disturbed is not None
    assert named in copy.manifest.disturbed.radiographs
    assert verify_folder(copy.root) == []
    asked = ("one-region", "--task", "segments", "--root", "copy", "--out", "segments.npz")
    assert run("baseline", *asked).exit_code == 0
    scored = run("segment", "score", "segments.npz", "--root", "copy")
    assert "2 objects (phantom)" in scored.stdout


def test_exchanged_images_are_the_givers_to_the_bit_where_sizes_agree(root: Path) -> None:
    folder = open_folder(root)
    receiver, giver = (folder.object(one) for one in ("bar-0002", "bar-0003"))
    swapped = after(Exchanged(folder, {"bar-0002": "bar-0003"}), receiver)
    for new, theirs, own in zip(swapped, giver.views, receiver.views, strict=True):
        np.testing.assert_array_equal(new.transmission, theirs.transmission)
        assert not np.array_equal(new.transmission, own.transmission)
        assert new.geometry is own.geometry


def extent(view: XRayView) -> np.ndarray:
    """Rows and columns of a shadow."""
    dark = view.valid & (view.transmission < 0.9)
    return np.array([np.ptp(places) + 1 for places in np.nonzero(dark)])


def cube_extent(obj: DensityObject, view: XRayView) -> np.ndarray:
    """Rows and columns of the projected cube of the grids."""
    ends = (-0.5, 63.5)
    corners = obj.origin_cm + obj.voxel_size_cm * np.array(list(product(ends, repeat=3)))
    columns, rows, _ = view.geometry.project(corners).T
    return np.array([np.ptp(rows), np.ptp(columns)])


def test_an_exchanged_object_fills_as_much_of_its_cube_as_it_did(root: Path) -> None:
    folder = open_folder(root)
    bar, cube = folder.object("bar-0002"), folder.object("cube-0001")
    for receiver, giver in ((bar, cube), (cube, bar)):
        swapped = after(Exchanged(folder, {receiver.object_id: giver.object_id}), receiver)
        for new, theirs in zip(swapped, giver.views, strict=True):
            before = extent(theirs) / cube_extent(giver, theirs)
            now = extent(new) / cube_extent(receiver, new)
            np.testing.assert_allclose(now, before, atol=0.05)


def test_mesh_errors_move_the_told_geometry_as_a_rigid_body(bar: DensityObject) -> None:
    moved = after(Misplaced(1.0, 0.1), bar)
    half = 32 * bar.voxel_size_cm
    centre = bar.origin_cm + half - bar.voxel_size_cm / 2
    turns = []
    for old, new in zip(bar.views, moved, strict=True):
        np.testing.assert_array_equal(new.transmission, old.transmission)
        turn = new.geometry.matrix @ np.linalg.inv(old.geometry.matrix)
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-9)
        angle = np.degrees(np.arccos((np.trace(turn) - 1) / 2))
        assert angle == pytest.approx(1.0, rel=1e-4)
        assert old.geometry.source_cm is not None
        offset = new.geometry.source_cm - turn @ (old.geometry.source_cm - centre) - centre
        assert np.linalg.norm(offset) == pytest.approx(0.1, rel=1e-6)
        turns.append((turn, offset))
    for first, second in zip(*turns, strict=True):
        np.testing.assert_allclose(first, second, atol=1e-9)


OPTIONS = (
    ("--swap",),
    ("--mean",),
    ("--shift-px", 3),
    ("--scale", 1.05),
    ("--noise", 2),
    ("--mesh-error", 1, 0.1),
)


@pytest.fixture(scope="module", params=OPTIONS, ids=lambda words: words[0])
def copy(root: Path, tmp_path_factory: pytest.TempPathFactory, request: Any) -> DatasetFolder:
    out = tmp_path_factory.mktemp("copies") / "copy"
    done = run("disturb", root, "--out", out, "--split", "test", *request.param)
    assert done.exit_code == 0, done.output
    return open_folder(out)


def plain(row: Mapping[str, Any], name: str) -> Any:
    return bytes(row[name]) if isinstance(row[name], pa.Buffer) else row[name]


def test_the_truth_of_a_copy_is_the_same_to_the_bit(root: Path, copy: DatasetFolder) -> None:
    whole = open_folder(root)
    assert verify_folder(copy.root) == []
    assert copy.ids() == whole.ids("test")
    differing = set()
    for object_id in copy.ids():
        old, new = whole.row(object_id), copy.row(object_id)
        differing |= {name for name in old if plain(old, name) != plain(new, name)}
    assert differing, "something was disturbed"
    assert differing <= {*RADIOGRAPH_COLUMNS, "meta_json"}
    assert not {"xray_pa", "meta_json"} <= differing, "radiographs or geometry, never both"


def test_a_copy_says_what_it_is_and_no_board_takes_it(
    root: Path, copy: DatasetFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    told = copy.manifest.disturbed
    assert told is not None
    assert told.of == open_folder(root).manifest_sha256 != copy.manifest_sha256
    assert f"radiographs {told.radiographs}" in (copy.root / "README.md").read_text("utf-8")
    made = run("baseline", "water", "--root", copy.root, "--out", "water.npz")
    assert made.exit_code == 0, made.output
    assert run("score", "water.npz", "--root", copy.root).exit_code == 0
    for words in (("submit",), ("submit", "--out", "results"), ("segment", "submit")):
        refused = run(*words, "water.npz", "--root", copy.root)
        assert refused.exit_code == 1
        assert "no entry can be made on it, only scored" in refused.stderr
    assert not (tmp_path / "results").exists()
    again = run("disturb", copy.root, "--out", "again", "--mean")
    assert f"its radiographs {told.radiographs} already" in again.stderr
    key = run("keygen", "organiser.key")
    assert key.exit_code == 0
    sealed = run("seal", copy.root, "--key", "organiser.key", "--out", "sealed")
    assert f"its radiographs {told.radiographs}" in sealed.stderr


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ((), "Give one of --swap, --mean, --shift-px, --scale, --noise, --mesh-error; got 0."),
        (("--swap", "--mean"), "got 2."),
        (("--shift-px", "-1"), "-1 is not in the range x>=0"),
        (("--noise", "0.5"), "0.5 is not in the range x>=1"),
        (("--mean", "--split", "dev"), "no split 'dev'"),
        (("--swap", "--split", "train"), "the split train has nobody to exchange with"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(
    root: Path, tmp_path: Path, words: tuple[str, ...], expected: str
) -> None:
    done = run("disturb", root, "--out", tmp_path / "copy", *words)
    assert done.exit_code in (1, 2)
    assert expected in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_the_same_seed_gives_the_same_bytes_and_nothing_is_overwritten(
    root: Path, tmp_path: Path
) -> None:
    words = ("--split", "test", "--shift-px", 2, "--json", "--seed")
    sums = []
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        done = run("disturb", root, "--out", tmp_path / name, *words, seed)
        assert json.loads(done.stdout)["disturbed"]["seed"] == seed
        sums.append(open_folder(tmp_path / name).manifest_sha256)
    assert sums[0] == sums[1] != sums[2]
    refused = run("disturb", root, "--out", tmp_path / "a", *words, 1)
    assert "exists: remove it yourself" in refused.stderr


def test_objects_without_radiographs_are_refused(tmp_path: Path) -> None:
    bare = replace(box_object("bar-0001", BAR, split="test"), views=(), source="published")
    write_folder([bare], tmp_path / "bare", version="0.1.0", builder="tests")
    done = run("disturb", tmp_path / "bare", "--out", tmp_path / "copy", "--mean")
    assert "1 objects of the split test have no radiographs" in done.stderr
