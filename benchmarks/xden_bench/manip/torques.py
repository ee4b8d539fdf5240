"""What an arm's joints bear to lift and hold what each row takes, and rows side by side.

The arm does not pick: a floating gripper does. The arm is asked what its joints would bear with the
object rigidly in the chosen grasp, whether that holds it or not: a lost object loads nothing, so
that means over held trials alone would praise what drops the heavy ones.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache
from math import pi
from typing import Final

import numpy as np
from jaxtyping import Float64
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from xden1k.errors import DataError
from xden_bench.manip.arm import Arm, ArmModel, Joints
from xden_bench.manip.item import STRATA, Item, Stratum
from xden_bench.manip.pose import Pose
from xden_bench.manip.protocol import StatisticsRules, TrialRules
from xden_bench.manip.rows import Row
from xden_bench.manip.scenes import Scenes
from xden_bench.manip.table import compared_with
from xden_bench.manip.trial import eased
from xden_bench.scoring.bootstrap import Estimate, estimate
from xden_bench.scoring.submission import Progress

__all__ = ["Burden", "BurdenLine", "burden_lines", "burden_of"]

HALF_TURN: Final = np.diag([-1.0, -1.0, 1.0])
"""Of the tool about its approach: the same grasp by the other way round."""
STILL: Final = np.zeros(7)


@dataclass(frozen=True, slots=True)
class Burden:
    """What the joints bear with an object in one grasp: means over azimuths of absolute torques.

    Parameters
    ----------
    last_nm
        Of the last joint in the hold.
    mean_nm
        Mean of all joints in the hold, the arm's own weight included.
    added_nm
        Mean of what the object adds to each joint in the hold.
    lift_nm
        Of the last joint, the largest in the lift.
    out_of_reach
        Share of azimuths from which the arm does not reach the grasp, or cannot lift it.
    """

    last_nm: float
    mean_nm: float
    added_nm: float
    lift_nm: float
    out_of_reach: float


@dataclass(frozen=True, slots=True)
class BurdenLine:
    """A row on one stratum.

    Parameters
    ----------
    name, stratum
        Which.
    figures
        Of :class:`Burden`, each with its bootstrap interval over objects.
    against
        By the name of another row: the differences from it.
    """

    name: str
    stratum: Stratum
    figures: Mapping[str, Estimate]
    against: Mapping[str, Mapping[str, Estimate]]


FIGURES: Final = tuple(one.name for one in fields(Burden))


def burden_of(model: ArmModel, item: Item, candidate: int, rules: TrialRules) -> Burden:
    """Ask what an arm's joints bear to lift and hold an object in one of its grasps.

    Parameters
    ----------
    model
        The arm.
    item
        The object.
    candidate
        Index of the grasp.
    rules
        Of the lift.

    Raises
    ------
    DataError
        If the arm does not reach the grasp from any azimuth.
    """
    grasp = item.grasps.pose(candidate)
    arms = model.empty(), model.holding(item.mass, item.rest.seen_from(grasp))
    befores = list(_befores(item, model.rules.place.reach_cm, model.rules.place.azimuths))
    found = [_bears(*arms, before.of(grasp), rules) for before in befores]
    reached = np.array([one for one in found if one is not None])
    if not len(reached):
        raise DataError(
            f"{item.object_id}: grasp {candidate} is out of the arm's reach from all "
            f"{len(found)} azimuths"
        )
    last_nm, mean_nm, added_nm, lift_nm = reached.mean(axis=0).tolist()
    return Burden(last_nm, mean_nm, added_nm, lift_nm, 1 - len(reached) / len(found))


def _befores(item: Item, reach_cm: float, azimuths: int) -> Iterator[Pose]:
    """Poses of the world of the scenes before the arm's base, the centroid straight ahead."""
    (centroid_cm,) = item.rest.to_world(item.uniform_cm[None])
    over = np.array([*centroid_cm[:2], 0.0])
    for turn in 2 * pi * np.arange(azimuths) / azimuths:
        rotation = Rotation.from_euler("z", turn).as_matrix()
        yield Pose(rotation, np.array([reach_cm, 0.0, 0.0]) - rotation @ over)


