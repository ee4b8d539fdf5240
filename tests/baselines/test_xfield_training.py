"""X-Field's training: losses, errors given to radiographs, resuming, and learning at all."""

from __future__ import annotations

import json
import math
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from click.testing import CliRunner
from torch import Tensor

from tests.baselines.pixie_scenes import colored, dataset
from tests.phantoms import BAR, CUBE, FILLED, HOLLOW, Box
from xden1k.access.samples import Examples
from xden1k.errors import DataError
from xden1k.folder import open_folder, write_folder
from xden1k.format.cache import LIMIT_VARIABLE, PieceCache
from xden1k.predictor import Budget
from xden1k.values.modality import Modality
from xden_baselines.xfield import training
from xden_baselines.xfield.__main__ import cli
from xden_baselines.xfield.batches import inputs_of, misaligned
from xden_baselines.xfield.crew import ALONE, Crew
from xden_baselines.xfield.lessons import Lesson, lesson
from xden_baselines.xfield.losses import TEMPERATURE, contrastive_loss
from xden_baselines.xfield.network import XField
from xden_baselines.xfield.settings import Settings
from xden_baselines.xfield.sizes import SIZES
from xden_baselines.xfield.training import FitReport, train

SHORT = Settings(epochs=2, batch=2, queries=16, held_out=0.25)
RODS = (Box("thick", (0, 0, 0), (1, 1, 4), 2.0), Box("thin", (1, 0, 0), (1.5, 1, 4), 1.0))
on_a_gpu = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA GPU")
EXACT = {"jitter_deg": 0, "jitter_shift": 0, "jitter_scale": 0, "jitter_gain": 0}


@pytest.fixture(scope="module")
def lessons(tmp_path_factory: pytest.TempPathFactory) -> list[Lesson]:
    """Four objects of few points."""
    folder = dataset(tmp_path_factory.mktemp("lessons") / "dataset")
    train = Examples(folder, "train", Modality.GEOMETRY | Modality.XRAY)
    size = replace(SIZES["tiny"], points=128)
    return [lesson(example, size) for example in train]


@pytest.fixture
def kept(tmp_path: Path) -> PieceCache:
    return PieceCache(tmp_path / "kept", 10**8)


def fitted(
    lessons: list[Lesson], kept: PieceCache, seed: int = 0, epochs: int = 2
) -> tuple[dict[str, Tensor], FitReport]:
    settings = replace(SHORT, epochs=epochs)
    model, report = train(lessons, "rays", "density", settings, seed=seed, kept=kept)
    return model.state_dict(), report


def same(one: dict[str, Tensor], two: dict[str, Tensor]) -> bool:
    return all(torch.equal(one[name], two[name]) for name in one)


def test_the_contrastive_loss_is_that_of_three_loops() -> None:
    torch.manual_seed(0)
    embedding = torch.nn.functional.normalize(torch.randn(2, 6, 4), dim=-1)
    owner = torch.tensor([[0, 0, 1, 1, 1, 2], [3, 3, 3, 3, 3, 0]])
    objects = []
    for e, part in zip(embedding.tolist(), owner.tolist(), strict=True):
        terms = []
        for i in range(6):
            for j in range(6):
                if i == j or part[i] != part[j]:
                    continue
                s = [
                    sum(a * b for a, b in zip(e[i], e[n], strict=True)) / TEMPERATURE
                    for n in range(6)
                ]
                others = sum(math.exp(s[n]) for n in range(6) if part[n] != part[i])
                terms.append(math.log1p(others * math.exp(-s[j])))
        objects.append(sum(terms) / len(terms))
    assert contrastive_loss(embedding, owner).item() == pytest.approx(np.mean(objects), rel=1e-5)


def test_the_contrastive_loss_in_bf16_is_that_in_float32() -> None:
    torch.manual_seed(0)
    embedding = torch.nn.functional.normalize(torch.randn(2, 30, 4), dim=-1)
    owner = torch.arange(30).expand(2, -1) // 8
    with torch.autocast("cpu", dtype=torch.bfloat16):
        found = contrastive_loss(embedding, owner)
    assert found == contrastive_loss(embedding, owner)


