"""Everything the page shows of one object: its views before and after, and every candidate."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from xden1k.values.views import XRayView
from xden_builder.capture import Capture
from xden_builder.capture.saturation import completed
from xden_builder.pipeline.align.pictures import FOUND, TOLD, Sheet, window_around
from xden_builder.registration.placement import Found, Registration, RigidPlacement
from xden_builder.registration.shadow import Shadow, shadow_of
from xden_builder.triage.flags import FlagKind, flag_kind
from xden_builder.triage.pictures import Picture

__all__ = ["AlignCard", "CandidateCard", "make_align_card", "pose_text"]

VIEW_PX: Final = 300
"""Longest side of the pictures of the pose that is used."""
CANDIDATE_PX: Final = 130
DISAGREEING: Final = frozenset({"mirrored", "pose_not_found", "shape_differs"})
"""With these flags it is drawn where shadow and silhouette disagree."""
DIFFERING: Final = 0.1
"""Logarithm of densities that are told of two poses."""

Meshes = Sequence[trimesh.Trimesh]


@dataclass(frozen=True, slots=True)
class AlignedView:
    """One view.

    Parameters
    ----------
    name
        The view's.
    outline_share
        Of the pixels inside shadow or silhouette: those well outside the other.
    before, after
        The radiograph with the silhouette of the meshes as their files have them, and as they were
        found; None where that is not in sight.
    differs
        Where shadow and silhouette disagree; None where they agree.
    """

    name: str
    outline_share: float
    before: Picture | None
    after: Picture | None
    differs: Picture | None


@dataclass(frozen=True, slots=True)
class CandidateCard:
    """One pose that was found.

    Parameters
    ----------
    number
        From 1, the best first.
    loss, doubt, left, edges, deviance
        As of :class:`xden_builder.registration.placement.Found`.
    turned_deg
        Angle between it and the pose that is used.
    scale
        Of the meshes.
    pose
        As ``objects.csv`` takes it.
    pictures
        By view; None where the silhouette is not in sight.
    densities_g_cm3
        By part, where the whole fit found another one in another of the candidates.
    """

    number: int
    loss: float
    doubt: float | None
    left: float | None
    edges: float | None
    deviance: float | None
    turned_deg: float
    scale: float
    pose: str
    pictures: tuple[tuple[str, Picture | None], ...]
    densities_g_cm3: tuple[tuple[str, float], ...]


@dataclass(frozen=True, slots=True)
class AlignCard:
    """One object, small enough to be sent between processes.

    Parameters
    ----------
    object_id, category
        Which, and what it is.
    flags
        Of its registration.
    equal_poses
        How many poses are like the one that is used.
    chosen
        Number of the candidate that is used.
    candidates
        Unlike poses.
    views
        Those that are fitted.
    """

    object_id: str
    category: str
    flags: tuple[str, ...]
    equal_poses: int
    chosen: int
    candidates: tuple[CandidateCard, ...]
    views: tuple[AlignedView, ...]

    @property
    def used(self) -> CandidateCard:
        """The candidate that is used."""
        return self.candidates[self.chosen - 1]

    @property
    def runner_up(self) -> CandidateCard | None:
        """The best of the others."""
        return next((each for each in self.candidates if each.number != self.chosen), None)

    @property
    def remarks(self) -> tuple[FlagKind, ...]:
        """What the flags say."""
        return tuple(map(flag_kind, self.flags))

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON."""
        return {
            "object_id": self.object_id,
            "flags": list(self.flags),
            "equal_poses": self.equal_poses,
            "chosen": self.chosen,
            "outline_share": {view.name: view.outline_share for view in self.views},
            "candidates": [
                {"number": each.number, "loss": each.loss, "scale": each.scale, "pose": each.pose}
                for each in self.candidates
            ],
        }