def _bears(empty: Arm, arm: Arm, grasp: Pose, rules: TrialRules) -> Float64[np.ndarray, "4"] | None:
    """Figures of one azimuth, in the order of a burden; None where it is out of reach."""
    shares = np.linspace(0, 1, arm.rules.joints.lift_steps + 1)
    knots = _lifted(arm, grasp, rules.lift_cm * eased(shares))
    if knots is None:
        return None
    times_s = rules.lift_s * shares
    path = CubicSpline(times_s, knots, bc_type="clamped")
    lift = [arm.torques_nm(path(at), path(at, 1), path(at, 2))[-1] for at in times_s]
    hold, own = (one.torques_nm(knots[-1], STILL, STILL) for one in (arm, empty))
    added = np.abs(hold - own).mean()
    return np.array([abs(hold[-1]), np.abs(hold).mean(), added, np.abs(lift).max()])


def _lifted(
    arm: Arm, grasp: Pose, heights_cm: Float64[np.ndarray, "steps"]
) -> Float64[np.ndarray, "steps 7"] | None:
    """Joints at each height above a grasp; None where one is out of reach."""
    turned = Pose(grasp.rotation @ HALF_TURN, grasp.origin_cm)
    starts = [(arm.reached(pose, arm.home), pose) for pose in (grasp, turned)]
    reached = [(joints, pose) for joints, pose in starts if joints is not None]
    if not reached:
        return None
    near, pose = min(reached, key=lambda one: float(np.linalg.norm(one[0] - arm.home)))
    knots: list[Joints] = []
    for height_cm in heights_cm:
        above = Pose(pose.rotation, pose.origin_cm + np.array([0.0, 0.0, height_cm]))
        found = arm.reached(above, near)
        if found is None:
            return None
        near = found
        knots.append(found)
    return np.array(knots)


def burden_lines(
    model: ArmModel,
    scenes: Scenes,
    rows: Sequence[Row],
    rules: StatisticsRules,
    progress: Progress = iter,
) -> tuple[BurdenLine, ...]:
    """Ask it of every trial of rows, and compare the rows on each stratum.

    Parameters
    ----------
    model
        The arm.
    scenes
        That were tried.
    rows
        Of one table.
    rules
        Of the bootstrap.
    progress
        Goes through ids of objects.

    Raises
    ------
    DataError
        If the rows are of other scenes or with the mass spread evenly, there is none of ``uniform``
        or ``true``, or a grasp is out of reach.
    """
    scenes.refuse_others(rows[0].facts, homogeneous=False)
    others = compared_with(rows)
    burdens = {name: _burdens(model, scenes, name, rows) for name in progress(scenes.ids)}
    found = []
    for stratum in STRATA:
        ids = [one.object_id for one in rows[0].objects if one.stratum == stratum]
        means = {row.name: np.array([burdens[name][row.name] for name in ids]) for row in rows}
        for name, values in means.items():
            against = {one: _estimates(values - means[one], rules) for one in others}
            found.append(BurdenLine(name, stratum, _estimates(values, rules), against))
    return tuple(found)


def _burdens(
    model: ArmModel, scenes: Scenes, object_id: str, rows: Sequence[Row]
) -> dict[str, Float64[np.ndarray, "figures"]]:
    """Means of each row over its trials of one object; of equal grasps the arm is asked once."""
    item, rules = scenes.item(object_id), scenes.rules.trial

    @cache
    def figures(candidate: int) -> list[float]:
        burden = burden_of(model, item, candidate, rules)
        return [getattr(burden, name) for name in FIGURES]

    trials = {
        row.name: next(one.trials for one in row.objects if one.object_id == object_id)
        for row in rows
    }
    return {
        name: np.mean([figures(trial.candidate) for trial in tried], axis=0)
        for name, tried in trials.items()
    }


def _estimates(
    values: Float64[np.ndarray, "objects figures"], rules: StatisticsRules
) -> dict[str, Estimate]:
    return dict(zip(FIGURES, estimate(values, rules.resamples, rules.seed), strict=True))
