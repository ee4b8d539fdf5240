"""The training loop: held-out objects choose the epoch, and constants have to be beaten on them."""

from __future__ import annotations

import logging
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from xden1k.errors import DataError
from xden1k.predictor import Budget
from xden1k.values.materials import families
from xden_baselines.features.devices import check_device
from xden_baselines.learning.clock import Clock, half_cosine, torch_threads
from xden_baselines.learning.held_out import split_off
from xden_baselines.pixie.categories import Categories, Kind, Peers
from xden_baselines.pixie.channels import ENVELOPE
from xden_baselines.pixie.losses import Batch, density_mae_g_cm3, gathered, loss, turned
from xden_baselines.pixie.model import VoxelModel
from xden_baselines.pixie.scaling import LogScale
from xden_baselines.pixie.settings import Settings
from xden_baselines.pixie.store import Stored

logger = logging.getLogger(__name__)

__all__ = ["FitReport", "train"]

LAC_PREFIX = "log10_lac"
"""Channels that are calibrated rather than standardised."""
UNNAMED_SHARE = 0.05
"""Of the objects of a step: their category is hidden, so that a new one can be met."""

Told = tuple[Stored, Kind]
"""An object, and what is told of its category."""


@dataclass(frozen=True, slots=True)
class FitReport:
    """How a training run went.

    Parameters
    ----------
    learned_from, held_out
        Objects.
    epochs, best_epoch
        How many there were, and which one's weights were kept, from 1.
    seconds
        Of the loop, preparation apart.
    held_out_mae_g_cm3
        Density error after each epoch on the held-out objects, at the network's resolution.
    train_median_mae_g_cm3, category_median_mae_g_cm3
        The same of the two constants, fitted on the objects learned from.
    """

    learned_from: int
    held_out: int
    epochs: int
    best_epoch: int
    seconds: float
    held_out_mae_g_cm3: tuple[float, ...]
    train_median_mae_g_cm3: float
    category_median_mae_g_cm3: float

    @property
    def best_mae_g_cm3(self) -> float:
        """Error of the weights that were kept."""
        return self.held_out_mae_g_cm3[self.best_epoch - 1]

    @property
    def failed(self) -> bool:
        """Whether a constant does as well on the held-out objects."""
        constants = min(self.train_median_mae_g_cm3, self.category_median_mae_g_cm3)
        return not self.best_mae_g_cm3 < constants

    @property
    def summary(self) -> str:
        """One line for the row of the method."""
        verdict = "FAILED TO BEAT A CONSTANT: " if self.failed else ""
        return (
            f"{verdict}density MAE on {self.held_out} held-out training objects "
            f"{self.best_mae_g_cm3:.3f} g/cm³ (train median {self.train_median_mae_g_cm3:.3f}, "
            f"category median {self.category_median_mae_g_cm3:.3f}), "
            f"epoch {self.best_epoch} of {self.epochs}"
        )


def train(
    objects: Sequence[Stored],
    names: Sequence[str],
    settings: Settings,
    *,
    seed: int,
    budget: Budget | None = None,
) -> tuple[VoxelModel, FitReport]:
    """Train a network.

    The same seed, objects and number of threads give the same weights on the same machine, unless
    the budget is in seconds or the device a GPU.

    Parameters
    ----------
    objects
        To learn from; a share of them is held out.
    names
        Of their channels.
    settings
        How.
    seed
        Of the held-out objects, the first weights, the order, the turns, the hidden names, and of
        which others an object is told.
    budget
        When to stop; seconds are those of the loop. None = the epochs of the settings.

    Returns
    -------
    VoxelModel
        With the weights of the best epoch.
    FitReport
        How it went.

    Raises
    ------
    DataError
        If there are fewer than two objects, or no such device.
    """
    check_device(settings.device)
    rng = np.random.default_rng(seed)
    learned, held_out = split_off(objects, settings.held_out, rng)
    with torch_threads(settings.threads), torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        peers = Peers.of(learned)
        categories = peers.categories
        model = _fresh(learned, names, categories, settings).to(settings.device)
        exam = [(one, categories.kind(one.category)) for one in held_out]
        curve, best, seconds = _loop(_School(model, settings, learned, peers, rng), exam, budget)
    median_mae, category_mae = _constants(learned, held_out)
    report = FitReport(
        learned_from=len(learned),
        held_out=len(held_out),
        epochs=len(curve),
        best_epoch=best,
        seconds=seconds,
        held_out_mae_g_cm3=tuple(curve),
        train_median_mae_g_cm3=median_mae,
        category_median_mae_g_cm3=category_mae,
    )
    return model.eval(), report


def _fresh(
    objects: Sequence[Stored], names: Sequence[str], categories: Categories, settings: Settings
) -> VoxelModel:
    """Make a network whose inputs and outputs are scaled to the training objects."""
    stuff = np.concatenate([one.stuff_g_cm3 for one in objects])
    if not (stuff > 0).any():
        raise DataError("the training objects hold no material: every density is 0")
    scale = LogScale.of(stuff[stuff > 0])
    model = VoxelModel(
        size=settings.size,
        channels=list(names),
        resolution=settings.resolution,
        log10_density=[scale.low, scale.high],
        families=list(families()) if settings.size == "full" else [],
        categories=list(categories.names),
    )
    model.normalise(*_normalisation(objects, names, scale))
    model.usual.copy_(torch.from_numpy(categories.table))
    return model


