"""The training loop: it can be killed at any moment, and held-out objects choose the epoch."""

from __future__ import annotations

import hashlib
import io
import json
import logging
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Final

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from xden1k.errors import DataError
from xden1k.format.cache import PieceCache
from xden1k.predictions import Target
from xden1k.predictor import Budget
from xden_baselines.features.devices import check_device
from xden_baselines.learning.clock import Clock, half_cosine, torch_threads
from xden_baselines.learning.held_out import split_off
from xden_baselines.xfield.batches import HORIZONTAL, Batch, gathered, mirrored, misaligned
from xden_baselines.xfield.crew import ALONE, Crew
from xden_baselines.xfield.lessons import Lesson
from xden_baselines.xfield.losses import loss
from xden_baselines.xfield.network import XField
from xden_baselines.xfield.settings import Settings

logger = logging.getLogger(__name__)

__all__ = ["FitReport", "train"]

VERSION: Final = 2
"""Raised whenever the same training gives other weights."""
WARM_UP: Final = 60
"""Steps in which the learning rate rises."""
LAST_RATE: Final = 0.01
"""Learning rate at the end, over that at the beginning."""
LARGEST_GRADIENT: Final = 1.0


@dataclass(frozen=True, slots=True)
class FitReport:
    """How a training run went.

    Parameters
    ----------
    variant, target
        What was trained, and on which density.
    settings
        Fields of :class:`Settings`, errors given to the radiographs among them.
    learned_from, held_out
        Objects.
    epochs, best_epoch
        How many there were, and which one's weights were kept, from 1.
    processor_s
        Of the loop, preparation apart.
    held_out_loss
        After each epoch on the held-out objects.

    Raises
    ------
    ValueError
        If the settings have no size, an amount is negative, or the best epoch is none of them.
    """

    variant: str
    target: Target
    settings: dict[str, Any]
    learned_from: int
    held_out: int
    epochs: int
    best_epoch: int
    processor_s: float
    held_out_loss: tuple[float, ...]

    def __post_init__(self) -> None:
        if "size" not in self.settings:
            raise ValueError("settings must have a size")
        if not min(self.learned_from, self.held_out, self.processor_s, *self.held_out_loss) >= 0:
            raise ValueError("objects, seconds and losses must not be negative")
        if not 1 <= self.best_epoch <= len(self.held_out_loss):
            raise ValueError(
                f"best_epoch must be from 1 to {len(self.held_out_loss)}, got {self.best_epoch}"
            )

    @property
    def summary(self) -> str:
        """One line for the row of the method."""
        device = self.settings.get("device", "cpu")
        where = "" if device == "cpu" else f" on {device}"
        return (
            f"{self.settings['size']} {self.variant}, {self.learned_from} objects, epoch "
            f"{self.best_epoch} of {self.epochs}{where}, {self.processor_s:.0f} s of processor "
            f"time, loss on {self.held_out} held-out training objects "
            f"{self.held_out_loss[self.best_epoch - 1]:.4f}"
        )


def train(
    lessons: Sequence[Lesson],
    variant: str,
    target: Target,
    settings: Settings,
    *,
    seed: int,
    budget: Budget | None = None,
    kept: PieceCache,
    crew: Crew = ALONE,
    keep: bool = False,
) -> tuple[XField, FitReport]:
    """Train a network.

    The same seed, objects and numbers of threads and processes give the same weights on the same
    machine, unless the budget is in seconds or the device a GPU. What was killed goes on after its
    last epoch.

    Parameters
    ----------
    lessons
        To learn from; a share of them is held out.
    variant
        A name in :data:`xden_baselines.xfield.variants.VARIANTS`.
    target
        What their densities are.
    settings
        How.
    seed
        Of the held-out objects, the first weights, the order, the points, mirrors and errors.
    budget
        When to stop; seconds are the processor's, in the loop. None = the epochs of the settings.
    kept
        Where an unfinished training is kept.
    crew
        The processes that train it, each of which calls this with the same arguments.
    keep
        Whether it stays there when it is finished: the same training, asked for again, is then
        taken up from its end.

    Returns
    -------
    XField
        With the weights of the best epoch.
    FitReport
        How it went.

    Raises
    ------
    DataError
        If there are fewer than two objects, no such device, or several processes and a budget in
        seconds, which each would count for itself.
    """
    if crew.count > 1 and budget is not None and budget.seconds is not None:
        raise DataError("several processes train for a budget in epochs, not in seconds")
    device = crew.device(settings.device)
    check_device(device)
    rng = np.random.default_rng(seed)
    learned, held_out = split_off(lessons, settings.held_out, rng)
    name = _name(lessons, variant, target, settings, seed, budget)
    with torch_threads(settings.threads), torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        model = XField(variant=variant, size=settings.size, target=target).to(device)
        school = _School(model, settings, learned, rng, device, crew)
        exam = _exam(held_out, settings, seed)
        course = _loop(school, exam, budget, kept, name)
    if not keep:
        kept.drop(name)
    model.load_state_dict(course.best_weights)
    report = FitReport(
        variant=variant,
        target=target,
        settings=asdict(settings),
        learned_from=len(learned),
        held_out=len(held_out),
        epochs=len(course.curve),
        best_epoch=course.best_epoch,
        processor_s=course.processor_s,
        held_out_loss=tuple(course.curve),
    )
    return model.eval(), report


@dataclass(frozen=True, slots=True, eq=False)
class _School:
    """Who learns, from what, and how."""

    model: XField
    settings: Settings
    lessons: Sequence[Lesson]
    rng: np.random.Generator
    device: str
    crew: Crew

    def batch(self, numbers: Sequence[int]) -> Batch:
        """Gather objects to learn from, mirrored and misaligned at random."""
        chosen = [self._varied(self.lessons[number]) for number in numbers]
        batch = gathered(chosen, self.settings.queries, self.rng)
        return replace(batch, inputs=misaligned(batch.inputs, self.settings, self.rng))

    def _varied(self, lesson: Lesson) -> Lesson:
        if not self.settings.mirrored:
            return lesson
        return mirrored(lesson, [axis for axis in HORIZONTAL if self.rng.random() < 0.5])


