"""The training loop of the network of the surface: held-out objects choose the epoch."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int64
from torch import Tensor
from torch.nn import functional

from xden1k.predictor import Budget
from xden_baselines.features.devices import check_device
from xden_baselines.learning.clock import Clock, half_cosine, torch_threads
from xden_baselines.learning.held_out import split_off
from xden_baselines.surface.lessons import UNKNOWN, Lesson
from xden_baselines.surface.network import PixelNetwork, as_input
from xden_baselines.surface.settings import Settings

logger = logging.getLogger(__name__)

__all__ = ["FitReport", "train"]

EXPOSURE = 0.15
"""Training pictures are made brighter and darker by up to this share."""


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
    held_out_cross_entropy
        After each epoch, mean over the pixels of the held-out objects.
    held_out_right
        Share of these pixels whose material was named by the weights that were kept.
    """

    learned_from: int
    held_out: int
    epochs: int
    best_epoch: int
    seconds: float
    held_out_cross_entropy: tuple[float, ...]
    held_out_right: float

    @property
    def summary(self) -> str:
        """One line for the row of the method."""
        return (
            f"material right on {self.held_out_right:.0%} of the pixels of {self.held_out} "
            f"held-out training objects, epoch {self.best_epoch} of {self.epochs}"
        )


Batch = tuple[Float[Tensor, "batch 4 rows columns"], Int64[Tensor, "batch down across"]]


def train(
    objects: Sequence[Sequence[Lesson]],
    materials: Sequence[str],
    settings: Settings,
    *,
    seed: int,
    budget: Budget | None = None,
) -> tuple[PixelNetwork, FitReport]:
    """Train a network.

    The same seed, objects and number of threads give the same weights on the same machine, unless
    the budget is in seconds or the device a GPU.

    Parameters
    ----------
    objects
        The lessons of each; a share of the objects is held out.
    materials
        Names of what is told apart.
    settings
        How.
    seed
        Of the held-out objects, the first weights, the order and the changes of pictures.
    budget
        When to stop; seconds are those of the loop. None = the epochs of the settings.

    Raises
    ------
    DataError
        If there are fewer than two objects, or no such device.
    """
    check_device(settings.device)
    rng = np.random.default_rng(seed)
    learned, held_out = split_off(objects, settings.held_out, rng)
    lessons = [one for known in learned for one in known]
    exam = [one for known in held_out for one in known]
    with torch_threads(settings.threads), torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        model = PixelNetwork(materials=list(materials)).to(settings.device)
        curve, best, seconds = _loop(model, lessons, exam, settings, rng, budget)
        right = _judged(model, exam, settings)[1]
    report = FitReport(len(learned), len(held_out), len(curve), best, seconds, tuple(curve), right)
    return model.eval(), report


def _loop(
    model: PixelNetwork,
    lessons: Sequence[Lesson],
    exam: Sequence[Lesson],
    settings: Settings,
    rng: np.random.Generator,
    budget: Budget | None,
) -> tuple[list[float], int, float]:
    """Train until the budget or the patience ends; keep the best epoch's weights."""
    optimiser = torch.optim.Adam(model.parameters(), lr=settings.learning_rate)
    clock = Clock(budget, settings.epochs)
    curve: list[float] = []
    best, kept = 0, model.state_dict()
    while clock.left(len(curve)) and len(curve) - best < settings.patience:
        for group in optimiser.param_groups:
            group["lr"] = settings.learning_rate * half_cosine(clock.progress(len(curve)))
        _epoch(model, optimiser, lessons, settings, rng)
        curve.append(_judged(model, exam, settings)[0])
        logger.info(
            "epoch %d: cross-entropy %.4f after %.0f s", len(curve), curve[-1], clock.seconds
        )
        if len(curve) == 1 or curve[-1] < curve[best - 1]:
            best = len(curve)
            kept = {name: value.clone() for name, value in model.state_dict().items()}
    model.load_state_dict(kept)
    return curve, best, clock.seconds


def _epoch(
    model: PixelNetwork,
    optimiser: torch.optim.Optimizer,
    lessons: Sequence[Lesson],
    settings: Settings,
    rng: np.random.Generator,
) -> None:
    model.train()
    order = rng.permutation(len(lessons)).tolist()
    for start in range(0, len(order), settings.batch):
        chosen = [lessons[number] for number in order[start : start + settings.batch]]
        pictures, materials = _batch(chosen, settings.device)
        pictures, materials = _varied(pictures, materials, rng)
        optimiser.zero_grad(set_to_none=True)
        loss = functional.cross_entropy(model(pictures), materials, ignore_index=UNKNOWN)
        torch.autograd.backward(loss)
        torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimiser.step()


def _batch(lessons: Sequence[Lesson], device: str) -> Batch:
    """Gather pictures of one size."""
    colors = torch.from_numpy(np.stack([one.picture for one in lessons])).to(device) / 255
    masks = torch.from_numpy(np.stack([one.mask for one in lessons])).to(device).float()
    materials = torch.from_numpy(np.stack([one.materials for one in lessons])).to(device).long()
    pictures = as_input(colors, masks)
    extra = [pictures.shape[i] // (masks.shape[i - 1] // materials.shape[i - 1]) for i in (2, 3)]
    short = (0, extra[1] - materials.shape[2], 0, extra[0] - materials.shape[1])
    return pictures, functional.pad(materials, short, value=UNKNOWN)


def _varied(
    pictures: Float[Tensor, "batch 4 rows columns"],
    materials: Int64[Tensor, "batch down across"],
    rng: np.random.Generator,
) -> Batch:
    """Turn left into right, or not, and change the exposure."""
    if rng.random() < 0.5:
        pictures, materials = pictures.flip(-1), materials.flip(-1)
    factor = 1 + rng.uniform(-EXPOSURE, EXPOSURE)
    colors, mask = pictures[:, :3], pictures[:, 3:]
    brighter = ((colors + 1) * factor - 1).clamp(max=1) * mask
    return torch.cat([brighter, mask], dim=1), materials


def _judged(model: PixelNetwork, exam: Sequence[Lesson], settings: Settings) -> tuple[float, float]:
    """Cross-entropy and share of right answers over the pixels of known material."""
    model.eval()
    lost = right = count = 0.0
    with torch.inference_mode():
        for one in exam:
            pictures, materials = _batch([one], settings.device)
            logits = model(pictures)
            known = materials != UNKNOWN
            lost += float(
                functional.cross_entropy(logits, materials, ignore_index=UNKNOWN, reduction="sum")
            )
            right += float((logits.argmax(dim=1) == materials)[known].sum())
            count += float(known.sum())
    return lost / max(count, 1), right / max(count, 1)
