"""The comparisons of speed are between results as exact as they claim to be."""

import json
import math

import numpy as np
import pytest
import torch
import trimesh
from click.testing import CliRunner

from xden1k.rays import CubeGrid
from xden_builder.cli import cli
from xden_builder.fit import compare_solvers
from xden_builder.speed.peers import cast_lengths, march_lengths, pixel_rays, reference_lengths
from xden_builder.speed.ratios import comparisons, scene_radiographs
from xden_builder.speed.scenes import six_parts, two_views

SIZE_CM = np.array([6.0, 7.0, 8.0])


@pytest.fixture(scope="module")
def rows():
    return tuple(comparisons(size=96, repeats=1, voxels=32))


def test_both_solvers_are_compared_at_the_same_loss(rows):
    assert 0 <= rows[0].ours_error < 1e-9
    assert 0 <= rows[0].other_error < 1.1e-4


def test_path_lengths_are_as_exact_as_ray_casting_and_more_than_ray_marching(rows):
    _, summed, casting, marching, *_ = rows
    assert summed.ours_error == pytest.approx(summed.other_error, abs=1e-6)
    assert summed.other_error == casting.ours_error
    assert casting.ours_error == marching.ours_error < 1e-5
    assert casting.other_error < 1e-5
    assert marching.other_error > 100 * marching.ours_error
    assert marching.other_error < 4.0


def test_both_forms_of_our_algorithm_are_as_exact_on_every_device(rows):
    in_torch = rows[4:-1]
    devices = ["CPU, one thread", *(["CUDA"] if torch.cuda.is_available() else [])]
    assert [row.other for row in in_torch] == [f"the same in torch, {name}" for name in devices]
    assert [row.clock for row in in_torch] == ["processor", "wall"][: len(devices)]
    for row in in_torch:
        assert row.other_error == pytest.approx(row.ours_error, abs=1e-6)


def test_a_whole_object_is_compared_by_how_wrong_its_densities_are(rows):
    whole = rows[-1]
    assert "the paper's way" in whole.other
    assert whole.ours_error < 0.3
    assert whole.other_error > 10 * whole.ours_error


def test_ratios_are_those_of_the_times(rows):
    for row in rows:
        values = row.to_dict()
        assert math.isfinite(row.ratio)
        assert row.ratio == values["ratio"] == values["other_s"] / values["ours_s"] > 0
        assert json.loads(json.dumps(values, allow_nan=False)) == values


def test_command_prints_what_is_compared(monkeypatch, rows):
    monkeypatch.setattr("xden_builder.speed.ratios.comparisons", lambda _: iter(rows))
    shown = CliRunner().invoke(cli, ["speed"])
    assert shown.exit_code == 0
    assert all(row.ours in shown.output and row.other in shown.output for row in rows)
    printed = CliRunner().invoke(cli, ["speed", "--json"])
    assert [row["task"] for row in json.loads(printed.output)] == [row.task for row in rows]


def _box_and_rays(count):
    """A box about the origin, rays through it, and the lengths within (slab by slab)."""
    rng = np.random.default_rng(60)
    origins = rng.normal(size=(count, 3))
    origins *= 50.0 / np.linalg.norm(origins, axis=1, keepdims=True)
    ways = rng.uniform(-0.4, 0.4, (count, 3)) * SIZE_CM - origins
    directions = ways / np.linalg.norm(ways, axis=1, keepdims=True)
    hits = np.sort([(side * SIZE_CM / 2 - origins) / directions for side in (-1, 1)], axis=0)
    return trimesh.creation.box(SIZE_CM), (origins, directions), np.ptp(_inner(hits), axis=0)


def _inner(hits):
    """Last entry and first exit of the three slabs."""
    return np.stack([hits[0].max(axis=1), hits[1].min(axis=1)])


def test_reference_and_ray_casting_know_the_lengths_within_a_box():
    box, rays, truth = _box_and_rays(200)
    beside = box.copy().apply_translation([100.0, 0.0, 0.0])
    for lengths in (reference_lengths([box, beside], rays), cast_lengths([box, beside], rays)):
        np.testing.assert_allclose(lengths[:, 0], truth, atol=1e-5)
        assert not lengths[:, 1].any()


def _marched(rays, size, samples):
    """Lengths through the box as voxels of a cube of 10 cm, each filled by its exact share."""
    grid = CubeGrid(np.full(3, -5.0 + 5.0 / size), 10.0 / size, size)
    edges = np.linspace(-5.0, 5.0, size + 1)
    fills = [
        np.clip(np.minimum(edges[1:], half) - np.maximum(edges[:-1], -half), 0, None)
        for half in SIZE_CM / 2
    ]
    shares = np.einsum("i,j,k->ijk", *fills) / grid.voxel_size_cm**3
    return march_lengths(
        shares[None].astype(np.float32), np.full(3, -5.0), 10.0, rays, samples, at_once=64
    )[:, 0]


def test_ray_marching_comes_near_the_truth_with_finer_voxels_and_steps():
    _, rays, truth = _box_and_rays(200)
    errors = [
        np.abs(_marched(rays, size, samples) - truth).mean()
        for size, samples in ((10, 40), (40, 160), (160, 640))
    ]
    assert errors[0] > 3 * errors[1] > 9 * errors[2]
    assert errors[2] < 0.01 * truth.mean()


def test_rays_pass_through_pixel_centres():
    geometry = two_views(64)[1]
    pixels = np.array([0, 63, 64 * 63, 2000])
    origins, directions = pixel_rays(geometry, pixels)
    centres = geometry.pixel_centres_cm(pixels // 64 * 1.0, pixels % 64 * 1.0)
    distance = np.linalg.norm(centres - origins, axis=1, keepdims=True)
    np.testing.assert_allclose(origins + distance * directions, centres, atol=1e-9)


def test_parts_of_the_scene_are_closed_and_apart():
    parts = six_parts()
    assert all(part.is_volume for part in parts)
    assert 50_000 < sum(len(part.faces) for part in parts) < 60_000
    for lengths, _ in scene_radiographs(parts, 64):
        assert not lengths.shared_cm.any()
        assert (lengths.lengths_cm > 0).any(axis=(0, 1)).all()


@pytest.mark.slow
def test_fit_of_whole_frames_takes_far_less_time_than_adam_even_on_a_busy_machine():
    comparison = compare_solvers(scene_radiographs(six_parts(), 1024))
    assert comparison.adam_excess < 1.1e-4
    assert comparison.ratio > 20
