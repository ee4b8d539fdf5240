"""Scenes for MuJoCo: an object on a table, and a floating gripper made of boxes.

Here lengths become m and masses kg, by :mod:`xden1k.export.si`. The object is one free body with
its exact inertial; its hulls are for contact and weigh nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import trimesh

from xden1k.errors import require
from xden1k.export.si import KG_PER_G, M_PER_CM, Inertial
from xden1k.values.mass import MassProperties
from xden_bench.manip.closed_forms import GRAVITY_M_S2
from xden_bench.manip.protocol import GripperRules, ManipProtocol, SolverRules

mujoco: Any = require("mujoco", "sim")

__all__ = [
    "FINGERS",
    "HAND",
    "OBJECT",
    "TARGET",
    "WRIST",
    "add_massive_body",
    "gripper_scene",
    "table_scene",
]

OBJECT: Final = "object"
HAND: Final = "hand"
TARGET: Final = "target"
WRIST: Final = "wrist"
FINGERS: Final = {"left": 1.0, "right": -1.0}
"""Names of the fingers, and on which side of the closing axis each is."""
UNTURNED: Final = [1.0, 0.0, 0.0, 0.0]
"""Quaternion of no turn."""


def table_scene(hulls: Sequence[trimesh.Trimesh], mass: MassProperties, rules: SolverRules) -> Any:
    """Specify an object above a table, whose top is at z = 0.

    Parameters
    ----------
    hulls
        Convex, cm, in the object's frame.
    mass
        Of the object, about its frame.
    rules
        Of contact.

    Returns
    -------
    mujoco.MjSpec
        To be compiled, or added to.
    """
    spec = mujoco.MjSpec()
    option = spec.option
    option.timestep, option.gravity = rules.timestep_s, [0, 0, -GRAVITY_M_S2]
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone, option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, rules.impratio
    option.noslip_iterations = rules.noslip_iterations
    spec.worldbody.add_geom(
        name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[2, 2, 0.1], **_contact(rules)
    )
    _add_object(spec, hulls, Inertial.of(mass), rules)
    return spec


def gripper_scene(
    hulls: Sequence[trimesh.Trimesh], mass: MassProperties, rules: ManipProtocol
) -> Any:
    """Specify an object on a table, and a gripper that goes where its target goes.

    Gravity does not move the gripper, but its weight is felt at the wrist, which must be tared.
    """
    spec = table_scene(hulls, mass, rules.solver)
    gripper = rules.gripper
    spec.worldbody.add_body(name=TARGET, mocap=True)
    hand = spec.worldbody.add_body(name=HAND, gravcomp=1)
    hand.add_freejoint(name=HAND)
    _weigh(hand, gripper.base_mass_g)
    # A sensor in the free body itself would read nothing: it is between a body and its parent.
    wrist = hand.add_body(name=WRIST, gravcomp=1, pos=[0, 0, _wrist_m(gripper)])
    wrist.add_site(name=WRIST)
    _add_palm(wrist, gripper)
    for name, side in FINGERS.items():
        _add_finger(spec, wrist, name, side, gripper)
    _tie(spec, gripper)
    for kind in ("FORCE", "TORQUE"):
        spec.add_sensor(
            name=kind.lower(),
            type=getattr(mujoco.mjtSensor, f"mjSENS_{kind}"),
            objtype=mujoco.mjtObj.mjOBJ_SITE,
            objname=WRIST,
        )
    return spec


def _contact(rules: SolverRules) -> dict[str, Any]:
    friction = [rules.table_friction, rules.torsional_friction_m, rules.rolling_friction_m]
    solimp = [*rules.solimp, 0.5, 2]  # the last two are MuJoCo's defaults
    return {"condim": 4, "friction": friction, "solref": rules.solref, "solimp": solimp}


def _add_object(
    spec: Any, hulls: Sequence[trimesh.Trimesh], inertial: Inertial, rules: SolverRules
) -> None:
    body = add_massive_body(spec.worldbody, OBJECT, inertial)
    body.add_freejoint()
    for number, hull in enumerate(hulls):
        name = f"hull{number}"
        spec.add_mesh(
            name=name,
            uservert=(M_PER_CM * np.asarray(hull.vertices)).ravel(),
            userface=np.asarray(hull.faces).ravel(),
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,  # thin ones have no volume
        )
        # its friction counts, not that of what it touches
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, mass=0, priority=2, **_contact(rules)
        )


def add_massive_body(parent: Any, name: str, inertial: Inertial) -> Any:
    """Add a body of exact mass properties, and no shape, to another."""
    body = parent.add_body(name=name, explicitinertial=True)
    body.mass, body.ipos = inertial.mass_kg, inertial.com_m
    tensor = inertial.inertia_kg_m2
    body.fullinertia = [tensor[at] for at in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    return body


def _weigh(body: Any, mass_g: float) -> None:
    """Give a body the mass of a small ball, and no shape."""
    body.explicitinertial, body.mass, body.ipos = True, KG_PER_G * mass_g, np.zeros(3)
    body.inertia = np.full(3, 0.4 * KG_PER_G * mass_g * 0.03**2)


def _wrist_m(gripper: GripperRules) -> float:
    """Where the palm's back is, along the approach."""
    return M_PER_CM * (gripper.palm_front_cm - gripper.palm_cm[2])


def _add_palm(wrist: Any, gripper: GripperRules) -> None:
    half_m = M_PER_CM * np.array(gripper.palm_cm) / 2
    wrist.add_geom(
        name="palm",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=half_m,
        pos=[0, 0, half_m[2]],
        mass=KG_PER_G * gripper.palm_mass_g,
    )


def _add_finger(spec: Any, wrist: Any, name: str, side: float, gripper: GripperRules) -> None:
    """Add a finger that slides along the closing axis; at 0 its pad is in the middle."""
    half_m = M_PER_CM * np.array(gripper.finger_cm) / 2
    centre_m = M_PER_CM * (gripper.finger_reach_cm - gripper.finger_cm[2] / 2) - _wrist_m(gripper)
    finger = wrist.add_body(name=name, gravcomp=1, pos=[0, side * half_m[1], centre_m])
    finger.add_joint(
        name=name,
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=[0, side, 0],
        limited=True,
        range=[0, M_PER_CM * gripper.max_opening_cm / 2],
        armature=gripper.armature_kg,
        damping=gripper.damping_n_s_m,
    )
    finger.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=half_m,
        mass=KG_PER_G * gripper.finger_mass_g,
        condim=4,
    )
    spec.add_exclude(bodyname1=WRIST, bodyname2=name)
    motor = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    motor.gear[0] = -1  # a positive force closes


def _tie(spec: Any, gripper: GripperRules) -> None:
    """Tie the fingers to each other, and the hand to its target."""
    left, right = FINGERS
    mimic = spec.add_equality(
        type=mujoco.mjtEq.mjEQ_JOINT,
        name1=left,
        name2=right,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        solref=gripper.mimic_solref,
    )
    mimic.data[:5] = [0, 1, 0, 0, 0]
    spec.add_exclude(bodyname1=left, bodyname2=right)
    weld = spec.add_equality(
        type=mujoco.mjtEq.mjEQ_WELD,
        name1=TARGET,
        name2=HAND,
        objtype=mujoco.mjtObj.mjOBJ_BODY,
        solref=gripper.weld_solref,
    )
    weld.data[:11] = [0, 0, 0, 0, 0, 0, *UNTURNED, 1]
