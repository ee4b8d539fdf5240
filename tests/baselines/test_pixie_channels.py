"""What a network is shown: geometry in closed form, colours, and what must not matter."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.baselines.pixie_scenes import (
    COLORS,
    altered,
    backwards,
    dataset,
    same_in_black,
    sample,
    written,
)
from tests.phantoms import BAR, Box
from xden1k.errors import DataError
from xden1k.folder import DatasetFolder
from xden1k.values.modality import Modality
from xden_baselines.pixie.channels import VECTORS, channel_names, channels

SHAPE = Modality.GEOMETRY
RGB = Modality.GEOMETRY | Modality.RGB
EVERY = RGB | Modality.XRAY
BENT = (*BAR, Box("foot", (0, 2, 0), (1, 3, 1)))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> DatasetFolder:
    return dataset(tmp_path_factory.mktemp("channels") / "dataset")


def named(folder: DatasetFolder, object_id: str, reads: Modality) -> dict[str, np.ndarray]:
    found = channels(sample(folder, object_id, reads))
    return dict(zip(channel_names(reads), found, strict=True))


def scaled(boxes: tuple[Box, ...], factor: float) -> tuple[Box, ...]:
    return tuple(
        replace(
            box,
            low=tuple(factor * x for x in box.low),
            high=tuple(factor * x for x in box.high),
        )
        for box in boxes
    )


def test_there_is_a_name_for_each_channel(folder: DatasetFolder) -> None:
    for reads in (SHAPE, RGB, EVERY):
        assert len(named(folder, "bar-0003", reads)) == len(channel_names(reads))


def test_all_is_zero_in_the_air(folder: DatasetFolder) -> None:
    found = channels(sample(folder, "bar-0003", EVERY))
    air = sample(folder, "bar-0003", SHAPE).envelope == 0
    assert not found[:, air].any()
    assert np.isfinite(found).all()


def test_depth_and_normal_of_a_cube_point_at_its_nearest_face(folder: DatasetFolder) -> None:
    found = named(folder, "cube-0001", SHAPE)
    near_top = (32, 32, 56)
    assert found["normal_z"][near_top] == pytest.approx(1, abs=0.02)
    assert found["normal_x"][near_top] == pytest.approx(0, abs=0.02)
    assert found["normal_x"][5, 32, 32] == pytest.approx(-1, abs=0.02)
    # the cube fills 1 / 1.06 of the grid: its faces lie 1.8 voxels within the border
    assert found["depth"][32, 32, 32] * 64 == pytest.approx(30.2, abs=1.5)
    assert found["log10_extent"][32, 32, 32] == pytest.approx(np.log10(2 * 1.06))


def test_an_object_twice_as_large_differs_in_its_size_alone(tmp_path: Path) -> None:
    one = named(written(tmp_path / "one", BAR), "box-0001", SHAPE)
    two = named(written(tmp_path / "two", scaled(BAR, 2.0)), "box-0001", SHAPE)
    inside = one["envelope"] > 0
    assert np.allclose((two["log10_extent"] - one["log10_extent"])[inside], np.log10(2))
    assert np.allclose((two["log10_volume"] - one["log10_volume"])[inside], np.log10(8))
    for name in set(one) - {"log10_extent", "log10_volume"}:
        assert np.allclose(one[name], two[name], atol=1e-6), name


def test_an_object_that_moved_is_seen_the_same(tmp_path: Path) -> None:
    offset = np.array([3.0, -2.0, 1.5])
    moved = tuple(
        replace(
            box, low=tuple((offset + box.low).tolist()), high=tuple((offset + box.high).tolist())
        )
        for box in BAR
    )
    one = channels(sample(written(tmp_path / "one", BAR), "box-0001", SHAPE))
    two = channels(sample(written(tmp_path / "two", moved), "box-0001", SHAPE))
    assert np.allclose(one, two, atol=1e-5)


def test_turning_an_axis_round_turns_the_channels_that_are_said_to(tmp_path: Path) -> None:
    mirror = tuple(
        replace(box, low=(-box.high[0], *box.low[1:]), high=(-box.low[0], *box.high[1:]))
        for box in BENT
    )
    one = named(written(tmp_path / "one", BENT), "box-0001", SHAPE)
    two = named(written(tmp_path / "two", mirror), "box-0001", SHAPE)
    for name, grid in one.items():
        sign = -1 if name in {vector[0] for vector in VECTORS} else 1
        assert np.allclose(sign * grid[::-1], two[name], atol=1e-4), name


def test_own_axes_of_a_box_are_its_edges_longest_first(tmp_path: Path) -> None:
    found = named(written(tmp_path / "one", (Box("box", (0, 0, 0), (2, 8, 4)),)), "box-0001", SHAPE)
    inside = found["envelope"] > 0.99
    # an edge of length L has the deviation L / 12 ** .5: along it the places rise by 12 ** .5 / L
    size_cm = 8 * 1.06 / 64
    for name, axis, edge_cm in (("along_1", 1, 8), ("along_2", 2, 4), ("along_3", 0, 2)):
        both = inside & np.roll(inside, 1, axis)
        steps = (found[name] - np.roll(found[name], 1, axis))[both]
        assert np.abs(steps) == pytest.approx(np.sqrt(12) / edge_cm * size_cm, rel=0.02)
        assert np.average(found[name], weights=found["envelope"]) == pytest.approx(0, abs=1e-4)
    assert found["log_slimness_2"][inside] == pytest.approx(np.log(4 / 8), abs=0.02)
    assert found["log_slimness_3"][inside] == pytest.approx(np.log(2 / 8), abs=0.02)
    assert found["log10_volume"][inside] == pytest.approx(np.log10(64), abs=1e-3)


def test_the_first_own_axis_points_to_where_the_object_tails_off(tmp_path: Path) -> None:
    hammer = (Box("head", (0, 0, 8), (4, 2, 10)), Box("handle", (1.5, 0.5, 0), (2.5, 1.5, 8)))
    found = named(written(tmp_path / "one", hammer), "box-0001", SHAPE)
    handle = found["along_1"][:, :, :20][found["envelope"][:, :, :20] > 0.5]
    assert (handle > 1).all()
    assert found["skewness_1"].max() > 0.3


def test_each_voxel_has_the_colour_of_the_surface_nearest_to_it(folder: DatasetFolder) -> None:
    found = named(folder, "bar-0003", RGB)
    rgb = np.stack([found["red"], found["green"], found["blue"]])
    corner = sample(folder, "bar-0003", RGB).origin_cm
    size = sample(folder, "bar-0003", RGB).voxel_size_cm
    for name, point in (("plastic", (0.25, 1.0, 2.0)), ("steel", (1.75, 1.0, 2.0))):
        index = tuple(np.rint((np.array(point) - corner) / size).astype(int))
        found_rgb = rgb[:, *index]
        # shading darkens, but the ratio of the colours is the part's
        assert found_rgb / found_rgb.max() == pytest.approx(
            np.array(COLORS[name]) / max(COLORS[name]), abs=0.05
        )
        assert found["seen"][index] == 0
    assert 0 < found["seen"].max() <= 1


@pytest.mark.slow
def test_the_order_of_the_pictures_does_not_matter(folder: DatasetFolder) -> None:
    forwards = channels(sample(folder, "bar-0003", RGB))
    assert np.array_equal(forwards, channels(altered(folder, "bar-0003", RGB, backwards)))


def test_other_colours_give_other_channels(folder: DatasetFolder) -> None:
    black = channels(altered(folder, "bar-0003", RGB, same_in_black))
    names = channel_names(RGB)
    assert not black[[names.index(name) for name in ("red", "green", "blue")]].any()
    assert channels(sample(folder, "bar-0003", RGB))[names.index("red")].any()


def test_pictures_that_show_nothing_of_the_object_are_an_error(folder: DatasetFolder) -> None:
    def masked(pictures):
        return replace(pictures, masks=np.zeros_like(pictures.masks))

    with pytest.raises(DataError, match="bar-0003: its pictures show no voxel of it"):
        channels(altered(folder, "bar-0003", RGB, masked))


def test_an_empty_envelope_is_a_plain_error(folder: DatasetFolder) -> None:
    one = sample(folder, "bar-0003", SHAPE)
    one.__dict__["envelope"] = np.zeros_like(
        one.envelope
    )  # where a cached property keeps its value
    with pytest.raises(DataError, match="bar-0003: its envelope is empty"):
        channels(one)
