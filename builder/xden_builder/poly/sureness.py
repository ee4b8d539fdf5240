"""How sure a pose is, by what it moves: turns and shifts that move surfaces across themselves.

A pen's turn about its length is hardly known, and moves nothing; it does not count.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import trimesh
from jaxtyping import Float64
from scipy.linalg import eigh

from xden1k.values.arrays import Points

__all__ = ["Sureness", "felt_ways", "how_sure", "moves_across", "moves_at_all"]

FELT: Final = 0.01
"""Of how far points move, squared, the share across the surface below which nothing is said to
move: a bottle with 48 facets that turns about its axis has 0.001, a mug with a handle 0.05."""
PROBES: Final = 500
"""Spread over the surface of each part."""
RIM_DEG: Final = 0.06
SHIFT_CM: Final = 0.0125
"""Larger standard deviations are said. One pose in twenty is off by more than about five of them in
turn and four in shift, being in another trough: 0.3 degrees, and half a millimetre."""


class Sureness(NamedTuple):
    """Standard deviations of a pose.

    Parameters
    ----------
    rim_deg
        How far turns move the point that they move farthest, over how far the farthest is from the
        object's middle.
    shift_cm
        Of that middle.
    """

    rim_deg: float
    shift_cm: float

    @property
    def uncertain(self) -> bool:
        """Whether the object may be turned by 0.3 degrees at its rim, or half a millimetre off."""
        return self.rim_deg > RIM_DEG or self.shift_cm > SHIFT_CM


def how_sure(
    meshes: Sequence[trimesh.Trimesh],
    centre_cm: Float64[np.ndarray, "3"],
    covariance: Float64[np.ndarray, "7 7"],
) -> Sureness:
    """Tell how far off a pose may be, ways that move no surface across itself left out.

    Parameters
    ----------
    meshes
        The parts, in the pose.
    centre_cm
        Point about which the pose turns and grows.
    covariance
        Of its rotation vector (radians), shift (cm) and the logarithm of the size.
    """
    sampled = [trimesh.sample.sample_surface(mesh, PROBES, seed=1) for mesh in meshes]
    points_cm = np.concatenate([np.asarray(points) for points, _ in sampled])
    normals = np.concatenate(
        [mesh.face_normals[faces] for mesh, (_, faces) in zip(meshes, sampled, strict=True)]
    )
    middle_cm = points_cm.mean(axis=0)
    rim_cm = float(np.linalg.norm(points_cm - middle_cm, axis=1).max())
    arm = (points_cm - middle_cm) / rim_cm
    across, moved = moves_across(arm, normals), moves_at_all(arm)
    ways, _ = felt_ways(across.T @ across, moved)
    kept = ways @ ways.T @ moved @ _about(middle_cm - centre_cm, rim_cm)
    sure = kept @ covariance @ kept.T
    by_turn = np.cross(np.eye(3)[:, None], arm)
    turned = np.einsum("anx,ab,bnx->n", by_turn, sure[:3, :3], by_turn).max()
    squares = np.array([turned, np.trace(sure[3:6, 3:6])])
    rim, shift = np.sqrt(squares.clip(min=0)).tolist()  # rounding may leave less than none
    return Sureness(float(np.degrees(rim)), rim_cm * shift)


def _about(arm_cm: Float64[np.ndarray, "3"], rim_cm: float) -> Float64[np.ndarray, "7 7"]:
    """Turn moves about one point into those about another, shifts over the rim's radius."""
    there = np.eye(7)
    there[3:6, 3:6] /= rim_cm
    there[3:6, :3] = np.cross(np.eye(3), arm_cm).T / rim_cm
    there[3:6, 6] = arm_cm / rim_cm
    return there


def moves_across(arm: Points, normals: Points) -> Float64[np.ndarray, "n 7"]:
    """How far points move along normals by a turn, a shift and a growth of 1.

    Parameters
    ----------
    arm
        Shape (n, 3): from the middle to the points, over the rim's radius.
    normals
        Shape (n, 3): of the surface there.
    """
    along = np.einsum("ni,ni->n", arm, normals)
    return np.column_stack([np.cross(arm, normals), normals, along])


def moves_at_all(arm: Points) -> Float64[np.ndarray, "7 7"]:
    """Squares by which a turn, a shift and a growth move points, all points together."""
    of_turns = np.cross(np.eye(3)[:, None], arm)
    of_shifts = np.broadcast_to(np.eye(3)[:, None], (3, *arm.shape))
    ways = np.concatenate([of_turns, of_shifts, arm[None]])
    return np.asarray(np.einsum("anx,bnx->ab", ways, ways))


def felt_ways(
    across: Float64[np.ndarray, "7 7"], moved: Float64[np.ndarray, "7 7"]
) -> tuple[Float64[np.ndarray, "7 _m"], Float64[np.ndarray, "_m"]]:
    """Give the moves that take points across surfaces, and by what share of their squares.

    Parameters
    ----------
    across
        Squares by which points move along the normals, all points together.
    moved
        By :func:`moves_at_all`.
    """
    felt, ways = eigh(across, moved)
    return ways[:, felt > FELT], felt[felt > FELT]
