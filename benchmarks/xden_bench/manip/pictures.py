"""Frames of a simulated pick, side by side."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import accumulate
from typing import Any, Final

import numpy as np
from jaxtyping import UInt8

from xden1k.errors import DataError
from xden1k.export.si import M_PER_CM
from xden_bench.manip.draws import Draw
from xden_bench.manip.item import Item
from xden_bench.manip.outcome import Outcome
from xden_bench.manip.protocol import ManipProtocol, TrialRules
from xden_bench.manip.scene import OBJECT, gripper_scene, mujoco
from xden_bench.manip.trial import pick

__all__ = ["strip"]

HEIGHT, WIDTH = 240, 240
"""Of a frame, pixels."""
BACKGROUND: Final = (0.95, 0.95, 0.95)
OBJECT_RGBA: Final = (0.85, 0.5, 0.2, 1.0)
DISTANCE_CM: Final = 70.0
ELEVATION_DEG: Final = -12.0

Picture = UInt8[np.ndarray, "rows columns 3"]


def strip(item: Item, candidate: int, draw: Draw, rules: ManipProtocol) -> tuple[Picture, Outcome]:
    """Simulate a pick and draw it at the end of every phase but the first.

    Parameters
    ----------
    item
        The object.
    candidate
        Index of the grasp.
    draw
        The conditions.
    rules
        The protocol.

    Raises
    ------
    DataError
        If nothing can be drawn here: it needs EGL or OSMesa.
    """
    model = _lit(gripper_scene(item.hulls, item.mass, rules))
    times, frames = list(_ends_s(rules.trial)), list[Picture]()
    camera = _camera(item, candidate)
    with _renderer(model) as renderer:

        def watch(_phase: str, data: Any) -> None:
            if len(frames) < len(times) and data.time > times[len(frames)]:
                renderer.update_scene(data, camera)
                frames.append(renderer.render())

        grasp, width_cm = item.grasps.pose(candidate), float(item.grasps.width_cm[candidate])
        trial = pick(model, item.rest, grasp, width_cm, draw, rules, watch)
    return np.concatenate(frames, axis=1), trial.outcome


def _lit(spec: Any) -> Any:
    """Compile a scene with a light background and the object in a colour of its own."""
    spec.add_texture(
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        rgb1=BACKGROUND,
        width=8,
        height=8,
    )
    for geom in spec.body(OBJECT).geoms:
        geom.rgba = OBJECT_RGBA
    model = spec.compile()
    model.vis.headlight.ambient[:], model.vis.headlight.diffuse[:] = 0.4, 0.6
    return model


def _ends_s(rules: TrialRules) -> Iterator[float]:
    """Half a step of the clock before each phase ends, from the descent on."""
    phases = (rules.descend_s, rules.close_s, rules.lift_s, rules.hold_s, rules.shake_s)
    ends = accumulate(phases, initial=rules.wait_s)
    return (end - 0.01 for end in list(ends)[1:])


def _camera(item: Item, candidate: int) -> Any:
    """Look along the closing axis, at what is between the table and the lifted gripper."""
    camera = mujoco.MjvCamera()
    x, y, _ = item.grasps.closing[candidate]
    camera.azimuth, camera.elevation = float(np.degrees(np.arctan2(y, x))), ELEVATION_DEG
    camera.distance = M_PER_CM * DISTANCE_CM
    camera.lookat[:] = M_PER_CM * (item.grasps.centre_cm[candidate] + [0.0, 0.0, 12.0])
    return camera


@contextmanager
def _renderer(model: Any) -> Iterator[Any]:
    try:
        renderer = mujoco.Renderer(model, HEIGHT, WIDTH)
    except (ImportError, AttributeError, RuntimeError, mujoco.FatalError) as err:
        raise DataError(
            "pictures need EGL (libegl1), or OSMesa (libosmesa6) and MUJOCO_GL=osmesa; all else "
            f"works without: {' '.join(str(err).split())}"
        ) from err
    try:
        yield renderer
    finally:
        renderer.close()
