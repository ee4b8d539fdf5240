"""Where to start the search for the poses: each turned view laid onto its shadow by itself.

An object that was turned by hand lies some degrees and centimetres off its word, too far for steps
along derivatives. Its densities are told by the views that were not turned; then the middle of the
shadow gives the shift across the beam, and a search on coarse images from several turns the rest.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from jaxtyping import Float64

from xden1k.values.arrays import Vec3
from xden_builder.poly.descent import descend
from xden_builder.poly.model.frames import Pose, coarse
from xden_builder.poly.model.poses import Poses
from xden_builder.poly.pyramid import Level
from xden_builder.poly.target import Target, window

__all__ = ["aligned"]

OBJECT_PX: Final = 24
"""Width of the object in the images that are searched."""
AIR: Final = 0.9
"""Quantile of the transmission that is taken for the open field."""
FAINTEST: Final = 0.04
"""Share of the open field that is no shadow yet: noise and stray light."""
TURN_RAD: Final = 0.09
"""A search starts from the told turn, and one from so far off it either way about each axis."""
MOST_DERIVATIVES: Final = 4
"""Taken from each start, and for the densities."""
ROUNDS: Final = 3
"""Of laying middles onto each other: what the panel cuts off comes into sight by it."""
TOLD_SHARES: Final = (0.7, 1.4)
"""Least and most density in shares of what the other views tell."""
CANDIDATES: Final = 3
"""At most handed over, where searches from several turns do not end at one."""
SAME_RAD: Final = 0.03
"""Turns that are apart by less are the same."""
EVERYWHERE: Final = (slice(None), slice(None))

Unknowns = Float64[np.ndarray, "u"]


def aligned(
    target: Target, poses: Poses, density_g_cm3: Float64[np.ndarray, "k"]
) -> list[Unknowns]:
    """Give where to start from: densities by the views that are not turned, rough poses of others.

    Where one view alone does not decide, there are several: the best one first.

    Parameters
    ----------
    target, poses
        What is searched for; the shared pose is left at rest.
    density_g_cm3
        Shape (K,): to start from.
    """
    turned = np.array(poses.turned)
    shared = target.only(*np.flatnonzero(~turned).tolist())
    density_g_cm3 = _densities(shared, poses, density_g_cm3)
    starts = np.zeros((CANDIDATES, poses.count))
    for number in np.flatnonzero(turned).tolist():
        found = _alone(target.only(number), poses.origin, density_g_cm3)
        starts[:, poses.places(number)] = found
    different = [0, *(n for n in range(1, CANDIDATES) if (starts[n] != starts[0]).any())]
    return [target.start(density_g_cm3, starts[number]) for number in different]


def _densities(
    shared: Target, poses: Poses, density_g_cm3: Float64[np.ndarray, "k"]
) -> Float64[np.ndarray, "k"]:
    """Densities of the parts by the views that share a pose, on coarse images."""
    poses = Poses((False,) * len(shared.views), poses.origin)
    binning = _binning(shared)
    windows = [window(view.geometry, shared.points_cm, binning) for view in shared.views]
    level = Level.of(shared, poses, windows, binning)
    start = shared.start(density_g_cm3, np.zeros(poses.count))
    bounds = shared.bounds(density_g_cm3, poses.count)
    return descend(level, start, MOST_DERIVATIVES, *bounds).unknowns[: len(density_g_cm3)]


def _alone(
    target: Target, origin: Pose, density_g_cm3: Float64[np.ndarray, "k"]
) -> Float64[np.ndarray, "c 6"]:
    """Rotation vectors and shifts of the object in one turned view, by the best searches.

    The best one is repeated where there are fewer unlike ones.
    """
    poses = Poses((True,), origin)
    whole = Level.of(target, poses, [EVERYWHERE], _binning(target))
    found = sorted((_search(whole, density_g_cm3, turn) for turn in _turns()), key=whole.loss_at)
    rigid = [each[-poses.count :][poses.places(0)] for each in found]
    best = [
        pose
        for number, pose in enumerate(rigid)
        if all(_unlike(pose, other) for other in rigid[:number])
    ]
    return np.stack([*best, *[best[0]] * CANDIDATES])[:CANDIDATES]


def _unlike(one: Float64[np.ndarray, "6"], other: Float64[np.ndarray, "6"]) -> bool:
    """Whether two searches ended at turns that are not the same."""
    return float(np.linalg.norm(one[:3] - other[:3])) > SAME_RAD


def _turns() -> list[Vec3]:
    """Rotation vectors to start from."""
    axes = TURN_RAD * np.eye(3)
    return [np.zeros(3), *axes, *-axes]


def _search(whole: Level, density_g_cm3: Float64[np.ndarray, "k"], turn: Vec3) -> Unknowns:
    """Lay the shadow's middle onto that of the image, then follow the derivatives."""
    target, poses = whole.target, whole.poses
    pose = np.zeros(poses.count)
    pose[poses.places(0)[: len(turn)]] = turn
    for _ in range(ROUNDS):
        pose[poses.places(0)[len(turn) :]] += _shift_cm(whole, target.start(density_g_cm3, pose))
    geometry = poses.geometry(0, target.views[0].geometry, pose)
    around = window(geometry, target.points_cm, whole.binning)
    level = Level.of(target, poses, [around], whole.binning)
    start = target.start(density_g_cm3, pose)
    bounds = target.bounds(density_g_cm3, poses.count, TOLD_SHARES)
    return descend(level, start, MOST_DERIVATIVES, *bounds).unknowns


def _binning(target: Target) -> int:
    """Pixels to be averaged along each side, for the object to be as wide as is enough."""
    places = target.views[0].geometry.project(target.points_cm)[:, :2]
    return max(round(float(np.ptp(places, axis=0).max()) / OBJECT_PX), 1)


def _shift_cm(whole: Level, unknowns: Unknowns) -> Vec3:
    """Shift across the beam by which the model's shadow gets the same middle as the measured one.

    None where either image shows no shadow.
    """
    seen, (model,) = whole.measured[0], whole.images(unknowns)
    middles = [
        _middle_px(whole, each / open_field)
        for each, open_field in ((seen, np.quantile(seen, AIR)), (model, whole.target.gains[0][0]))
    ]
    columns, rows = np.nan_to_num(middles[0] - middles[1])
    geometry = coarse(whole.target.views[0].geometry, whole.binning)
    way_cm = columns * geometry.column_step_cm + rows * geometry.row_step_cm
    if geometry.source_cm is None:
        return np.asarray(way_cm)
    return np.asarray(way_cm * geometry.project(whole.target.centre_cm[None])[0, 2])


def _middle_px(whole: Level, transmission: Float64[np.ndarray, "n"]) -> Float64[np.ndarray, "2"]:
    """Column and row of the middle of a shadow, weighed by its depth; nan where there is none."""
    depth = (1 - FAINTEST - transmission).clip(min=0)
    if not depth.any():
        return np.full(2, np.nan)
    rows, columns = np.nonzero(whole.masks[0])
    return np.asarray(np.array([columns @ depth, rows @ depth]) / depth.sum())