def test_one_part_teaches_nothing_and_separate_ones_cost_nothing() -> None:
    embedding = torch.eye(4)[[0, 0, 1, 1]][None].requires_grad_()
    one = contrastive_loss(embedding, torch.zeros(1, 4, dtype=torch.long))
    one.backward()
    assert one.item() == 0
    assert embedding.grad is not None
    assert not embedding.grad.any()
    assert contrastive_loss(embedding, torch.tensor([[5, 5, 0, 0]])).item() < 1e-3


def test_no_error_leaves_radiographs_as_they_are(lessons: list[Lesson]) -> None:
    inputs, rng = inputs_of(lessons), np.random.default_rng(0)
    found = misaligned(inputs, Settings(**EXACT), rng)
    assert torch.allclose(found.transmission, inputs.transmission, atol=1e-5)


def test_errors_are_as_large_as_is_said_and_air_stays_air(lessons: list[Lesson]) -> None:
    inputs = inputs_of(lessons[:1] * 100)
    dot = torch.ones(100, 2, 64, 64)
    dot[..., 30:34, 40:44] = 0
    inputs = replace(inputs, transmission=dot)
    how, rng = Settings(**EXACT | {"jitter_shift": 0.02}), np.random.default_rng(0)
    moved = misaligned(inputs, how, rng).transmission.flatten(0, 1)
    absorbed = 1 - moved
    columns = (absorbed.sum(1) * torch.arange(64)).sum(1) / absorbed.sum((1, 2))
    assert moved.max().item() == pytest.approx(1)
    assert columns.mean().item() == pytest.approx(41.5, abs=0.5)
    assert columns.std().item() == pytest.approx(0.02 * 64, rel=0.2)
    gain = Settings(**EXACT | {"jitter_gain": 0.05})
    bright = misaligned(inputs, gain, rng).transmission[..., 0, 0]
    assert bright.log().std().item() == pytest.approx(0.05, rel=0.2)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_weights_and_another_others(
    lessons: list[Lesson], kept: PieceCache
) -> None:
    one, report = fitted(lessons, kept)
    torch.manual_seed(7)
    two, again = fitted(lessons, kept)
    other, _ = fitted(lessons, kept, seed=1)
    assert same(one, two)
    assert not same(one, other)
    assert report.held_out_loss == again.held_out_loss
    assert (report.learned_from, report.held_out, report.epochs) == (3, 1, 2)


