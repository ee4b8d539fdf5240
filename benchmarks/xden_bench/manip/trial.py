"""One pick: the gripper comes, closes, lifts, holds and shakes, and what became of the object."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import cos, pi, sin
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from xden1k.errors import DataError
from xden1k.export.si import M_PER_CM
from xden1k.values.arrays import Vec3
from xden_bench.manip.draws import Draw
from xden_bench.manip.outcome import Outcome, Trial
from xden_bench.manip.pose import Pose, turn_between_deg
from xden_bench.manip.protocol import ManipProtocol, TrialRules
from xden_bench.manip.scene import FINGERS, HAND, OBJECT, TARGET, mujoco

__all__ = ["eased", "pick"]

Watch = Callable[[str, Any], None]
"""Called after each step with the phase's name and the simulator's data."""
Shares = Float[np.ndarray, "steps"]
"""Of the time of a phase, from after the first step to 1."""


@dataclass(frozen=True, slots=True, eq=False)
class Phase:
    """A part of a pick.

    Parameters
    ----------
    name
        What happens.
    targets
        Shape (steps, 7): where the gripper is sent in each step, as :attr:`Pose.qpos`.
    force_n
        With which each finger closes; negative opens.
    """

    name: str
    targets: Float[np.ndarray, "steps 7"]
    force_n: float


def phases(grasp: Pose, draw: Draw, rules: TrialRules, timestep_s: float) -> Iterator[Phase]:
    """Every part of a pick in its order.

    Parameters
    ----------
    grasp
        Of the tool frame in the world.
    draw
        Its conditions.
    rules
        Times and ways.
    timestep_s
        Of the simulator.
    """

    def shares(time_s: float) -> Shares:
        steps = round(time_s / timestep_s)
        return np.arange(1, steps + 1) / steps

    before = _moved(grasp, -rules.retreat_cm * grasp.rotation[:, 2])
    lifted = _moved(grasp, np.array([0.0, 0.0, rules.lift_cm]))
    force = draw.grip_force_n
    yield Phase("wait", _way(before, before, shares(rules.wait_s)), -force)
    yield Phase("descend", _way(before, grasp, shares(rules.descend_s)), -force)
    yield Phase("close", _way(grasp, grasp, shares(rules.close_s)), force)
    yield Phase("lift", _way(grasp, lifted, shares(rules.lift_s)), force)
    yield Phase("hold", _way(lifted, lifted, shares(rules.hold_s)), force)
    yield Phase("shake", _shaken(lifted, draw, rules, shares(rules.shake_s)), force)


def _moved(pose: Pose, by_cm: Vec3) -> Pose:
    return Pose(pose.rotation, pose.origin_cm + by_cm)


def eased(shares: Shares) -> Shares:
    """Share of a way that is done at shares of its time, at rest at both ends: a quintic.

    Examples
    --------
    >>> eased(np.array([0.0, 0.5, 1.0])).tolist()
    [0.0, 0.5, 1.0]
    """
    done: Shares = shares**3 * (10 - 15 * shares + 6 * shares**2)
    return done


def _way(start: Pose, end: Pose, shares: Shares) -> Float[np.ndarray, "steps 7"]:
    """Straight."""
    targets = np.tile(start.qpos, (len(shares), 1))
    targets[:, :3] += M_PER_CM * eased(shares)[:, None] * (end.origin_cm - start.origin_cm)
    return targets


def _shaken(
    pose: Pose, draw: Draw, rules: TrialRules, shares: Shares
) -> Float[np.ndarray, "steps 7"]:
    """Turn to and fro about a horizontal axis and, twice as far, about the approach."""
    angles = draw.shake_rad * np.sin(2 * pi * rules.shake_hz * rules.shake_s * shares)[:, None]
    axis = np.array([cos(draw.shake_azimuth_rad), sin(draw.shake_azimuth_rad), 0.0])
    about_approach = Rotation.from_rotvec(2 * angles * pose.rotation[:, 2])
    turns = Rotation.from_rotvec(angles * axis) * about_approach
    x, y, z, w = (turns * Rotation.from_matrix(pose.rotation)).as_quat().T
    targets = np.tile(pose.qpos, (len(shares), 1))
    targets[:, 3:] = np.column_stack([w, x, y, z])
    return targets


def _unwatched(_phase: str, _data: Any) -> None:
    """See nothing."""


def pick(
    model: Any,
    rest: Pose,
    grasp: Pose,
    width_cm: float,
    draw: Draw,
    rules: ManipProtocol,
    watch: Watch = _unwatched,
) -> Trial:
    """Simulate a pick.

    Parameters
    ----------
    model
        Compiled of :func:`xden_bench.manip.scene.gripper_scene`.
    rest
        Of the object.
    grasp, width_cm
        Of the tool frame in the world, and how wide the object is there.
    draw
        The conditions.
    rules
        The protocol.
    watch
        Sees each step.

    Raises
    ------
    DataError
        If the state is not finite.
    """
    run = _Run(model, rest, grasp, width_cm, draw, rules)
    for phase in run.phases:
        run.go(phase, watch)
    return run.judged()


class _Run:
    """A simulated pick under way."""

    def __init__(
        self, model: Any, rest: Pose, grasp: Pose, width_cm: float, draw: Draw, rules: ManipProtocol
    ) -> None:
        self.model, self.rules = model, rules
        self.data = mujoco.MjData(model)
        self.phases = tuple(phases(grasp, draw, rules.trial, rules.solver.timestep_s))
        self.seen: dict[str, tuple[float, Float[np.ndarray, "3 3"]]] = {}
        self.wrist: dict[str, list[Vec3]] = {"wait": [], "hold": []}
        body = model.body(OBJECT)
        hulls = slice(body.geomadr[0], body.geomadr[0] + body.geomnum[0])
        model.geom_friction[hulls, 0] = draw.friction
        self._place(rest, width_cm / 2 + rules.grasps.clearance_cm)

    def _place(self, rest: Pose, opening_cm: float) -> None:
        """Put the object at rest, and the open gripper where it begins."""
        data, model = self.data, self.model
        for name, qpos in ((OBJECT, rest.qpos), (HAND, self.phases[0].targets[0])):
            first = model.jnt_qposadr[model.body(name).jntadr[0]]
            data.qpos[first : first + 7] = qpos
        for name in FINGERS:
            model.joint(name).range[1] = data.joint(name).qpos[0] = M_PER_CM * opening_cm

    def go(self, phase: Phase, watch: Watch) -> None:
        """Simulate one phase."""
        data, target = self.data, self.model.body(TARGET).mocapid[0]
        felt = self.wrist.get(phase.name)
        data.ctrl[:] = phase.force_n
        for qpos in phase.targets:
            data.mocap_pos[target], data.mocap_quat[target] = qpos[:3], qpos[3:]
            mujoco.mj_step(self.model, data)
            watch(phase.name, data)
            if felt is not None:
                felt.append(data.sensor("torque").data.copy())
        self.seen[phase.name] = self._look()

    def _look(self) -> tuple[float, Float[np.ndarray, "3 3"]]:
        """Return the height of the centre of mass, cm, and the object's turn in the hand."""
        if not np.isfinite(self.data.qpos).all():
            raise DataError("a simulated pick has a state that is not finite")
        held, hand = (self.data.body(name).xmat.reshape(3, 3) for name in (OBJECT, HAND))
        return float(self.data.body(OBJECT).xipos[2]) / M_PER_CM, hand.T @ held

    def judged(self) -> Trial:
        """Say what became of the object."""
        rules, seen = self.rules.trial, self.seen
        start_cm, closed = seen["descend"][0], seen["close"][1]
        turn = max(turn_between_deg(closed, seen[name][1]) for name in ("hold", "shake"))
        rises = seen["hold"][0] - start_cm, seen["shake"][0] - start_cm
        moment = np.mean(self.wrist["hold"], axis=0) - self.wrist["wait"][-1]
        high = rises[0] > rules.min_rise_held_cm and rises[1] > rules.min_rise_shaken_cm
        outcome: Outcome = "held" if high and turn < rules.max_turn_deg else "slipped"
        if outcome != "held" and rises[1] > rules.min_rise_in_hand_cm:
            outcome = "rotated"
        warnings = sum(int(one.number) for one in self.data.warning)
        return Trial(outcome, float(np.linalg.norm(moment)), turn, warnings)
