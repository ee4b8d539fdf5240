"""Adam on dense frames, in torch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import torch
from jaxtyping import Float32, Float64

from xden1k.values.views import XRayView
from xden_builder.fit.observed import ViewData
from xden_builder.fit.problem import Problem
from xden_builder.fit.values import AdamSettings

__all__ = ["descend"]

GAIN_LEARNING_RATE: Final = 0.01

Frame = tuple[
    Float32[torch.Tensor, "k rows columns"],
    Float32[torch.Tensor, "rows columns"],
    Float32[torch.Tensor, "rows columns"],
]
"""Path lengths, image, and 1 where a pixel counts."""


def descend(
    problem: Problem, views: Sequence[XRayView], settings: AdamSettings
) -> tuple[Float64[np.ndarray, "u"], int, bool]:
    """Coefficients and gains where Adam stopped, its steps, and whether the loss had settled."""
    frames = [_dense(data, view) for data, view in zip(problem.views, views, strict=True)]
    lac = torch.full((problem.parts,), settings.start_per_cm, requires_grad=True)
    gains = torch.ones(len(frames), requires_grad=settings.gain)
    groups: list[dict[str, Any]] = [
        {"params": [lac], "lr": settings.learning_rate_per_cm},
        {"params": [gains], "lr": GAIN_LEARNING_RATE},
    ]
    optimiser = torch.optim.Adam(groups)
    schedule = torch.optim.lr_scheduler.ReduceLROnPlateau(
        optimiser, factor=0.5, patience=settings.patience, threshold=1e-6
    )
    losses: list[float] = []
    converged = False
    while len(losses) < settings.max_steps and not converged:
        optimiser.zero_grad()
        loss = _loss(frames, lac, gains)
        losses.append(loss.item())
        converged = _settled(losses, settings)
        if not converged:
            loss.backward()  # type: ignore[no-untyped-call]
            optimiser.step()
            schedule.step(losses[-1])
            with torch.no_grad():
                lac.clamp_(0.0, settings.upper_per_cm)
    return torch.cat([lac, gains]).detach().numpy().astype(np.float64), len(losses), converged


def _dense(data: ViewData, view: XRayView) -> Frame:
    """Path lengths (K, rows, columns), the image, and a mask of the pixels that count."""
    rows, columns = data.lengths.shape
    lengths = np.zeros((data.parts, rows * columns), dtype=np.float32)
    lengths[:, data.lengths.pixels] = data.lengths.lengths_cm[:, 0].T
    mask = view.valid.copy()
    mask.flat[data.lengths.pixels] = data.usable
    image = np.where(mask, view.transmission, 0)
    return (
        torch.from_numpy(lengths.reshape(-1, rows, columns)),
        torch.from_numpy(image),
        torch.from_numpy(mask.astype(np.float32)),
    )


def _loss(frames: Sequence[Frame], lac: torch.Tensor, gains: torch.Tensor) -> torch.Tensor:
    """Eq. 7: the sum of squared residuals over all frames."""
    terms = []
    for (lengths, image, mask), gain in zip(frames, gains, strict=True):
        model = gain * torch.exp(-torch.einsum("k,krc->rc", lac, lengths))
        terms.append((mask * (model - image) ** 2).sum())
    return torch.stack(terms).sum()


def _settled(losses: Sequence[float], settings: AdamSettings) -> bool:
    if settings.target_loss is not None:
        return losses[-1] <= settings.target_loss
    if len(losses) <= settings.patience:
        return False
    recent = losses[-settings.patience - 1 :]
    return max(recent) - min(recent) <= settings.tolerance * losses[-1]