def test_a_training_that_was_killed_ends_with_the_same_weights(
    lessons: list[Lesson], kept: PieceCache, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, report = fitted(lessons, kept, epochs=3)
    exams, exam = iter([None, None, KeyboardInterrupt]), training._exam_loss

    def killed(model: XField, *rest: object) -> float:
        if (error := next(exams)) is not None:
            raise error
        return exam(model, *rest)

    with monkeypatch.context() as patch:
        patch.setattr(training, "_exam_loss", killed)
        with pytest.raises(KeyboardInterrupt):
            fitted(lessons, kept, epochs=3)
    run: list[int] = []
    epoch = training._epoch

    def counted(*args: object) -> None:
        run.append(1)
        epoch(*args)

    monkeypatch.setattr(training, "_epoch", counted)
    rest, resumed = fitted(lessons, kept, epochs=3)
    assert len(run) == 1
    assert same(whole, rest)
    assert resumed.held_out_loss == report.held_out_loss
    assert not list((kept.folder).glob("*.pt")), "nothing is left of a training that ended"


@on_a_gpu
@pytest.mark.parametrize("variant", ["pixel", "both", "voxel"])
def test_a_gpu_learns_what_a_cpu_does(
    lessons: list[Lesson], kept: PieceCache, variant: str
) -> None:
    reports = [
        train(
            *(lessons, variant, "density", replace(SHORT, epochs=6, device=device)),
            seed=0,
            kept=kept,
        )[1]
        for device in ("cpu", "cuda")
    ]
    on_cpu, on_gpu = (report.held_out_loss for report in reports)
    assert on_gpu == pytest.approx(on_cpu, rel=0.02)


@on_a_gpu
def test_a_training_that_was_killed_goes_on_on_a_gpu(
    lessons: list[Lesson], kept: PieceCache, monkeypatch: pytest.MonkeyPatch
) -> None:
    how = replace(SHORT, epochs=3, device="cuda")
    whole = train(lessons, "pixel", "density", how, seed=0, kept=kept)[1]
    exams, exam = iter([None, None, KeyboardInterrupt]), training._exam_loss

    def killed(model: XField, *rest: object) -> float:
        if (error := next(exams)) is not None:
            raise error
        return exam(model, *rest)

    with monkeypatch.context() as patch:
        patch.setattr(training, "_exam_loss", killed)
        with pytest.raises(KeyboardInterrupt):
            train(lessons, "pixel", "density", how, seed=0, kept=kept)
    model, resumed = train(lessons, "pixel", "density", how, seed=0, kept=kept)
    assert {one.device.type for one in model.parameters()} == {"cuda"}
    assert resumed.held_out_loss == pytest.approx(whole.held_out_loss, rel=0.02)


def test_the_weights_of_the_best_epoch_are_kept(
    lessons: list[Lesson], kept: PieceCache, monkeypatch: pytest.MonkeyPatch
) -> None:
    losses, seen = iter([2.0, 1.0, 3.0]), []

    def exam(model: XField, *_: object) -> float:
        seen.append({name: one.clone() for name, one in model.state_dict().items()})
        return next(losses)

    monkeypatch.setattr(training, "_exam_loss", exam)
    weights, report = fitted(lessons, kept, epochs=3)
    assert report.best_epoch == 2
    assert same(weights, seen[1])
    assert "epoch 2 of 3, " in report.summary
    on_gpu = replace(report, settings={**report.settings, "device": "cuda"})
    assert "epoch 2 of 3 on cuda, " in on_gpu.summary


@pytest.mark.parametrize("count", [2, 3, 7])
def test_the_gradients_of_all_processes_add_up_to_those_of_one(
    lessons: list[Lesson], count: int
) -> None:
    torch.manual_seed(0)
    model = XField(variant="both", size="tiny", target="density")
    batch = training.gathered(lessons, 64, np.random.default_rng(0))

    def slopes(crew: Crew) -> list[Tensor]:
        model.zero_grad(set_to_none=True)
        training._add_slopes(model, batch, "cpu", crew)
        return [torch.zeros_like(one) if one.grad is None else one.grad for one in weights]

    class Apart(Crew):
        """Adds nothing up."""

        def add_gradients(self, model: torch.nn.Module) -> None:
            pass

    weights = list(model.parameters())
    whole = slopes(ALONE)
    each = [slopes(Apart(rank, count)) for rank in range(count)]
    for one, *shares in zip(whole, *each, strict=True):
        assert torch.allclose(one, sum(shares), rtol=1e-4, atol=1e-6)


def test_several_processes_take_no_budget_in_seconds(
    lessons: list[Lesson], kept: PieceCache
) -> None:
    with pytest.raises(DataError, match="in epochs, not in seconds"):
        train(
            *(lessons, "rays", "density", SHORT),
            seed=0,
            budget=Budget(seconds=1.0),
            kept=kept,
            crew=Crew(0, 2),
        )


def test_a_training_that_is_kept_is_taken_up_from_its_end(
    lessons: list[Lesson], kept: PieceCache, monkeypatch: pytest.MonkeyPatch
) -> None:
    once, report = train(lessons, "rays", "density", SHORT, seed=0, kept=kept, keep=True)
    monkeypatch.delattr(training, "_epoch")  # nothing is learned again
    again, same_report = train(lessons, "rays", "density", SHORT, seed=0, kept=kept)
    assert same(once.state_dict(), again.state_dict())
    assert report == same_report
    assert not list(kept.folder.glob("*.pt"))


@pytest.mark.slow
def test_two_processes_of_torchrun_train_what_one_does_and_a_baseline_takes_it_up(
    tmp_path: Path,
) -> None:
    root = dataset(tmp_path / "dataset").root
    asked = ["x-field-both", "--root", str(root), "--budget", "2epochs"]
    asked += ["--set", "batch=3", "--set", "queries=16", "--set", "held_out=0.25"]

    def run(processes: int, *command: str) -> str:
        cache = {"XDG_CACHE_HOME": str(tmp_path / str(processes)), LIMIT_VARIABLE: "1"}
        ran = subprocess.run(  # noqa: S603
            [sys.executable, *command], env=os.environ | cache, capture_output=True, text=True
        )
        assert ran.returncode == 0, ran.stderr
        return ran.stdout

    def trained(processes: int) -> dict:
        launcher = ["-m", "torch.distributed.run", "--nproc-per-node", str(processes), "-m"]
        report = json.loads(
            run(processes, *launcher, "xden_baselines.xfield", "train", *asked, "--json")
        )
        assert report.pop("processes") == processes
        return report

    one, two = trained(1), trained(2)
    assert one["held_out_loss"] == pytest.approx(two["held_out_loss"], rel=1e-3)
    fit = tmp_path / "fit"
    out = ["--task", "segments", "--save", str(fit), "--out", str(tmp_path / "segments.npz")]
    run(2, "-c", "from xden_bench.cli import cli; cli()", "baseline", *asked, *out)
    saved = json.loads((fit / "state" / "training.json").read_text())
    assert saved == {name: two[name] for name in saved}


@pytest.mark.parametrize(
    ("told", "message"),
    [
        (["x-field"], "XDEN1K_CACHE_GB is 0: what is trained would not be kept"),
        (["x-filed"], "no variant of X-Field 'x-filed': expected one of"),
        (["x-field", "--set", "sise=tiny"], "x-field: .*unexpected keyword argument 'sise'"),
        (["x-field", "--budget", "ten"], "a budget must be like 20epochs"),
    ],
)
def test_what_cannot_be_trained_ahead_is_refused_before_it_is(
    tmp_path: Path, told: list[str], message: str
) -> None:
    root = dataset(tmp_path / "dataset").root
    ran = CliRunner().invoke(cli, ["train", *told, "--root", str(root)])
    assert ran.exit_code == 1
    assert re.search(message, ran.stderr)
    assert len(ran.stderr.splitlines()) == 1


def test_a_budget_ends_the_training(lessons: list[Lesson], kept: PieceCache) -> None:
    budget = Budget(seconds=1e-3)
    _, report = train(lessons, "rays", "density", SHORT, seed=0, budget=budget, kept=kept)
    assert report.epochs == 1


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"size": "huge"}, "size must be one of .*'tiny'.*, got 'huge'"),
        ({"queries": 0}, "queries must be positive, got 0"),
        ({"jitter_deg": -1}, "jitter_deg must lie between 0 and 10, got -1"),
        ({"held_out": 1.0}, "held_out must lie between 0 and 1, got 1.0"),
    ],
)
def test_settings_out_of_range_are_refused(wrong: dict, message: str) -> None:
    with pytest.raises(DataError, match=message):
        Settings(**wrong)


