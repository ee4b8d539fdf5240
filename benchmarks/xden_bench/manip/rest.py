"""How an object comes to lie on a table: dropped, in simulation, with its true mass properties."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from xden1k.export.si import M_PER_CM, MM_PER_CM
from xden1k.values.mass import MassProperties
from xden_bench.manip.pose import Pose, turn_between_deg
from xden_bench.manip.protocol import ManipProtocol, RestRules
from xden_bench.manip.scene import OBJECT, mujoco, table_scene

__all__ = ["Rest", "rest_of", "watched_at_rest"]


@dataclass(frozen=True, slots=True, eq=False)
class Rest:
    """Where an object came to lie.

    Parameters
    ----------
    pose
        At the end.
    speed_mm_s, turn_deg_s
        Mean ones over the calm time before the end, of the centre of mass and of the object.
    penetration_cm
        Deepest contact at the end.
    """

    pose: Pose
    speed_mm_s: float
    turn_deg_s: float
    penetration_cm: float

    def is_calm(self, rules: RestRules) -> bool:
        """Whether it lies, by the protocol."""
        return (
            self.speed_mm_s <= rules.max_speed_mm_s
            and self.turn_deg_s <= rules.max_turn_deg_s
            and self.penetration_cm <= rules.max_penetration_cm
        )


def rest_of(
    hulls: Sequence[trimesh.Trimesh],
    mass: MassProperties,
    rules: ManipProtocol,
    generator: np.random.Generator,
) -> Rest:
    """Drop an object and wait until it is calm, as long as the protocol waits.

    Parameters
    ----------
    hulls
        Convex, cm, in the object's frame.
    mass
        Of the object.
    rules
        The protocol.
    generator
        Of the direction in which it is tilted at first.
    """
    model = table_scene(hulls, mass, rules.solver).compile()
    data = _placed(model, _dropped(hulls, rules.rest, generator))
    for _ in range(round(rules.rest.max_time_s / rules.rest.calm_time_s)):
        rest = _watched(model, data, rules.rest)
        if rest.is_calm(rules.rest):
            break
    return rest


def watched_at_rest(
    hulls: Sequence[trimesh.Trimesh], mass: MassProperties, rules: ManipProtocol, pose: Pose
) -> Rest:
    """See what an object that lies does in as long as it must be calm: creep, and sink.

    Parameters
    ----------
    hulls, mass, rules
        As in :func:`rest_of`.
    pose
        In which it lies.
    """
    model = table_scene(hulls, mass, rules.solver).compile()
    return _watched(model, _placed(model, pose), rules.rest)


def _placed(model: Any, pose: Pose) -> Any:
    data = mujoco.MjData(model)
    data.qpos[:7] = pose.qpos
    mujoco.mj_forward(model, data)
    return data


def _watched(model: Any, data: Any, rules: RestRules) -> Rest:
    """Simulate the calm time."""
    before = _seen(data)
    mujoco.mj_step(model, data, nstep=round(rules.calm_time_s / model.opt.timestep))
    return _rest(data, before, rules.calm_time_s)


def _dropped(
    hulls: Sequence[trimesh.Trimesh], rules: RestRules, generator: np.random.Generator
) -> Pose:
    """Tilt the dataset's pose about a drawn horizontal axis, lowest point a little above z = 0."""
    azimuth = generator.uniform(0, 2 * np.pi)
    axis = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    turn = Rotation.from_rotvec(np.radians(rules.tilt_deg) * axis).as_matrix()
    lowest_cm = min(float((np.asarray(hull.vertices) @ turn[2]).min()) for hull in hulls)
    return Pose(turn, np.array([0.0, 0.0, rules.drop_cm - lowest_cm]))


def _seen(data: Any) -> tuple[Pose, np.ndarray]:
    return Pose.of_qpos(data.qpos[:7].copy()), data.body(OBJECT).xipos.copy()


def _rest(data: Any, before: tuple[Pose, np.ndarray], time_s: float) -> Rest:
    """How far it moved since, and how deep it is in the table."""
    (earlier, com_before_m), (pose, com_m) = before, _seen(data)
    moved_cm = float(np.linalg.norm(com_m - com_before_m)) / M_PER_CM
    deepest_m = -min((float(depth) for depth in data.contact.dist), default=0.0)
    return Rest(
        pose,
        MM_PER_CM * moved_cm / time_s,
        turn_between_deg(earlier.rotation, pose.rotation) / time_s,
        deepest_m / M_PER_CM,
    )
