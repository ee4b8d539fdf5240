"""Asking a trained network about points, and about voxels."""

from __future__ import annotations

from itertools import product

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor

from xden1k.access.samples import SampleView
from xden1k.values.arrays import Grid, Points
from xden_baselines.geometry import voxel_centres_cm
from xden_baselines.learning.clock import torch_threads
from xden_baselines.xfield.batches import inputs_of
from xden_baselines.xfield.crops import Cube
from xden_baselines.xfield.network import Inputs, XField
from xden_baselines.xfield.seen import seen
from xden_baselines.xfield.settings import Settings

__all__ = ["answers", "predicted_g_cm3"]

AT_ONCE = 1 << 15
"""Points that are asked about together."""

Answers = tuple[Float32[np.ndarray, "points densities"], Float32[np.ndarray, "points embedding"]]


def answers(model: XField, sample: SampleView, points_cm: Points, settings: Settings) -> Answers:
    """Density, never negative, and embedding of points; no columns of what the network lacks.

    Parameters
    ----------
    model
        Trained.
    sample
        The object.
    points_cm
        Shape (points, 3): inside its outer surface.
    settings
        Threads and device.

    Returns
    -------
    density_g_cm3
        Shape (points, 1 or 0).
    embedding
        Shape (points, 16 or 0).

    Raises
    ------
    DataError
        If a radiograph does not show the object.
    """
    shown = inputs_of([seen(sample, model.size.points, model.size.crop_px)])
    inputs = Inputs(*(getattr(shown, name).to(settings.device) for name in Inputs.__slots__))
    places = torch.from_numpy(Cube.of(sample).places(points_cm)).float().to(settings.device)
    with torch_threads(settings.threads), torch.inference_mode():
        field = model.field(inputs)
        asked = [model.at(field, chunk[None]) for chunk in torch.split(places, AT_ONCE)]
    density = _joined([one.density_g_cm3 for one in asked])
    return density.clip(0, None), _joined([one.embedding for one in asked])


def predicted_g_cm3(model: XField, sample: SampleView, settings: Settings) -> Grid:
    """Voxel means: the mean of eight points of each voxel, times its share of the envelope.

    Raises
    ------
    DataError
        If a radiograph does not show the object.
    """
    inside = sample.envelope > 0
    quarters = sample.voxel_size_cm * np.array(list(product((-0.25, 0.25), repeat=3)))
    points_cm = voxel_centres_cm(sample, inside)[:, None] + quarters
    density, _ = answers(model, sample, points_cm.reshape(-1, 3), settings)
    grid = np.zeros(inside.shape, dtype=np.float32)
    grid[inside] = density.reshape(-1, len(quarters)).mean(axis=1) * sample.envelope[inside]
    return grid


def _joined(
    chunks: list[Float[Tensor, "1 _ channels"]],
) -> Float32[np.ndarray, "points channels"]:
    joined: Float32[np.ndarray, "points channels"] = torch.cat(chunks, dim=1)[0].cpu().numpy()
    return joined