@pytest.mark.slow
def test_a_tiny_network_learns_eight_objects_by_heart(tmp_path: Path, kept: PieceCache) -> None:
    shapes = [BAR, BAR[::-1], FILLED, FILLED[::-1], HOLLOW, CUBE, RODS, RODS[::-1]]
    objects = []
    for number, boxes in enumerate(shapes):
        densities = [0.5 + number / 2, 4.0 - number / 3]
        boxes = [
            replace(box, density_g_cm3=density)
            for box, density in zip(boxes, densities, strict=False)
        ]
        objects.append(colored(f"box-{number:04d}", boxes, split="train", category="box"))
    write_folder(objects, tmp_path / "eight", version="0.1.0", builder="tests")
    read = Examples(open_folder(tmp_path / "eight"), "train", Modality.GEOMETRY | Modality.XRAY)
    eight = [lesson(example, replace(SIZES["tiny"], points=128)) for example in read]
    # each twice, so that the one held out is learned too: 800 steps, since after 400 of them 9 % of
    # the variance are left
    exact = Settings(**EXACT, mirrored=False, batch=8, held_out=1 / 16, epochs=400)
    model, _ = train([*eight, *eight], "pixel", "density", exact, seed=0, kept=kept)
    batch = training.gathered(eight, 2000, np.random.default_rng(1))
    with torch.inference_mode():
        found = model(batch.inputs, batch.places).density_g_cm3[..., 0]
    error = (batch.weight * (found - batch.density_g_cm3).square()).mean()
    assert error < 0.05 * batch.density_g_cm3.var()
