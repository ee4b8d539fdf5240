"""Which grasps the open gripper can take without touching the object elsewhere, or the table."""

from __future__ import annotations

from itertools import product

import numpy as np
from jaxtyping import Bool, Float

from xden1k.values.arrays import Points
from xden_bench.manip.grasps import Grasps
from xden_bench.manip.protocol import GraspRules, GripperRules

__all__ = ["above_table", "clear_of_object"]

CHUNK = 64
"""Grasps looked at together."""

Boxes = Float[np.ndarray, "grasps boxes 2 3"]


def above_table(
    grasps: Grasps, rules: GraspRules, gripper: GripperRules
) -> Bool[np.ndarray, "grasps"]:
    """Tell whether every corner of fingers and palm is well above the table, z = 0.

    Parameters
    ----------
    grasps
        In the world.
    rules, gripper
        How wide it is open, how large it is, how far above.
    """
    boxes = _boxes_cm(grasps, rules, gripper)
    picks = np.array(list(product((0, 1), repeat=3)))
    corners = boxes[:, :, picks, np.arange(3)]  # (grasps, boxes, corners, 3)
    heights = np.einsum("gbci,gi->gbc", corners, grasps.rotation[:, 2])
    lowest_cm = heights.min(axis=(1, 2)) + grasps.centre_cm[:, 2]
    return np.asarray(lowest_cm >= rules.table_clearance_cm)


def clear_of_object(
    grasps: Grasps, surface_points_cm: Points, rules: GraspRules, gripper: GripperRules
) -> Bool[np.ndarray, "grasps"]:
    """Tell whether fingers and palm are clear of a surface, and enough of it is between the pads.

    Parameters
    ----------
    grasps
        In the frame of the points.
    surface_points_cm
        Evenly spread over the surface.
    rules, gripper
        As in :func:`above_table`.
    """
    clear: Bool[np.ndarray, "grasps"] = np.zeros(len(grasps), dtype=bool)
    boxes, between = _boxes_cm(grasps, rules, gripper), _between_cm(grasps, gripper)
    for first in range(0, len(grasps), CHUNK):
        part = slice(first, first + CHUNK)
        local = (surface_points_cm - grasps.centre_cm[part, None]) @ grasps.rotation[part]
        touched = [_inside(local, boxes[part, box]).any(axis=1) for box in range(boxes.shape[1])]
        enough = _inside(local, between[part]).sum(axis=1) >= rules.min_points_between
        clear[part] = enough & ~np.any(touched, axis=0)
    return clear


def _inside(
    points_cm: Float[np.ndarray, "grasps points 3"], box_cm: Float[np.ndarray, "grasps 2 3"]
) -> Bool[np.ndarray, "grasps points"]:
    above, below = points_cm > box_cm[:, None, 0], points_cm < box_cm[:, None, 1]
    return np.asarray((above & below).all(axis=-1))


def _boxes_cm(grasps: Grasps, rules: GraspRules, gripper: GripperRules) -> Boxes:
    """Lowest and highest corner of both open fingers and of the palm, in the tool frame."""
    pad_cm = grasps.width_cm / 2 + rules.clearance_cm
    half, thick, reach = gripper.finger_cm[0] / 2, gripper.finger_cm[1], gripper.finger_reach_cm
    front = gripper.palm_front_cm
    boxes = np.zeros((len(grasps), 3, 2, 3))
    boxes[:, :2, 0, 0], boxes[:, :2, 1, 0] = -half, half
    boxes[:, :2, 0, 2], boxes[:, :2, 1, 2] = front, reach
    boxes[:, 0, :, 1] = np.stack([pad_cm, pad_cm + thick], axis=1)
    boxes[:, 1, :, 1] = np.stack([-pad_cm - thick, -pad_cm], axis=1)
    palm = np.array(gripper.palm_cm)
    boxes[:, 2] = [[-palm[0] / 2, -palm[1] / 2, front - palm[2]], [palm[0] / 2, palm[1] / 2, front]]
    return boxes


def _between_cm(grasps: Grasps, gripper: GripperRules) -> Float[np.ndarray, "grasps 2 3"]:
    """Lowest and highest corner of the space between the pads."""
    half, front, reach = gripper.finger_cm[0] / 2, gripper.palm_front_cm, gripper.finger_reach_cm
    low = [np.full(len(grasps), -half), -grasps.width_cm / 2, np.full(len(grasps), front)]
    high = [np.full(len(grasps), half), grasps.width_cm / 2, np.full(len(grasps), reach)]
    return np.stack([np.stack(low, axis=1), np.stack(high, axis=1)], axis=1)