def make_align_card(capture: Capture, registration: Registration) -> AlignCard:
    """Draw an object.

    Parameters
    ----------
    capture
        Its parts as their files have them.
    registration
        Where they were found to be.
    """
    meshes = [part.mesh for part in capture.parts]
    there = [
        _moved(registration.used.before(number), meshes)
        for number in range(len(capture.fitted_views))
    ]
    pairs = zip(capture.fitted_views, there, strict=True)
    sheets = [_Sheets.of(capture, view, meshes, posed) for view, posed in pairs]
    return AlignCard(
        capture.object_id,
        capture.category,
        registration.flags,
        registration.equal_poses,
        registration.chosen + 1,
        tuple(_candidates(capture, registration, sheets)),
        tuple(
            each.card(registration, meshes, posed)
            for each, posed in zip(sheets, there, strict=True)
        ),
    )


def pose_text(placement: RigidPlacement) -> str:
    """Write a pose as the column ``pose`` of ``objects.csv`` takes it.

    Examples
    --------
    >>> pose_text(RigidPlacement(np.eye(3), np.array([0.0, 1.5, -20.0])))
    '0 0 0 1 0 1.5 -20'
    """
    quaternion = Rotation.from_matrix(placement.rotation).as_quat().round(6)
    numbers = [*quaternion.tolist(), *placement.translation_cm.round(4).tolist()]
    return " ".join(f"{number + 0.0:g}" for number in numbers)


@dataclass(frozen=True, slots=True, eq=False)
class _Sheets:
    """A view in the three sizes it is drawn in."""

    name: str
    wide: Sheet
    window: Sheet
    small: Sheet

    @classmethod
    def of(cls, capture: Capture, taken: XRayView, meshes: Meshes, there: Meshes) -> _Sheets:
        view, saturated = completed(taken, capture.at_least.get(taken.name))
        shadow: Shadow = shadow_of(view, saturated)
        box = window_around(shadow, there)
        return cls(
            view.name,
            Sheet.of(view, shadow, window_around(shadow, meshes), VIEW_PX),
            Sheet.of(view, shadow, box, VIEW_PX),
            Sheet.of(view, shadow, box, CANDIDATE_PX),
        )

    def card(self, registration: Registration, meshes: Meshes, there: Meshes) -> AlignedView:
        shares: Mapping[str, float] = registration.outline_share
        differ = DISAGREEING & {*registration.flags}
        return AlignedView(
            self.name,
            shares[self.name],
            self.wide.outlined("before", meshes, TOLD),
            self.window.outlined("after", there, FOUND),
            self.window.disagreeing("where they disagree", there) if differ else None,
        )


def _candidates(
    capture: Capture, registration: Registration, sheets: Sequence[_Sheets]
) -> Iterator[CandidateCard]:
    meshes, names = [part.mesh for part in capture.parts], [part.name for part in capture.parts]
    differing = _differing(registration)
    for number, each in enumerate(registration.candidates, start=1):
        pictures = [
            (
                one.name,
                one.small.outlined(one.name.upper(), _moved(each.before(view), meshes), FOUND),
            )
            for view, one in enumerate(sheets)
        ]
        yield CandidateCard(
            number,
            each.loss,
            each.doubt,
            each.left,
            each.edges,
            each.deviance,
            _turned_deg(registration.placement, each),
            each.placement.scale,
            pose_text(each.placement),
            tuple(pictures),
            tuple(
                (names[part], float(each.density_g_cm3[part]))
                for part in differing
                if each.deviance is not None
            ),
        )


def _differing(registration: Registration) -> list[int]:
    """Find the parts that have another density in another candidate, of those that were fitted."""
    fitted = [each for each in registration.candidates if each.deviance is not None]
    if len(fitted) < 2:
        return []
    spread = np.ptp(np.log([each.density_g_cm3 for each in fitted]), axis=0)
    return [int(part) for part in np.flatnonzero(spread > DIFFERING)]


def _moved(there: RigidPlacement, meshes: Meshes) -> Meshes:
    return [there.moved(mesh) for mesh in meshes]


def _turned_deg(used: RigidPlacement, other: Found) -> float:
    turn = Rotation.from_matrix(other.placement.rotation @ used.rotation.T)
    return float(np.degrees(turn.magnitude()))
