"""Batches of training objects: points drawn, objects mirrored, radiographs misaligned."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np
import torch
from jaxtyping import Float, Float32, Int64, Integer
from torch import Tensor
from torch.nn import functional

from xden1k.segmentation import GRID_SIZE
from xden_baselines.xfield.lessons import Lesson
from xden_baselines.xfield.network import Inputs
from xden_baselines.xfield.seen import Seen
from xden_baselines.xfield.settings import Settings

__all__ = ["HORIZONTAL", "Batch", "gathered", "inputs_of", "mirrored", "misaligned"]

HORIZONTAL: Final = (0, 1)
"""Axes along which objects are mirrored: z is up."""


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """Objects and what is asked about them.

    Parameters
    ----------
    inputs
        What is seen.
    places
        Where, in units of the cube.
    density_g_cm3, owner
        What is there, and of which part; 0 = void.
    weight
        Of each point, so that a weighted mean is one over the volume; its mean is about 1.
    third
        Line integrals along z.
    """

    inputs: Inputs
    places: Float[Tensor, "batch points 3"]
    density_g_cm3: Float[Tensor, "batch points"]
    owner: Int64[Tensor, "batch points"]
    weight: Float[Tensor, "batch points"]
    third: Float[Tensor, "batch u v"]

    def to(self, device: str) -> Batch:
        """Move to a device."""
        inputs = Inputs(*(getattr(self.inputs, one.name).to(device) for one in fields(Inputs)))
        rest = [getattr(self, one.name).to(device) for one in fields(self)[1:]]
        return Batch(inputs, *rest)

    def objects(self, chosen: slice) -> Batch:
        """Take some of the objects."""
        inputs = Inputs(*(getattr(self.inputs, one.name)[chosen] for one in fields(Inputs)))
        return Batch(inputs, *(getattr(self, one.name)[chosen] for one in fields(self)[1:]))


def inputs_of(objects: Sequence[Seen]) -> Inputs:
    """Stack what is seen of objects."""
    arrays = (
        np.stack([np.asarray(getattr(one, field.name), np.float32) for one in objects])
        for field in fields(Inputs)
    )
    return Inputs(*map(torch.from_numpy, arrays))


def gathered(lessons: Sequence[Lesson], queries: int, rng: np.random.Generator) -> Batch:
    """Draw points of objects: half of them from all, half from each part alike."""
    drawn = [_drawn(one.owner, queries, rng) for one in lessons]
    places, density, owner, weight, third = (
        torch.from_numpy(np.stack(arrays))
        for arrays in zip(
            *(
                (
                    one.places(chosen),
                    one.densities_g_cm3[one.owner[chosen]],
                    one.owner[chosen].astype(np.int64),
                    weight,
                    one.third.astype(np.float32),
                )
                for one, (chosen, weight) in zip(lessons, drawn, strict=True)
            ),
            strict=True,
        )
    )
    return Batch(inputs_of(lessons), places, density, owner, weight, third)


def mirrored(lesson: Lesson, axes: Iterable[int]) -> Lesson:
    """Mirror an object along axes of its cube, and the radiographs whose columns run along one."""
    for axis in axes:
        lesson = _mirrored(lesson, axis)
    return lesson


def misaligned(inputs: Inputs, how: Settings, rng: np.random.Generator) -> Inputs:
    """Turn, shift, enlarge and brighten each radiograph a little; what is told of it stays."""
    views = inputs.transmission.shape[:2]
    if not views[1]:
        return inputs
    deviations = (np.deg2rad(how.jitter_deg), how.jitter_scale, how.jitter_gain)
    angle, scale, gain = (sd * rng.standard_normal(views) for sd in deviations)
    shift = 2 * how.jitter_shift * rng.standard_normal((*views, 2))
    turn = np.stack([np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)], axis=-1)
    matrix = (turn * np.exp(scale)[..., None]).reshape(*views, 2, 2)
    affine = torch.from_numpy(np.concatenate([matrix, shift[..., None]], axis=-1)).float()
    absorbed = (1 - inputs.transmission).flatten(0, 1)[:, None]
    at = functional.affine_grid(affine.flatten(0, 1), list(absorbed.shape), align_corners=False)
    moved = functional.grid_sample(absorbed, at, align_corners=False)  # air comes in at the edges
    bright = torch.from_numpy(np.exp(gain)).float()[..., None, None]
    return replace(inputs, transmission=(1 - moved.reshape(inputs.transmission.shape)) * bright)


def _drawn(
    owner: Integer[np.ndarray, "points"], queries: int, rng: np.random.Generator
) -> tuple[Int64[np.ndarray, "queries"], Float32[np.ndarray, "queries"]]:
    """Draw points, with replacement, and what each weighs."""
    _, inverse, sizes = np.unique(owner, return_inverse=True, return_counts=True)
    evenly = 1 / len(owner)
    chance = evenly / 2 + 1 / (2 * len(sizes) * sizes[inverse])
    chosen = rng.choice(len(owner), queries, p=chance)
    return chosen, (evenly / chance[chosen]).astype(np.float32)


def _mirrored(lesson: Lesson, axis: int) -> Lesson:
    surface, matrices = lesson.surface.copy(), lesson.projection.copy()
    surface[:, [axis, axis + 3]] *= -1
    matrices[:, :, axis] *= -1
    # a view whose columns run along the axis is mirrored too; seen along it, it stays as it is
    turned = np.abs(matrices[:, 0, :3]).argmax(axis=1) == axis
    transmission, chord = lesson.transmission.copy(), lesson.chord.copy()
    for view in np.flatnonzero(turned):
        matrices[view, 0] *= -1
        transmission[view], chord[view] = transmission[view, :, ::-1], chord[view, :, ::-1]
    voxels = lesson.voxels.copy()
    voxels[:, axis] = GRID_SIZE - 1 - voxels[:, axis]
    return replace(
        lesson,
        surface=surface,
        projection=matrices,
        transmission=transmission,
        chord=chord,
        voxels=voxels,
        third=np.flip(lesson.third, axis),
    )
