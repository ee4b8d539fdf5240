"""A real arm's model, from the user's own copy: its joints at a pose, and what they bear.

Of the model only joints, masses and inertias count; meshes and everything that touches are dropped,
so they need not be there. Torques are those of rigid bodies, which act on the links: neither the
motors' inertia nor friction, as sensors at the joints have them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float64
from scipy.optimize import least_squares

from xden1k.errors import DataError
from xden1k.export.si import M_PER_CM, Inertial
from xden1k.format.checksums import file_sha256
from xden1k.values.mass import MassProperties
from xden_bench.manip.arm_protocol import ArmProtocol
from xden_bench.manip.closed_forms import GRAVITY_M_S2
from xden_bench.manip.pose import Pose, turn_between_deg
from xden_bench.manip.scene import OBJECT, add_massive_body, mujoco

__all__ = ["JOINTS", "MODEL", "Arm", "Joints", "load_arm"]

MODEL: Final = "franka_emika_panda/panda.xml"
"""Place of the model in a checkout of mujoco_menagerie: the arm of the paper, with its hand."""
JOINTS: Final = tuple(f"joint{number}" for number in range(1, 8))
FINGER_JOINTS: Final = ("finger_joint1", "finger_joint2")
HAND: Final = "hand"
HOME: Final = "home"
UNFELT: Final = ("geoms", "meshes", "materials", "textures", "skins")
"""What is dropped of a model."""

Joints = Float64[np.ndarray, "7"]
"""A number of each joint, from the base to the hand: rad, rad/s, rad/s² or N·m."""


class Arm:
    """An arm, with nothing or with an object in its hand.

    Parameters
    ----------
    model
        Compiled; its base is at the origin and stands on the table.
    rules
        Of the joints that it takes.
    """

    def __init__(self, model: Any, rules: ArmProtocol) -> None:
        self.model, self.rules = model, rules
        self._data = mujoco.MjData(model)  # made once: that takes longer than all that is asked
        self._positions = [int(model.joint(name).qposadr[0]) for name in JOINTS]
        self._freedoms = [int(model.joint(name).dofadr[0]) for name in JOINTS]
        self.home: Joints = model.key(HOME).qpos[self._positions]
        self.ranges: Float64[np.ndarray, "2 7"] = np.array(
            [model.joint(name).range for name in JOINTS]
        ).T

    def tool(self, joints: Joints) -> Pose:
        """Pose of the tool frame before the base."""
        self._take(joints)
        hand = self._data.body(HAND)
        rotation = hand.xmat.reshape(3, 3).copy()
        tip_cm = hand.xpos / M_PER_CM + self.rules.place.tool_cm * rotation[:, 2]
        return Pose(rotation, tip_cm)

    def _take(self, joints: Joints) -> None:
        self._data.qpos[self._positions] = joints
        mujoco.mj_kinematics(self.model, self._data)
        mujoco.mj_comPos(self.model, self._data)

    def reached(self, wanted: Pose, near: Joints) -> Joints | None:
        """Joints within their ranges that bring the tool frame to a pose, as near home as may be.

        Parameters
        ----------
        wanted
            Of the tool frame, before the base.
        near
            Joints from which they are looked for.

        Returns
        -------
        Joints or None
            None where there are none.
        """
        rules = self.rules.joints
        found = least_squares(
            partial(self._errors, wanted),
            np.clip(near, *self.ranges),
            jac=self._slopes,
            bounds=self.ranges,
            method="dogbox",
        )
        joints: Joints = found.x
        tool = self.tool(joints)
        apart_cm = float(np.linalg.norm(tool.origin_cm - wanted.origin_cm))
        turned_deg = turn_between_deg(tool.rotation, wanted.rotation)
        is_there = apart_cm <= rules.max_error_cm and turned_deg <= rules.max_error_deg
        return joints if is_there else None

    def _errors(self, wanted: Pose, joints: Joints) -> Float64[np.ndarray, "19"]:
        """Shift in m, difference of the axes, and the pull home."""
        tool = self.tool(joints)
        shift = M_PER_CM * (tool.origin_cm - wanted.origin_cm)
        axes = (tool.rotation - wanted.rotation).T.ravel()
        return np.concatenate([shift, axes, self.rules.joints.home_pull * (joints - self.home)])

    def _slopes(self, joints: Joints) -> Float64[np.ndarray, "19 7"]:
        """Return the derivatives of the errors."""
        tool, hand = self.tool(joints), self.model.body(HAND).id
        moves, turns = np.zeros((2, 3, self.model.nv))
        mujoco.mj_jac(self.model, self._data, moves, turns, M_PER_CM * tool.origin_cm, hand)
        turns = turns[:, self._freedoms]
        axes = [np.cross(turns.T, axis).T for axis in tool.rotation.T]
        pull = self.rules.joints.home_pull * np.eye(len(JOINTS))
        return np.concatenate([moves[:, self._freedoms], *axes, pull])

    def torques_nm(self, joints: Joints, speeds: Joints, accelerations: Joints) -> Joints:
        """Torques that make the joints move so, against gravity: recursive Newton and Euler.

        Parameters
        ----------
        joints, speeds, accelerations
            rad, rad/s, rad/s².
        """
        self._take(joints)
        self._data.qvel[self._freedoms] = speeds
        self._data.qacc[self._freedoms] = accelerations
        mujoco.mj_comVel(self.model, self._data)
        torques = np.zeros(self.model.nv)
        mujoco.mj_rne(self.model, self._data, 1, torques)
        found: Joints = torques[self._freedoms]
        return found


@dataclass(frozen=True, slots=True)
class ArmModel:
    """An arm's model as it was read, to be given objects to hold.

    Parameters
    ----------
    spec
        Without what is not felt.
    path, sha256
        Of its file.
    rules
        Of the joints that it takes.
    """

    spec: Any
    path: Path
    sha256: str
    rules: ArmProtocol

    def empty(self) -> Arm:
        """Return the arm with nothing in its hand.

        Raises
        ------
        DataError
            If MuJoCo cannot make it.
        """
        return self._compiled(self.spec)

    def holding(self, mass: MassProperties, held: Pose) -> Arm:
        """Return the arm with an object in its hand, as one rigid body.

        Parameters
        ----------
        mass
            Of the object.
        held
            Of the object's frame in the tool frame.
        """
        spec = self.spec.copy()
        in_hand = Pose(np.eye(3), np.array([0.0, 0.0, self.rules.place.tool_cm])).of(held)
        body = add_massive_body(spec.body(HAND), OBJECT, Inertial.of(mass))
        body.pos, body.quat = in_hand.qpos[:3], in_hand.qpos[3:]
        return self._compiled(spec)

    def _compiled(self, spec: Any) -> Arm:
        try:
            return Arm(spec.compile(), self.rules)
        except ValueError as err:
            raise DataError(f"{self.path}: MuJoCo cannot make the arm: {_line(err)}") from err


def load_arm(menagerie: Path, rules: ArmProtocol) -> ArmModel:
    """Read the arm from a checkout of mujoco_menagerie.

    Parameters
    ----------
    menagerie
        The checkout's folder; nothing is downloaded.
    rules
        Of the joints that it takes.

    Raises
    ------
    DataError
        If the model is not there, is no MJCF, or is another robot.
    """
    path = menagerie / MODEL
    if not path.is_file():
        raise DataError(
            f"{path}: not found; expected a checkout of mujoco_menagerie with {MODEL} in it"
        )
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except ValueError as err:
        raise DataError(f"{path}: expected an MJCF model: {_line(err)}") from err
    _refuse_other_robot(path, spec)
    for kind in UNFELT:
        for one in list(getattr(spec, kind)):
            spec.delete(one)
    spec.option.gravity = [0, 0, -GRAVITY_M_S2]
    return ArmModel(spec, path, file_sha256(path), rules)


def _refuse_other_robot(path: Path, spec: Any) -> None:
    joints = tuple(one.name for one in spec.joints)
    expected = (*JOINTS, *FINGER_JOINTS)
    if joints != expected:
        raise DataError(
            f"{path}: another robot: expected the joints {', '.join(expected)}, "
            f"got {', '.join(joints) or 'none'}"
        )
    for kind, found, name in (
        ("body", spec.body(HAND), HAND),
        ("keyframe", next((one for one in spec.keys if one.name == HOME), None), HOME),
    ):
        if found is None:
            raise DataError(f"{path}: another robot: expected the {kind} {name!r}")
    for joint in spec.joints:
        if not joint.range[0] < joint.range[1]:
            raise DataError(f"{path}: expected the range of the joint {joint.name!r}")
    for body in spec.bodies:
        if len(body.geoms) and not body.explicitinertial:
            raise DataError(f"{path}: expected an inertial of the body {body.name!r}")


def _line(err: ValueError) -> str:
    return str(err).partition("\n")[0]
