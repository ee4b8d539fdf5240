"""An object that stands on a table in simulation: tilted, laid at an edge, pushed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import acos, atan2, cos, degrees, radians, sin
from typing import Any, Final

import numpy as np
import trimesh

from xden1k.export.si import M_PER_CM
from xden1k.values.arrays import Vec3
from xden1k.values.mass import MassProperties
from xden_bench.manip.closed_forms import GRAVITY_M_S2
from xden_bench.manip.mechanics_protocol import (
    EdgeRules,
    MechanicsProtocol,
    PushRules,
    TiltRules,
)
from xden_bench.manip.pose import Pose
from xden_bench.manip.protocol import SolverRules
from xden_bench.manip.scene import OBJECT, mujoco, table_scene
from xden_bench.manip.support import Plane, Support, support_of

__all__ = ["Standing", "standing_of", "stays_at_edge", "stays_pushed", "tipping_tilt_deg"]

TABLE_M: Final = 2.0
"""Half the side of a table that has an edge."""


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """An object at rest on the table z = 0.

    Parameters
    ----------
    hulls
        Convex, cm, in the object's frame.
    mass
        Of the object.
    rest
        Its pose.
    support
        On what it stands.
    rules
        Of contact.
    """

    hulls: tuple[trimesh.Trimesh, ...]
    mass: MassProperties
    rest: Pose
    support: Support
    rules: SolverRules

    @property
    def com_cm(self) -> Vec3:
        """Centre of mass in the world."""
        (com_cm,) = self.rest.to_world(self.mass.com_cm[None])
        return np.asarray(com_cm)

    @property
    def height_cm(self) -> float:
        """Of its highest corner above the table."""
        return max(
            float(self.rest.to_world(np.asarray(hull.vertices))[:, 2].max()) for hull in self.hulls
        )

    def spec(self) -> Any:
        """Return a scene of it, to be changed or compiled."""
        return table_scene(self.hulls, self.mass, self.rules)


def standing_of(
    hulls: Sequence[trimesh.Trimesh],
    mass: MassProperties,
    rest: Pose,
    contact: SolverRules,
    rules: MechanicsProtocol,
) -> Standing | None:
    """Return an object that stands; None for one that rolls, by the protocol."""
    support = support_of(hulls, rest, rules.support.max_height_cm)
    if support is None:
        return None
    found = Standing(tuple(hulls), mass, rest, support, contact)
    stands = support.margin_cm(found.com_cm[:2]) >= rules.support.min_margin_cm
    return found if stands else None


def tipping_tilt_deg(standing: Standing, rules: TiltRules) -> float:
    """Tilt of gravity towards the nearest edge from which the object tips, by bisection.

    Parameters
    ----------
    standing
        The object.
    rules
        Between which angles, how often halved, how long watched.
    """
    model = _with_friction(standing.spec().compile(), rules.friction)
    towards = standing.support.nearest_normal(standing.com_cm[:2])
    low_deg, high_deg = 0.0, rules.max_angle_deg
    for _ in range(rules.halvings):
        middle_deg = (low_deg + high_deg) / 2
        angle = radians(middle_deg)
        model.opt.gravity[:] = [*(sin(angle) * towards), -cos(angle)]
        model.opt.gravity *= GRAVITY_M_S2
        if _stays(model, mujoco.MjData(model), standing.rest, rules.time_s, rules.max_turn_deg):
            low_deg = middle_deg
        else:
            high_deg = middle_deg
    return (low_deg + high_deg) / 2


def stays_at_edge(standing: Standing, normal: Plane, edge_cm: float, rules: EdgeRules) -> bool:
    """Whether the object stays on a table that ends at a line.

    Parameters
    ----------
    standing
        The object.
    normal
        Unit vector that leads off the table.
    edge_cm
        Where the line is along it.
    rules
        How long it is watched.
    """
    spec = standing.spec()
    table = spec.geom("table")
    table.type, table.size = mujoco.mjtGeom.mjGEOM_BOX, [TABLE_M, TABLE_M, 0.1]
    table.pos = [*((M_PER_CM * edge_cm - TABLE_M) * normal), -0.1]
    half_turn = atan2(normal[1], normal[0]) / 2
    table.quat = [cos(half_turn), 0, 0, sin(half_turn)]
    model = spec.compile()
    return _stays(model, mujoco.MjData(model), standing.rest, rules.time_s, rules.max_turn_deg)


def stays_pushed(
    standing: Standing,
    force_n: Plane,
    height_cm: float,
    friction: float,
    rules: PushRules,
) -> bool:
    """Whether the object does not tip under a horizontal force in the plane of its centre.

    Parameters
    ----------
    standing
        The object.
    force_n
        The force.
    height_cm
        Above the table, at which it pushes.
    friction
        Of the table.
    rules
        How long, in which steps, on how soft a contact.
    """
    contact = replace(standing.rules, timestep_s=rules.timestep_s, solref=rules.solref)
    model = _with_friction(replace(standing, rules=contact).spec().compile(), friction)
    data = mujoco.MjData(model)
    arm_m = M_PER_CM * np.array([0.0, 0.0, height_cm - standing.com_cm[2]])
    force = np.array([*force_n, 0.0])
    data.body(OBJECT).xfrc_applied[:] = [*force, *np.cross(arm_m, force)]
    return _stays(model, data, standing.rest, rules.time_s, rules.max_turn_deg)


def _with_friction(model: Any, friction: float) -> Any:
    """Set the object's friction, which counts and not the table's."""
    body = model.body(OBJECT)
    model.geom_friction[body.geomadr[0] : body.geomadr[0] + body.geomnum[0], 0] = friction
    return model


def _stays(model: Any, data: Any, rest: Pose, time_s: float, max_turn_deg: float) -> bool:
    """Whether an object stands as it stood, as long as it is watched."""
    data.qpos[:7] = rest.qpos
    up = rest.rotation[2]  # the world's up in the object's frame
    for _ in range(round(time_s / model.opt.timestep)):
        mujoco.mj_step(model, data)
        leaning = float(data.body(OBJECT).xmat[6:] @ up)
        if degrees(acos(min(leaning, 1.0))) > max_turn_deg:
            return False
    return True
