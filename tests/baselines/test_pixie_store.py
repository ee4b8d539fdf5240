"""Objects in memory: what they were before, at any resolution."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from tests.baselines.pixie_scenes import dataset, examples, prepared, together
from xden1k.errors import DataError
from xden1k.folder import DatasetFolder
from xden1k.values.materials import families
from xden1k.values.modality import Modality
from xden_baselines.pixie.channels import ENVELOPE, channels
from xden_baselines.pixie.losses import density_mae_g_cm3
from xden_baselines.pixie.scaling import LogScale
from xden_baselines.pixie.store import UNKNOWN_FAMILY, Stored, at_resolution, pooled
from xden_bench.scoring.metrics import density_mae_g_cm3 as benchmark_mae_g_cm3

GEOMETRY = Modality.GEOMETRY | Modality.CATEGORY


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> DatasetFolder:
    return dataset(tmp_path_factory.mktemp("store") / "dataset")


@pytest.fixture(scope="module")
def stored_at(folder: DatasetFolder) -> Callable[[int], list[Stored]]:
    """The training objects at a resolution, which no test may change."""
    return cache(lambda resolution: prepared(folder, GEOMETRY, resolution))


@pytest.mark.parametrize(
    "resolution",
    [16, pytest.param(32, marks=pytest.mark.slow), pytest.param(64, marks=pytest.mark.slow)],
)
def test_an_object_unpacks_to_what_it_was(
    folder: DatasetFolder, stored_at: Callable[[int], list[Stored]], resolution: int
) -> None:
    objects = stored_at(resolution)
    batch = together(objects, resolution)
    for index, example in enumerate(examples(folder, GEOMETRY)):
        mass = pooled(example.density_g_cm3, resolution)
        assert np.allclose((batch.mean_g_cm3 * batch.envelope)[index], mass, atol=0.02)
        envelope = pooled(example.sample.envelope, resolution)
        assert np.allclose(batch.envelope[index], envelope, atol=1e-6)
        seen = at_resolution(channels(example.sample), resolution)
        assert np.allclose(batch.channels[index], seen, atol=1e-3)


def test_stuff_is_the_material_and_a_cavity_is_empty(
    stored_at: Callable[[int], list[Stored]],
) -> None:
    hollow = next(one for one in stored_at(64) if one.category == "mug")
    # shares are stored in steps of 1 / 255, so that thin slices of a voxel say little
    full = (hollow.solid > 0.99) & (hollow.envelope > 0.5)
    assert np.allclose(hollow.stuff_g_cm3[full], 1.5, rtol=1e-2)
    assert (hollow.solid == 0).sum() == pytest.approx((64 / 2.12) ** 3, rel=0.1)
    assert not hollow.stuff_g_cm3[hollow.solid == 0].any()
    assert hollow.overall_g_cm3 == pytest.approx(84 / 64, rel=1e-3)


def test_a_voxel_has_the_family_that_fills_most_of_it(
    stored_at: Callable[[int], list[Stored]],
) -> None:
    bar, _, cube, mug = stored_at(32)
    names = families()
    half_in = bar.envelope > 0.5
    assert set(bar.family[half_in].tolist()) == {names.index("polymer"), names.index("metal")}
    share = bar.envelope[bar.family == names.index("metal")].sum() / bar.envelope.sum()
    assert share == pytest.approx(0.5, abs=0.05)
    assert set(cube.family[cube.envelope > 0.5].tolist()) == {names.index("metal")}
    assert set(mug.family.tolist()) == {UNKNOWN_FAMILY}


def test_the_error_is_the_benchmarks(
    folder: DatasetFolder, stored_at: Callable[[int], list[Stored]]
) -> None:
    objects = stored_at(64)
    batch = together(objects, 64)
    guess = 3.0
    errors = density_mae_g_cm3(torch.full_like(batch.envelope, guess), batch)
    for found, example in zip(errors.tolist(), examples(folder, GEOMETRY), strict=True):
        envelope = example.sample.envelope
        wanted = benchmark_mae_g_cm3(example.density_g_cm3, guess * envelope, envelope)
        assert found == pytest.approx(wanted, rel=1e-3)


def test_memory_is_what_the_documentation_says(
    stored_at: Callable[[int], list[Stored]],
) -> None:
    for one in stored_at(32):
        assert one.nbytes == len(one.voxels) * (2 * len(one.channels) + 13)


def test_a_coarser_voxel_holds_the_mean_over_the_envelope_not_over_the_air() -> None:
    values = np.zeros((2, 64, 64, 64), dtype=np.float32)
    values[:, 0, 0, 0] = 0.5, 8.0
    coarse = at_resolution(values, 32)
    assert coarse[ENVELOPE, 0, 0, 0] == 0.5 / 8
    assert coarse[1, 0, 0, 0] == 8.0


@given(low=st.floats(-2, 0.5), width=st.floats(0.05, 3), at=st.floats(0, 1))
def test_scaling_and_back_is_the_same_density(low: float, width: float, at: float) -> None:
    scale = LogScale(low, low + width)
    density = torch.tensor([10 ** (low + at * width)])
    assert scale.density_g_cm3(scale.scaled(density)).item() == pytest.approx(
        density.item(), rel=1e-4
    )


def test_a_wild_output_stays_near_the_densities_that_were_trained_on() -> None:
    scale = LogScale(-1.0, 1.0)
    assert scale.density_g_cm3(torch.tensor([1e6, -1e6])).tolist() == pytest.approx(
        [10**1.25, 10**-1.25], rel=1e-5
    )


def test_the_scale_spans_the_densities_and_never_collapses() -> None:
    spread = LogScale.of(np.geomspace(0.1, 10, 1001))
    assert (spread.low, spread.high) == pytest.approx((-0.98, 0.98), abs=1e-6)
    one = LogScale.of(np.full(5, 2.0))
    assert one.high - one.low == pytest.approx(0.1)
    with pytest.raises(DataError, match=r"must rise, got 1\.0 and 1\.0"):
        LogScale(1.0, 1.0)


def test_only_the_wanted_examples_are_gone_through_in_the_order_of_the_split(
    folder: DatasetFolder,
) -> None:
    found = [one.sample.object_id for one in examples(folder, GEOMETRY).only([3, 0, 3])]
    assert found == ["bar-0001", "hollow-0001"]
