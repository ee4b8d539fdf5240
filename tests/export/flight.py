"""Rigid bodies that fall and spin freely: closed forms, and what MuJoCo makes of an export."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
from scipy.special import ellipj

from xden1k.export.si import Inertial

GRAVITY = 9.81
STEP_S = 5e-4
RATE = np.array([1.0, 0.0, 6.0])
"""Angular velocity at the start, rad/s, along the first and the last axis of :func:`frame`."""


def frame(inertial: Inertial) -> tuple[np.ndarray, np.ndarray]:
    """Moments and right-handed axes; the last axis is the one whose moment stands apart."""
    moments, axes = inertial.principal()
    if moments[1] - moments[0] > moments[2] - moments[1]:
        return moments[::-1], axes[:, ::-1] * [1, -1, 1]
    return moments, axes


def spin(moments: np.ndarray, start: np.ndarray, time_s: float) -> np.ndarray:
    """Angular velocity along the principal axes (Landau and Lifshitz, Mechanics, section 37)."""
    (a, b, c), (p, _, r) = moments, start
    twice_energy, squared = a * p**2 + c * r**2, (a * p) ** 2 + (c * r) ** 2
    beyond = (squared - twice_energy * a) * (1 if c > a else -1)
    within = (twice_energy * c - squared) * (1 if c > a else -1)
    rate = np.sqrt(abs(c - b) * beyond / (a * b * c))
    parameter = abs(b - a) * within / (abs(c - b) * beyond)
    sn, cn, dn, _ = ellipj(time_s * rate, parameter)
    across = np.sqrt(within / (b * abs(c - b)))
    sign = 1 if c > a else -1
    return np.array([p * cn, sign * across * sn, r * dn])


def fly(path: Path, inertial: Inertial, time_s: float) -> tuple[float, float]:
    """Drop and spin an MJCF export; deviations of centre (m) and spin (relative) at the end."""
    spec = mujoco.MjSpec.from_file(str(path))
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.timestep, spec.option.gravity = STEP_S, [0, 0, -GRAVITY]
    model = spec.compile()
    data = mujoco.MjData(model)
    moments, axes = frame(inertial)
    data.qvel[3:] = axes @ RATE
    data.qvel[:3] = -np.cross(data.qvel[3:], inertial.com_m)  # the centre is at rest
    for _ in range(round(time_s / STEP_S)):
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    fallen = inertial.com_m - [0, 0, 0.5 * GRAVITY * time_s**2]
    wanted = axes @ spin(moments, RATE, time_s)
    return (
        float(np.linalg.norm(data.xipos[1] - fallen)),
        float(np.linalg.norm(data.qvel[3:] - wanted) / np.linalg.norm(RATE)),
    )