@dataclass(slots=True, eq=False)
class _Course:
    """How far a training has come."""

    curve: list[float]
    best_weights: dict[str, Tensor]
    processor_s: float = 0.0

    @property
    def best_epoch(self) -> int:
        """Epoch of the least loss, from 1; 0 before the first."""
        return int(np.argmin(self.curve)) + 1 if self.curve else 0


def _loop(
    school: _School, exam: Sequence[Batch], budget: Budget | None, kept: PieceCache, name: str
) -> _Course:
    """Train until the budget ends, from where it was left."""
    model, settings = school.model, school.settings
    optimiser = torch.optim.AdamW(
        model.parameters(), lr=settings.learning_rate, weight_decay=settings.weight_decay
    )
    course = _Course([], {})
    if (piece := kept.get(name)) is not None:
        course = _taken_up(piece, school, optimiser)
    clock = Clock(budget, settings.epochs, time.process_time, course.processor_s)
    while clock.left(len(course.curve)):
        _epoch(school, optimiser, clock, len(course.curve))
        course.curve.append(_exam_loss(model, exam, school.device, school.crew))
        if course.best_epoch == len(course.curve):
            course.best_weights = {key: one.clone() for key, one in model.state_dict().items()}
        course.processor_s = clock.seconds
        if school.crew.first:
            kept.put(name, _packed(course, school, optimiser))
        logger.info(
            "epoch %d: %.4f after %.0f s", len(course.curve), course.curve[-1], clock.seconds
        )
    return course


def _epoch(school: _School, optimiser: torch.optim.Optimizer, clock: Clock, epochs: int) -> None:
    """Go through all objects once."""
    model, step = school.model.train(), school.settings.batch
    order = school.rng.permutation(len(school.lessons)).tolist()
    starts = range(0, len(order), step)
    for number, start in enumerate(starts):
        done = epochs + number / len(starts)
        rate = LAST_RATE + (1 - LAST_RATE) * half_cosine(clock.progress(done))
        rising = min(1.0, (epochs * len(starts) + number + 1) / WARM_UP)
        for group in optimiser.param_groups:
            group["lr"] = school.settings.learning_rate * rate * rising
        batch = school.batch(order[start : start + step])
        optimiser.zero_grad(set_to_none=True)
        _add_slopes(model, batch, school.device, school.crew)
        torch.nn.utils.clip_grad_norm_(model.parameters(), LARGEST_GRADIENT)
        optimiser.step()


def _add_slopes(model: XField, batch: Batch, device: str, crew: Crew) -> None:
    """Give the weights the slopes of a batch's loss, which is a mean over its objects."""
    own = crew.share_of(batch)
    if share := len(own.places) / len(batch.places):
        torch.autograd.backward(share * _loss(model, own.to(device), device))
    crew.add_gradients(model)


def _loss(model: XField, batch: Batch, device: str) -> Float[Tensor, ""]:
    with torch.autocast(device.split(":")[0], dtype=torch.bfloat16, enabled=device != "cpu"):
        field = model.field(batch.inputs)
        outputs = model.at(field, batch.places)
        return loss(model, field, outputs, batch)


def _exam(held_out: Sequence[Lesson], settings: Settings, seed: int) -> list[Batch]:
    """Draw the points that held-out objects are asked about, once for all epochs."""
    rng = np.random.default_rng(seed)
    return [
        gathered(held_out[start : start + settings.batch], settings.queries, rng)
        for start in range(0, len(held_out), settings.batch)
    ]


def _exam_loss(model: XField, exam: Sequence[Batch], device: str, crew: Crew) -> float:
    """Mean loss over held-out objects."""
    model.eval()
    with torch.inference_mode():
        own = [_loss(model, batch.to(device), device).item() for batch in crew.share(exam)]
    losses = crew.in_order(own)
    return float(np.average(losses, weights=[len(batch.places) for batch in exam]))


def _name(
    lessons: Sequence[Lesson],
    variant: str,
    target: Target,
    settings: Settings,
    seed: int,
    budget: Budget | None,
) -> str:
    """Name a training by all that decides its weights."""
    what = f"{VERSION} {variant} {target} {asdict(settings)} {seed} {budget} {torch.__version__}"
    digest = hashlib.sha256(what.encode())
    for lesson in lessons:
        for field in fields(Lesson):
            digest.update(np.ascontiguousarray(getattr(lesson, field.name)).tobytes())
    return f"{digest.hexdigest()}.pt"


def _packed(course: _Course, school: _School, optimiser: torch.optim.Optimizer) -> bytes:
    state = {
        "curve": course.curve,
        "best_weights": course.best_weights,
        "processor_s": course.processor_s,
        "weights": school.model.state_dict(),
        "optimiser": optimiser.state_dict(),
        "random": json.dumps(school.rng.bit_generator.state),
    }
    file = io.BytesIO()
    torch.save(state, file)
    return file.getvalue()


def _taken_up(piece: bytes, school: _School, optimiser: torch.optim.Optimizer) -> _Course:
    """Put all back as it was after the last epoch."""
    state = torch.load(io.BytesIO(piece), map_location=school.device, weights_only=True)
    school.model.load_state_dict(state["weights"])
    optimiser.load_state_dict(state["optimiser"])
    school.rng.bit_generator.state = json.loads(state["random"])
    return _Course(state["curve"], state["best_weights"], state["processor_s"])
