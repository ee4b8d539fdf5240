"""Where the meshes of an object stand in the scanner's frame, and how sure that is."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
import trimesh
from jaxtyping import Float, Float64
from scipy.spatial.transform import Rotation

from xden1k.values.arrays import Points, Vec3
from xden_builder.capture import Capture, CapturePart
from xden_builder.poly.model.frames import Pose
from xden_builder.poly.model.poses import Poses

__all__ = ["Found", "Registration", "RigidPlacement"]

EDGES_TELL: Final = 10
"""Power of what neighbouring pixels differ by, beside the squares and twice the doubt."""
AS_IMPROBABLE, AS_MUCH_DIFFERS = 4.0, 1.5
"""A pose is as good that is so many times as improbable once both were refined (of 33 objects that
had one, seven were in the wrong of both; of five between 2 and 4, two), or of which pixels differ
by so many times as much where these tell alone."""
AS_GOOD: Final = 1.15
"""A pose whose loss is this many times the least explains the images as well."""


@dataclass(frozen=True, slots=True, eq=False)
class RigidPlacement:
    """A mesh point x, in cm, stands at scale * (R x) + t in the scanner's frame.

    Parameters
    ----------
    rotation
        Shape (3, 3): R.
    translation_cm
        Shape (3,): t.
    scale
        1 where the meshes have their size.
    """

    rotation: Float64[np.ndarray, "3 3"]
    translation_cm: Float64[np.ndarray, "3"]
    scale: float = 1.0

    def apply(self, points_cm: Points) -> Float64[np.ndarray, "n 3"]:
        """Move points.

        Examples
        --------
        >>> there = RigidPlacement(np.eye(3), np.array([0.0, 0.0, 1.0]), 2.0)
        >>> there.apply(np.array([[1.0, 0.0, 0.0]])).tolist()
        [[2.0, 0.0, 1.0]]
        """
        return np.asarray(self.scale * points_cm @ self.rotation.T + self.translation_cm)

    def moved(self, mesh: trimesh.Trimesh) -> trimesh.Trimesh:
        """Give a mesh whose vertices are moved; its faces stay as they are."""
        return trimesh.Trimesh(self.apply(np.asarray(mesh.vertices)), mesh.faces, process=False)

    def of_parts(self, parts: Iterable[CapturePart]) -> tuple[CapturePart, ...]:
        """Give parts whose meshes are moved."""
        return tuple(replace(part, mesh=self.moved(part.mesh)) for part in parts)

    def of_capture(self, capture: Capture) -> Capture:
        """Give a capture whose parts stand there, about."""
        return replace(capture, parts=self.of_parts(capture.parts), pose="near")

    def enlarged(self, factor: float, centre_cm: Vec3) -> RigidPlacement:
        """Where the mesh stands when the object, once there, grows about a point.

        Examples
        --------
        >>> there = RigidPlacement(np.eye(3), np.zeros(3)).enlarged(2.0, np.array([0.0, 0.0, 1.0]))
        >>> there.apply(np.array([[1.0, 0.0, 3.0]])).tolist()
        [[2.0, 0.0, 5.0]]
        """
        moved = factor * (self.translation_cm - centre_cm) + centre_cm
        return RigidPlacement(self.rotation, moved, factor * self.scale)

    def followed_by(self, pose: Pose) -> RigidPlacement:
        """Where the mesh stands when the object, once there, goes into a pose."""
        turn = Rotation.from_rotvec(pose.rotation_rad).as_matrix()
        centre, shift = np.array(pose.centre_cm), np.array(pose.shift_cm)
        moved = turn @ (self.translation_cm - centre) + centre + shift
        return RigidPlacement(turn @ self.rotation, moved, self.scale)

    def since(self, before: RigidPlacement) -> RigidPlacement:
        """How the object was moved from where its mesh, of the same scale, stood before to here.

        Examples
        --------
        >>> low, high = (RigidPlacement(np.eye(3), np.array([0.0, 0.0, z])) for z in (1.0, 3.0))
        >>> high.since(low).apply(np.array([[5.0, 0.0, 1.0]])).tolist()
        [[5.0, 0.0, 3.0]]
        """
        turn = self.rotation @ before.rotation.T
        return RigidPlacement(turn, self.translation_cm - turn @ before.translation_cm)

    def carried(self, moved: RigidPlacement) -> RigidPlacement:
        """Where the mesh stands once the object was moved: undoes :meth:`since`."""
        shift = moved.apply(self.translation_cm[None])[0]
        return RigidPlacement(moved.rotation @ self.rotation, shift, self.scale)

    def about(self, centre_cm: Vec3) -> Float64[np.ndarray, "6"]:
        """Rotation vector and shift, as of :class:`Pose`, of the same motion about a point."""
        shift = self.apply(centre_cm[None])[0] - centre_cm
        return np.concatenate([Rotation.from_matrix(self.rotation).as_rotvec(), shift])

    def undone(self, points_cm: Points) -> Float64[np.ndarray, "n 3"]:
        """Move points back.

        Examples
        --------
        >>> there = RigidPlacement(np.eye(3), np.array([0.0, 0.0, 1.0]), 2.0)
        >>> there.undone(np.array([[2.0, 0.0, 1.0]])).tolist()
        [[1.0, 0.0, 0.0]]
        """
        return np.asarray((points_cm - self.translation_cm) @ self.rotation / self.scale)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> RigidPlacement:
        """Read what :meth:`to_dict` gives, beside other keys."""
        return cls(
            Rotation.from_quat(values["quaternion_xyzw"]).as_matrix(),
            np.array(values["translation_cm"]),
            values["scale"],
        )

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON, as ``truth.json`` of simulated captures has them."""
        return {
            "quaternion_xyzw": Rotation.from_matrix(self.rotation).as_quat().tolist(),
            "translation_cm": self.translation_cm.tolist(),
            "scale": self.scale,
        }


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """A pose that explains the radiographs more or less well.

    Parameters
    ----------
    placement
        Of the meshes.
    loss
        Mean squared residual of transmission in units of 0.05, large ones tempered; of all views,
        on the images of the search, and of the pose as the search left it.
        Where a part may have no mesh, light that the model has too much of hardly counts.
    density_g_cm3
        Shape (K,): the parts' densities that go with it, coarsely.
    doubt, left
        What it leaves once refined on the images as they are, as of
        :class:`xden_builder.poly.pose.PoseFit`; None where it was not, or a part may have no mesh.
    edges
        The same of neighbouring pixels' differences, and of light that the model lacks; where a
        part may have no mesh and the source is not told, on the images of the search.
    deviance
        Squares that the whole fit leaves in that pose, of samples and of priors, in their standard
        deviations: twice minus the logarithm of the posterior but for norms, and for how likely the
        materials are; None where it was not fitted:
        :func:`xden_builder.registration.contest.told_by_labels`.
    gains
        Of the views, and after them their shares of glare, where the pose has been moved with them.
    growth
        Logarithm of the object's size over that of its meshes, where it was sought along with it;
        0 where their scale is sought, which takes it.
    moves
        How the object was moved in the scanner's frame before the views that it was turned for, by
        their number, where that was found along with its pose. It does not depend on the frame of
        the meshes, so that it may hold for another pose too. The rebuild finds it anew.
    """

    placement: RigidPlacement
    loss: float
    density_g_cm3: Float64[np.ndarray, "k"]
    doubt: float | None = None
    left: float | None = None
    edges: float | None = None
    deviance: float | None = None
    gains: Float64[np.ndarray, "v"] | None = None
    growth: float = 0.0
    moves: Mapping[int, RigidPlacement] = field(default_factory=dict)

    def posed(self, poses: Poses, unknowns: Float64[np.ndarray, "p"]) -> Found:
        """Where the object is when it, once there, goes into the poses of the views.

        That of one before which it was not turned is its own.
        """
        each = [
            self.placement.followed_by(poses.of(number, unknowns))
            for number in range(len(poses.turned))
        ]
        here = each[poses.turned.index(False)]
        pairs = enumerate(zip(poses.turned, each, strict=True))
        moves = {number: there.since(here) for number, (turned, there) in pairs if turned}
        return replace(self, placement=here, moves=moves)

    def before(self, view: int) -> RigidPlacement:
        """Where the mesh stands before a view of a number: elsewhere if it was turned by hand."""
        moved = self.moves.get(view)
        return self.placement if moved is None else self.placement.carried(moved)

    def rescaled(self, centre_cm: Vec3) -> Found:
        """Take the object's size for that of its meshes, enlarged about a point.

        Its densities went with ways through the meshes as they were.
        """
        factor = float(np.exp(self.growth))
        return replace(
            self,
            placement=self.placement.enlarged(factor, centre_cm),
            density_g_cm3=self.density_g_cm3 / factor,
            growth=0.0,
        )

    @property
    def improbability(self) -> float:
        """What poses are sorted by that were refined; infinite where this one was not.

        None of what is left has a known scale. So it is compared by its shares, which multiply.
        What neighbouring pixels differ by tells most: a veil over a panel, which squares and doubt
        take for shade, differs nowhere. Where a part may have no mesh it tells alone: the right
        pose leaves more light than one that spends another part on it.
        """
        if self.edges is None:
            return np.inf
        if self.doubt is None or self.left is None:
            return self.edges
        told = self.edges**EDGES_TELL * self.doubt**2 * self.left
        return told if self.deviance is None else told * self.deviance

    def as_good_as(self, best: Found) -> bool:
        """Whether it explains the images about as well.

        By what is left of them once the best was refined, and by the whole fit once it was fitted:
        a pose that was not, was told from it before. Else by the loss.
        """
        if best.deviance is not None and self.deviance is None:
            return False
        if np.isfinite(best.improbability):
            times = AS_MUCH_DIFFERS if best.doubt is None else AS_IMPROBABLE
            return self.improbability <= times * best.improbability
        return self.loss <= AS_GOOD * best.loss


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """Result of :func:`xden_builder.registration.search.register`.

    Parameters
    ----------
    candidates
        Unlike poses, the best first; unlike are poses in which the object, its parts' attenuation
        included, is somewhere else.
    equal_poses
        How many of the turns by multiples of 15 degrees about the object's principal axes leave it
        where it is, all 69 for a ball, 23 for a bottle, 3 for a box: as many poses are as good.
    chosen
        Index of the candidate that is used: 0, or the one a person chose.
    outline_share
        By view: share of the pixels inside either outline that lie more than two pixels outside
        of the other.
    flags
        ``pose_ambiguous``, ``pose_not_found``, ``mirrored``, ``shape_differs``.
    """

    candidates: tuple[Found, ...]
    equal_poses: int
    chosen: int
    outline_share: dict[str, float]
    flags: tuple[str, ...]

    @property
    def placement(self) -> RigidPlacement:
        """The pose that is used."""
        return self.used.placement

    @property
    def used(self) -> Found:
        """The same, and what was found along with it."""
        return self.candidates[self.chosen]

    def density_spread(self) -> Float[np.ndarray, "k"]:
        """Shape (K,): largest difference, as a share, to the densities of a pose as good as this.

        Zero where the pose is not ambiguous.
        """
        best = self.used.density_g_cm3
        if "pose_ambiguous" not in self.flags:
            return np.zeros(len(best))
        as_good = [each for each in self.candidates if each.as_good_as(self.candidates[0])]
        off = [np.abs(each.density_g_cm3 / best - 1) for each in as_good]
        return np.asarray(np.max([np.zeros(len(best)), *off], axis=0))

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON."""
        return {
            **self.placement.to_dict(),
            "chosen": self.chosen + 1,
            "equal_poses": self.equal_poses,
            "outline_share": self.outline_share,
            "candidates": [
                {
                    **each.placement.to_dict(),
                    "loss": each.loss,
                    "doubt": each.doubt,
                    "left": each.left,
                    "edges": each.edges,
                    "deviance": each.deviance,
                }
                for each in self.candidates
            ],
        }
