"""The training loop: it learns, is repeatable, keeps its budget and says when it failed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.baselines.pixie_scenes import TINY, dataset, prepared, together, written
from tests.phantoms import BAR, Box
from xden1k.errors import DataError
from xden1k.folder import DatasetFolder
from xden1k.predictor import Budget
from xden1k.values.modality import Modality
from xden_baselines.learning.held_out import split_off
from xden_baselines.pixie import XRayUNet, model, training
from xden_baselines.pixie.categories import USUAL, Peers
from xden_baselines.pixie.channels import VECTORS, channel_names
from xden_baselines.pixie.losses import loss, turned
from xden_baselines.pixie.model import EMPTY_SHARES, Outputs, VoxelModel
from xden_baselines.pixie.networks import FullNet
from xden_baselines.pixie.scaling import LogScale
from xden_baselines.pixie.settings import Settings
from xden_baselines.pixie.store import Stored
from xden_baselines.pixie.training import FitReport, train

XRAY = Modality.GEOMETRY | Modality.XRAY | Modality.CATEGORY
NAMES = channel_names(XRAY)


@pytest.fixture(scope="module")
def objects(tmp_path_factory: pytest.TempPathFactory) -> list[Stored]:
    folder: DatasetFolder = dataset(tmp_path_factory.mktemp("training") / "dataset")
    return prepared(folder, XRAY, 16)


def fresh_model(objects: list[Stored]) -> VoxelModel:
    return training._fresh(objects, NAMES, Peers.of(objects).categories, Settings(**TINY))


def weights(model: torch.nn.Module) -> dict[str, np.ndarray]:
    return {name: value.numpy().copy() for name, value in model.state_dict().items()}


@pytest.mark.slow
def test_a_network_learns_one_object_by_heart(objects: list[Stored]) -> None:
    bar = objects[0]
    settings = Settings(
        resolution=16, batch=1, patience=99, turned="none", learning_rate=1e-2, epochs=80
    )
    _, report = train([bar, bar], NAMES, settings, seed=0)
    # 4.5 g/cm³ everywhere is 3.5 off in either half; a voxel's mean counts by the share squared
    weight = np.square(bar.envelope).sum() / bar.envelope.sum()
    assert report.train_median_mae_g_cm3 == pytest.approx(3.5 * weight, rel=0.02)
    assert report.best_mae_g_cm3 < 0.1 * report.train_median_mae_g_cm3
    assert not report.failed


@pytest.mark.slow
def test_the_published_architecture_learns_too(
    objects: list[Stored], monkeypatch: pytest.MonkeyPatch
) -> None:
    def narrow(size: str, inputs: int, told: int, outputs: int) -> torch.nn.Module:
        return FullNet(inputs, told, outputs, base=8)

    monkeypatch.setattr(model, "backbone", narrow)
    settings = Settings(size="full", resolution=16, batch=1, turned="none", epochs=15)
    _, report = train([objects[0]] * 2, NAMES, settings, seed=0)
    assert report.best_mae_g_cm3 < 0.5 * report.train_median_mae_g_cm3


@pytest.mark.slow
def test_the_same_seed_gives_the_same_weights_to_the_bit(objects: list[Stored]) -> None:
    torch.manual_seed(1)
    one, report = train(objects, NAMES, Settings(**TINY), seed=3)
    state = torch.random.get_rng_state()
    torch.manual_seed(2)
    two, again = train(objects, NAMES, Settings(**TINY), seed=3)
    other, _ = train(objects, NAMES, Settings(**TINY), seed=4)
    assert report.held_out_mae_g_cm3 == again.held_out_mae_g_cm3
    first, second, third = weights(one), weights(two), weights(other)
    assert all(np.array_equal(first[name], second[name]) for name in first)
    assert not all(np.array_equal(first[name], third[name]) for name in first)
    torch.manual_seed(1)
    assert torch.equal(state, torch.random.get_rng_state()), "the caller's draws moved on"


def test_threads_are_given_back(objects: list[Stored]) -> None:
    before = torch.get_num_threads()
    train(objects, NAMES, Settings(**TINY), seed=0, budget=Budget(epochs=1))
    assert torch.get_num_threads() == before


def test_a_budget_ends_the_training(objects: list[Stored]) -> None:
    settings = Settings(**TINY)
    _, by_epochs = train(objects, NAMES, settings, seed=0, budget=Budget(epochs=3))
    assert by_epochs.epochs == 3
    _, by_time = train(objects, NAMES, settings, seed=0, budget=Budget(seconds=1e-3))
    assert by_time.epochs == 1
    _, by_own = train(objects, NAMES, settings, seed=0)
    assert by_own.epochs == TINY["epochs"]


def test_patience_ends_it_and_the_best_epoch_is_kept(
    objects: list[Stored], monkeypatch: pytest.MonkeyPatch
) -> None:
    errors = iter([3.0, 1.0, 2.0, 2.0, 0.5])
    seen: list[dict[str, np.ndarray]] = []

    def error(school: training._School, *_: object) -> float:
        seen.append(weights(school.model))
        return next(errors)

    monkeypatch.setattr(training, "_error", error)
    settings = Settings(**TINY | {"epochs": 9, "patience": 2})
    best, report = train(objects, NAMES, settings, seed=0)
    assert (report.epochs, report.best_epoch, report.best_mae_g_cm3) == (4, 2, 1.0)
    kept = weights(best)
    assert all(np.array_equal(kept[name], seen[1][name]) for name in kept)


def report(mae: float) -> FitReport:
    return FitReport(
        learned_from=9,
        held_out=1,
        epochs=2,
        best_epoch=2,
        seconds=1.0,
        held_out_mae_g_cm3=(5.0, mae),
        train_median_mae_g_cm3=2.0,
        category_median_mae_g_cm3=1.0,
    )


@pytest.mark.parametrize(("mae", "failed"), [(0.9, False), (1.0, True), (1.5, True)])
def test_a_network_no_better_than_a_constant_says_so(mae: float, failed: bool) -> None:
    assert report(mae).failed == failed
    assert ("FAILED TO BEAT A CONSTANT" in report(mae).summary) == failed


def test_constants_are_those_of_the_objects_learned_from(objects: list[Stored]) -> None:
    bars, cube, hollow = objects[:2], objects[2], objects[3]
    overall, by_category = training._constants([*bars, cube], [hollow])
    # 1.5 g/cm³ of shell with a cavity of an eighth, predicted as 4.5; no mug was learned from
    assert overall == pytest.approx(3.0 * 7 / 8 + 4.5 / 8, rel=0.1)
    assert by_category == overall
    _, known = training._constants([*bars, cube, hollow], [hollow])
    assert known < by_category


def test_held_out_objects_are_not_learned_from(objects: list[Stored]) -> None:
    learned, held_out = split_off(objects, 0.25, np.random.default_rng(0))
    assert len(held_out) == 1
    assert {id(one) for one in learned} | {id(one) for one in held_out} == set(map(id, objects))
    with pytest.raises(DataError, match="at least 2 objects, one held out; got 1"):
        split_off(objects[:1], 0.1, np.random.default_rng(0))


def test_radiographs_come_in_as_the_density_they_speak_of(objects: list[Stored]) -> None:
    fresh = fresh_model(objects)
    lac = NAMES.index("log10_lac_pa")
    # attenuation of the test objects is in proportion to density: 1.25 * 0.17 cm²/g
    for density in (1.0, 4.0):
        seen = (np.log10(density * 1.25 * 0.17) - fresh.offset[lac]) * fresh.gain[lac]
        found = fresh.scale.density_g_cm3(seen[None]).item()
        assert found == pytest.approx(density, rel=0.35)


@pytest.mark.parametrize(
    ("order", "signs"), [([0, 1, 2], [-1, -1, 1]), ([1, 2, 0], [1, -1, -1]), ([2, 1, 0], [1, 1, 1])]
)
def test_turning_and_turning_back_changes_nothing_and_once_keeps_every_target(
    objects: list[Stored], order: list[int], signs: list[int]
) -> None:
    batch = together(objects, 16)
    once = turned(batch, NAMES, order, signs)
    undo = np.argsort(order).tolist()
    back = turned(once, NAMES, undo, [signs[axis] for axis in undo])
    for name in batch.__slots__:
        assert torch.equal(getattr(batch, name), getattr(back, name)), name
    assert torch.equal(once.mean_g_cm3.sum((1, 2, 3)), batch.mean_g_cm3.sum((1, 2, 3)))
    # what a channel says of a voxel's place is still so
    inside = once.inside.double()
    for axis, name in enumerate(VECTORS[0]):
        place = once.channels[:, NAMES.index(name)]
        along = torch.arange(16.0).view([16 if axis == k else 1 for k in range(3)]) - 7.5
        error = (place * 16 - along).abs() * inside
        assert error.max() < 0.6, name


def test_a_turned_object_is_seen_as_one_that_lies_so(tmp_path: Path) -> None:
    bent = (*BAR, Box("foot", (0, 2, 0), (1, 3, 1)))
    lying = tuple(
        replace(
            box,
            low=(-box.high[1], box.low[2], box.low[0]),
            high=(-box.low[1], box.high[2], box.high[0]),
        )
        for box in bent
    )
    reads = Modality.GEOMETRY | Modality.CATEGORY
    one, two = (
        together(prepared(written(tmp_path / name, boxes), reads, 32), 32)
        for name, boxes in (("one", bent), ("two", lying))
    )
    found = turned(one, channel_names(reads), [1, 2, 0], [-1, 1, 1])
    assert torch.allclose(found.mean_g_cm3, two.mean_g_cm3, atol=2e-3)
    for index, name in enumerate(channel_names(reads)):
        assert torch.allclose(found.channels[:, index], two.channels[:, index], atol=2e-3), name


@pytest.mark.parametrize(("how", "ways"), [("none", 1), ("mirrored", 4), ("cube", 48)])
def test_objects_are_turned_in_every_way_that_is_said(how: str, ways: int) -> None:
    rng = np.random.default_rng(0)
    drawn = [training._turn(how, rng) for _ in range(2000)]
    assert len({(*order, *signs) for order, signs in drawn}) == ways
    if how != "cube":
        assert all(order == [0, 1, 2] and signs[2] == 1 for order, signs in drawn)


def test_radiographs_keep_their_directions() -> None:
    assert XRayUNet().settings.turned == "mirrored"


@pytest.mark.slow
def test_one_object_in_twenty_is_told_no_category(objects: list[Stored]) -> None:
    peers, rng = Peers.of(objects), np.random.default_rng(0)
    school = training._School(fresh_model(objects), Settings(**TINY), objects, peers, rng)
    drawn = torch.cat([school.varied(range(len(objects))).category for _ in range(250)])
    hidden = (drawn == len(peers.categories.names)).float().mean()
    assert hidden == pytest.approx(training.UNNAMED_SHARE, abs=0.025)


def test_turning_stays_on_the_device(objects: list[Stored]) -> None:
    found = turned(together(objects, 16).to("meta"), NAMES, [1, 2, 0], [-1, 1, 1])
    assert found.channels.is_meta


def test_a_fresh_network_predicts_what_is_usual_in_the_category(objects: list[Stored]) -> None:
    fresh = fresh_model(objects)
    batch = together(objects, 16)
    with torch.inference_mode():
        density = fresh(*batch.inputs).density_g_cm3
    material, empty = (
        batch.usual[:, USUAL.index(name)] for name in ("log10_material", "empty_share")
    )
    usual = 10**material * (1 - empty.clamp(*EMPTY_SHARES))
    for found, inside, wanted in zip(density, batch.inside, usual, strict=True):
        assert torch.allclose(found[inside], wanted, rtol=1e-3)


def test_the_truth_has_the_least_loss(objects: list[Stored]) -> None:
    batch = together(objects, 16)
    fresh = fresh_model(objects)
    solid = batch.solid.clamp(1e-4, 1 - 1e-4)
    scaled = fresh.scale.scaled(batch.stuff_g_cm3.clamp(min=1e-4))
    void = torch.logit(1 - solid)
    none = torch.zeros(len(objects), 0, 16, 16, 16)
    truth = Outputs(scaled, void, none, batch.mean_g_cm3)
    least = loss(truth, batch, fresh.scale)
    for worse in (
        replace(truth, scaled=scaled + 0.3),
        replace(truth, void=void + 1),
        replace(truth, density_g_cm3=batch.mean_g_cm3 + 0.1),
    ):
        assert loss(worse, batch, fresh.scale) > least


def test_the_family_head_learns_only_from_known_families(objects: list[Stored]) -> None:
    batch = together([objects[3]], 16)  # its material is not known
    families = torch.randn(1, 15, 16, 16, 16, requires_grad=True)
    outputs = Outputs(batch.solid, batch.solid, families, batch.mean_g_cm3)
    loss(outputs, batch, LogScale(-1.0, 1.0)).backward()
    assert families.grad is not None
    assert not families.grad.any()


def test_an_absent_device_is_a_plain_error(objects: list[Stored]) -> None:
    if torch.cuda.is_available():
        pytest.fail("this test describes a machine without a GPU")
    with pytest.raises(DataError, match="no device 'cuda' here"):
        train(objects, NAMES, Settings(**TINY, device="cuda"), seed=0)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"size": "huge"}, "size must be cpu or full, got 'huge'"),
        ({"resolution": 48}, "resolution must be 16, 32 or 64, got 48"),
        ({"resolution": 8}, "resolution must be 16, 32 or 64, got 8"),
        ({"turned": "twice"}, "turned must be one of .*'cube'.*, got 'twice'"),
        ({"batch": 0}, "batch must be positive, got 0"),
        ({"held_out": 1.0}, "held_out must lie between 0 and 1"),
    ],
)
def test_settings_out_of_range_are_refused(wrong: dict, message: str) -> None:
    with pytest.raises(DataError, match=message):
        Settings(**wrong)
