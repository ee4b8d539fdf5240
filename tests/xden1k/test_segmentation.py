"""The points of an object, their regions, and segments.npz: what may come and what is refused."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from tests.bench.crafting import npy, zipped
from xden1k.errors import DataError, SubmissionError
from xden1k.rays import object_cube, outer_surface
from xden1k.segmentation import (
    CLUSTER_COUNTS,
    MAX_POINTS,
    SEGMENT_CODES,
    Segmentation,
    SegmentPoints,
    Segments,
    SegmentsMeta,
    SegmentsWriter,
    material_regions,
    open_segments,
    points_sha256,
)
from xden1k.segmentation.points import draw_points, owner_voxels, point_owners, segment_grid
from xden1k.segmentation.values import faults

WHOLE = trimesh.creation.box((2, 1, 1))
HALVES = [trimesh.creation.box(bounds=[(x, -0.5, -0.5), (x + 1, 0.5, 0.5)]) for x in (-1, 0)]
SHA = "0" * 64


def hollow() -> trimesh.Trimesh:
    hole = trimesh.creation.box((1, 0.5, 0.5))
    hole.invert()
    return trimesh.util.concatenate([WHOLE, hole])


def drawn(parts: list[trimesh.Trimesh], name: str = "box", seed: int = 1) -> SegmentPoints:
    field, _ = object_cube(parts)
    grid = segment_grid(field.origin_cm, field.voxel_size_cm)
    return draw_points(outer_surface(parts), grid, name, seed)


def test_points_do_not_depend_on_what_parts_an_object_has() -> None:
    one = drawn([WHOLE])
    for parts in (HALVES, [hollow()]):
        assert (drawn(parts).voxels == one.voxels).all()
    assert len(one) == MAX_POINTS
    assert (np.abs(one.points_cm) < WHOLE.extents / 2).all()
    assert np.abs(one.points_cm.mean(axis=0)).max() < 0.03  # 5 sd of the mean of a uniform draw


@pytest.mark.parametrize("other", [{"seed": 2}, {"name": "cube"}])
def test_another_seed_or_id_draws_other_points(other: dict[str, Any]) -> None:
    one, two = (
        {tuple(voxel) for voxel in drawn([WHOLE], **change).voxels} for change in ({}, other)
    )
    assert len(one & two) < 0.05 * MAX_POINTS


def test_an_object_of_few_voxels_has_them_all() -> None:
    needle = trimesh.creation.box((9, 0.07, 0.07))
    points = drawn([needle])
    assert 0 < len(points) < MAX_POINTS
    assert len(np.unique(points.voxels, axis=0)) == len(points)
    assert (np.abs(points.points_cm) <= needle.extents / 2).all()
    assert np.ptp(points.points_cm[:, 0]) > 8.9


def test_an_object_between_two_layers_of_voxels_is_refused_in_words() -> None:
    """A playing card: without points nothing can be compared."""
    with pytest.raises(DataError, match=r"thinner than a voxel of 0\.37 mm: its segments cannot"):
        drawn([trimesh.creation.box((9, 6, 0.03))])


def test_owners_are_those_of_the_meshes_and_only_cavities_are_void() -> None:
    leaf = trimesh.creation.box(bounds=[(-1, -0.5, 0.5), (1, 0.5, 0.51)])  # below a label voxel
    parts = [hollow(), leaf]
    field, _ = object_cube(parts)
    grid = segment_grid(field.origin_cm, field.voxel_size_cm)
    points = draw_points(outer_surface(parts), grid, "box", 1)
    in_hole = (np.abs(points.points_cm) < (0.5, 0.25, 0.25)).all(axis=1)
    expected = np.where(points.points_cm[:, 2] > 0.5, 2, np.where(in_hole, 0, 1))
    assert (point_owners(parts, grid, points) == expected).all()
    assert {0, 1, 2} == set(expected.tolist())


def test_the_film_that_seals_two_parts_is_no_void() -> None:
    """Voxel centres on the face that two parts share, or just outside of both, belong to one."""
    field, _ = object_cube(HALVES)
    grid = segment_grid(field.origin_cm, field.voxel_size_cm)
    apart = [HALVES[0], HALVES[1].copy().apply_translation((1e-6, 0, 0))]
    owners = owner_voxels(apart, grid)
    assert set(np.unique(owners[128, 80:-80, 80:-80]).tolist()) <= {1, 2}
    along = range(80, 176, 8)
    voxels = np.array(list(product([127, 128, 129], along, along)), dtype=np.uint8)
    points = SegmentPoints(voxels, grid.origin_cm + grid.voxel_size_cm * voxels)
    found = point_owners(apart, grid, points)
    assert found.all()
    assert (found == owners[tuple(voxels.T)]).all()


@given(st.integers(0, 2000), st.sampled_from([150, 151, 149]))
def test_a_gap_of_exactly_the_limit_parts_nothing(lower: int, gap: int) -> None:
    regions = material_regions([lower / 1000, (lower + gap) / 1000], gap_g_cm3=0.15)
    assert regions.tolist() == [0, int(gap > 150)]


@given(st.lists(st.floats(0, 20), min_size=1, max_size=12), st.randoms())
def test_regions_do_not_depend_on_the_order_of_parts(values: list[float], random: Any) -> None:
    order = list(range(len(values)))
    random.shuffle(order)
    regions = material_regions(values, 0.15)
    assert (material_regions([values[one] for one in order], 0.15) == regions[order]).all()


POINTS = 40
LABELS = np.stack([np.arange(POINTS) % count for count in CLUSTER_COUNTS]).astype(np.uint8)
FREE = (np.arange(POINTS) % 3).astype(np.uint8)
VOXELS = np.arange(3 * POINTS, dtype=np.uint8).reshape(POINTS, 3)
META = SegmentsMeta(
    method="test",
    dataset_revision="0.1.0",
    config="default",
    split="test",
    inputs=("mesh", "xray"),
    training_data=(),
    external_data=False,
    points_seed=7,
    points_sha256=SHA,
)


def written(path: Path) -> Path:
    with SegmentsWriter(path) as writer:
        for name in ("b", "a"):
            writer.add(name, VOXELS, LABELS, FREE)
        writer.finish(META)
    return path


def test_a_file_is_read_as_it_was_written(tmp_path: Path) -> None:
    with open_segments(written(tmp_path / "segments.npz")) as found:
        assert found.meta == META
        assert found.ids == ("a", "b")
        read, problems = found.examine("a", POINTS)
        assert not problems
        assert read is not None
        assert (read.labels == LABELS).all()
        assert (read.free == FREE).all()
        assert (read.of(5) == np.arange(POINTS) % 5).all()


def test_a_file_of_the_same_labels_has_the_same_bytes(tmp_path: Path) -> None:
    one, two = (written(tmp_path / name).read_bytes() for name in ("1.npz", "2.npz"))
    assert one == two


def test_nothing_is_written_of_labels_that_break_the_format(tmp_path: Path) -> None:
    with SegmentsWriter(tmp_path / "s.npz") as writer:
        writer.add("a", VOXELS, LABELS, FREE)
        with pytest.raises(DataError, match="a was predicted twice"):
            writer.add("a", VOXELS, LABELS, FREE)
        with pytest.raises(DataError, match=r"^b: 39 points need as many labels, got 40$"):
            writer.add("b", VOXELS[1:], LABELS, FREE)
        with pytest.raises(
            DataError, match=r"^b: labels: shape must be .18, 40., a row for each k"
        ):
            writer.add("b", VOXELS, LABELS[1:], FREE)
    assert not list(tmp_path.iterdir())


def test_the_checksum_tells_points_apart_and_not_their_order() -> None:
    one = points_sha256({"a": VOXELS, "b": VOXELS})
    assert one == points_sha256({"b": VOXELS, "a": VOXELS})
    assert one != points_sha256({"a": VOXELS, "b": VOXELS + np.uint8(1)})


Members = dict[str, bytes]


def sound(**meta: Any) -> Members:
    text = json.dumps(json.loads(META.to_json()) | meta)
    return {"__meta__": npy(np.array(text)), "labels/a": npy(LABELS), "free/a": npy(FREE)}


def many(count: int) -> np.ndarray:
    labels = LABELS.copy()
    labels[CLUSTER_COUNTS.index(count)] = np.arange(POINTS) % (count + 1)
    return labels


BAD: Mapping[str, tuple[Callable[[], Members], str]] = {
    "nothing at all": (dict, "E201: __meta__ is missing"),
    "damaged": (
        lambda: sound() | {"labels/a": npy(LABELS)[:-9]},
        "E101 a: labels: shape (18, 40) of |u1 needs",
    ),
    "too large": (
        lambda: sound() | {"labels/a": npy(np.zeros((18, 9000), np.uint8))},
        "E102 a: labels: declares 16",
    ),
    "a pickle": (
        lambda: sound() | {"free/a": npy(np.array([None]), allow_pickle=True)},
        "E103 a: free: an object array",
    ),
    "a key of densities": (
        lambda: sound() | {"density/a": npy(FREE)},
        "E104: keys must be __meta__, labels/ID or free/ID; others 1: 'density/a.npy'",
    ),
    "no meta": (
        lambda: {key: one for key, one in sound().items() if key != "__meta__"},
        "E201: __meta__ is missing",
    ),
    "meta of numbers": (
        lambda: sound() | {"__meta__": npy(np.array(1.0))},
        "E201: __meta__: dtype must be a string",
    ),
    "a preds.npz": (
        lambda: sound(schema="xden-submission/1"),
        "E202: schema must be 'xden-segments/1', got 'xden-submission/1'",
    ),
    "a field of densities": (lambda: sound(units="g/cm3"), "E203: unknown field 'units'"),
    "no seed": (lambda: sound(points_seed=None), "E203: points_seed must be an integer"),
    "labels alone": (
        lambda: {key: one for key, one in sound().items() if key != "free/a"},
        "E304: an object must have both labels and free; only one of them 1: 'a'",
    ),
    "wide labels": (
        lambda: sound() | {"labels/a": npy(LABELS.astype(np.int32))},
        "E401 a: labels: dtype must be uint8",
    ),
    "k rows missing": (
        lambda: sound() | {"labels/a": npy(LABELS[:-1])},
        "E402 a: labels: shape must be (18, points), a row for each k from 2 to 19, got (17, 40)",
    ),
    "a point a row": (
        lambda: sound() | {"labels/a": npy(np.ascontiguousarray(LABELS.T))},
        "E402 a: labels: shape must be (18, points), a row for each k from 2 to 19, got (40, 18)",
    ),
    "labels of no axis": (
        lambda: sound() | {"labels/a": npy(np.array(3, np.uint8))},
        "E402 a: labels: shape must be (18, points), a row for each k from 2 to 19, got ()",
    ),
    "a row too many at full size": (
        lambda: sound() | {"labels/a": npy(np.zeros((19, 8192), np.uint8))},
        "E402 a: labels: shape must be (18, points), a row for each k from 2 to 19, got (19, 8192)",
    ),
    "free of two axes": (
        lambda: sound() | {"free/a": npy(LABELS)},
        "E402 a: free: shape must be (points,), got (18, 40)",
    ),
    "other points": (
        lambda: sound() | {"free/a": npy(FREE[1:])},
        "E402 a: free: shape must be (40,), got (39,)",
    ),
    "more clusters than k": (
        lambda: sound() | {"labels/a": npy(many(4))},
        "E408 a: labels of k = 4 must have at most 4 clusters, got 5",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_each_fault_of_a_file_is_one_line_with_its_code(name: str, tmp_path: Path) -> None:
    make, expected = BAD[name]
    path = tmp_path / "segments.npz"
    path.write_bytes(zipped([(f"{key}.npy", data) for key, data in make().items()]))
    with Segments(path) as found:
        told = [*found.problems]
        told += found.examine("a", POINTS)[1] if "a" in found else []
    assert [one.code for one in told] == [expected[:4]]
    assert str(told[0]).startswith(expected)
    assert "\n" not in str(told[0])
    assert told[0].code in SEGMENT_CODES


def test_a_file_that_must_be_flawless_is_refused_with_what_is_wrong(tmp_path: Path) -> None:
    path = tmp_path / "segments.npz"
    path.write_bytes(zipped([("x.npy", npy(FREE))]))
    with pytest.raises(SubmissionError, match=r"segments.npz: E201: .*\n.*segments.npz: E104: "):
        open_segments(path)


def test_a_segmentation_of_more_clusters_than_k_cannot_be_made() -> None:
    with pytest.raises(DataError, match="labels of k = 2 must have at most 2 clusters, got 3"):
        Segmentation(many(2), FREE)
    told = list(faults(LABELS, FREE.astype(np.int64), POINTS))
    assert told == [("E401", "free must be an array of uint8, got int64")]