def _normalisation(
    objects: Sequence[Stored], names: Sequence[str], scale: LogScale
) -> tuple[Float[Tensor, "channels"], Float[Tensor, "channels"]]:
    """Mean 0 and deviation 1 over all voxels; radiographs as the density they speak of.

    A line through log10 attenuation and log10 mean density, by least squares, takes the former
    into the unit of the network's output.
    """
    values = np.concatenate([one.channels for one in objects], axis=1).astype(np.float64)
    offset, gain = values.mean(axis=1), 1 / values.std(axis=1).clip(1e-3, None)
    offset[ENVELOPE], gain[ENVELOPE] = 0, 1
    mean = np.concatenate([one.mean_g_cm3 for one in objects]).astype(np.float64)
    for index in (i for i, name in enumerate(names) if name.startswith(LAC_PREFIX)):
        slope, constant = _line(values[index, mean > 0], np.log10(mean[mean > 0]))
        gain[index] = slope * 2 / (scale.high - scale.low)
        offset[index] = ((scale.low + scale.high) / 2 - constant) / slope
    return torch.from_numpy(offset).float(), torch.from_numpy(gain).float()


def _line(known: Float[np.ndarray, "n"], wanted: Float[np.ndarray, "n"]) -> tuple[float, float]:
    """Slope and constant by least squares; slope 1 where nothing varies or it would fall."""
    spread = known.var()
    slope = float(np.mean((known - known.mean()) * (wanted - wanted.mean())) / max(spread, 1e-12))
    if spread < 1e-6 or slope < 1e-2:
        slope = 1.0
    return slope, float(wanted.mean() - slope * known.mean())


@dataclass(frozen=True, slots=True, eq=False)
class _School:
    """Who learns, from what, and how."""

    model: VoxelModel
    settings: Settings
    objects: Sequence[Stored]
    peers: Peers
    rng: np.random.Generator

    def batch(self, told: Sequence[Told]) -> Batch:
        """Gather objects as they are."""
        objects, kinds = zip(*told, strict=True)
        return gathered(objects, kinds, self.settings.resolution).to(self.settings.device)

    def varied(self, numbers: Sequence[int]) -> Batch:
        """Gather objects to learn from, turned at random, some without their category's name."""
        told = [(self.objects[number], self._kind(number)) for number in numbers]
        order, signs = _turn(self.settings.turned, self.rng)
        return turned(self.batch(told), self.model.channels, order, signs)

    def _kind(self, number: int) -> Kind:
        if self.rng.random() < UNNAMED_SHARE:
            return self.peers.categories.kinds[-1]
        return self.peers.drawn(number, self.rng)


def _turn(how: str, rng: np.random.Generator) -> tuple[list[int], list[int]]:
    """Draw the order of the axes and their signs."""
    order, signs = [0, 1, 2], [1, 1, 1]
    if how == "cube":
        order = rng.permutation(3).tolist()
    if how != "none":
        signs = rng.choice([-1, 1], 3).tolist()
    return order, signs if how == "cube" else [*signs[:2], 1]


def _loop(
    school: _School, exam: Sequence[Told], budget: Budget | None
) -> tuple[list[float], int, float]:
    """Train until the budget or the patience ends; keep the best epoch's weights."""
    model, settings = school.model, school.settings
    optimiser = torch.optim.Adam(model.parameters(), lr=settings.learning_rate)
    clock = Clock(budget, settings.epochs)
    curve: list[float] = []
    best, kept = 0, model.state_dict()
    while clock.left(len(curve)) and len(curve) - best < settings.patience:
        for group in optimiser.param_groups:
            group["lr"] = settings.learning_rate * half_cosine(clock.progress(len(curve)))
        _epoch(school, optimiser)
        curve.append(_error(school, exam))
        logger.info("epoch %d: %.4f g/cm³ after %.0f s", len(curve), curve[-1], clock.seconds)
        if len(curve) == 1 or curve[-1] < curve[best - 1]:
            best = len(curve)
            kept = {name: value.clone() for name, value in model.state_dict().items()}
    model.load_state_dict(kept)
    return curve, best, clock.seconds


def _epoch(school: _School, optimiser: torch.optim.Optimizer) -> None:
    model, step = school.model.train(), school.settings.batch
    order = school.rng.permutation(len(school.objects)).tolist()
    for start in range(0, len(order), step):
        batch = school.varied(order[start : start + step])
        optimiser.zero_grad(set_to_none=True)
        torch.autograd.backward(_loss(model, batch, school.settings.device))
        torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimiser.step()


def _loss(model: VoxelModel, batch: Batch, device: str) -> Float[Tensor, ""]:
    with torch.autocast(device.split(":")[0], dtype=torch.bfloat16, enabled=device != "cpu"):
        outputs = model(*batch.inputs)
    return loss(outputs, batch, model.scale)


def _error(school: _School, exam: Sequence[Told]) -> float:
    """Mean density error over objects."""
    model = school.model.eval()
    errors: list[float] = []
    with torch.inference_mode():
        for one in exam:
            batch = school.batch([one])
            errors += density_mae_g_cm3(model(*batch.inputs).density_g_cm3, batch).tolist()
    return float(np.mean(errors))


def _constants(learned: Sequence[Stored], held_out: Sequence[Stored]) -> tuple[float, float]:
    """Mean density error of the train median and of the category median on held-out objects."""
    by_category: dict[str, list[float]] = defaultdict(list)
    for one in learned:
        by_category[one.category].append(one.overall_g_cm3)
    overall = median([value for values in by_category.values() for value in values])
    medians = {category: median(values) for category, values in by_category.items()}
    return (
        float(np.mean([_constant_error(one, overall) for one in held_out])),
        float(
            np.mean([_constant_error(one, medians.get(one.category, overall)) for one in held_out])
        ),
    )


def _constant_error(one: Stored, density_g_cm3: float) -> float:
    """Density error of one value everywhere."""
    error = np.abs(one.mean_g_cm3.astype(np.float64) - density_g_cm3)
    return float((error * np.square(one.envelope)).sum() / one.envelope.sum(dtype=np.float64))
