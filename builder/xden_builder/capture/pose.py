"""What a lab tells of the frame its part meshes are in: columns of ``objects.csv``."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Final, Literal, cast

from scipy.spatial.transform import Rotation

from xden_builder.capture.tables import CsvRow, number_or_nan

__all__ = [
    "Candidate",
    "CoarsePose",
    "MeshScale",
    "PoseTold",
    "read_mesh_scale",
    "read_pose",
]

NORM_RANGE: Final = (0.9, 1.1)
"""Norm of a quaternion whose figures were rounded; beyond it the numbers are something else."""
_EXPECTED: Final = (
    "must be near, unknown, seven numbers qx qy qz qw tx_cm ty_cm tz_cm, or candidate and a "
    "number from 1"
)


@dataclass(frozen=True, slots=True)
class CoarsePose:
    """A pose told by a person, good to about 20 degrees and 3 cm.

    A mesh point x, in cm, stands at R x + t in the scanner's frame.

    Parameters
    ----------
    quaternion_xyzw
        The rotation R, scalar last, of unit norm.
    translation_cm
        The translation t.
    """

    quaternion_xyzw: tuple[float, float, float, float]
    translation_cm: tuple[float, float, float]

    @property
    def rotation(self) -> Rotation:
        """The rotation R.

        Examples
        --------
        >>> CoarsePose((0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 5.0)).rotation.apply([1, 0, 0]).tolist()
        [-1.0, 0.0, 0.0]
        """
        return Rotation.from_quat(self.quaternion_xyzw)


@dataclass(frozen=True, slots=True)
class Candidate:
    """One of the poses that were found for an object before, chosen by a person.

    Parameters
    ----------
    number
        Its place in the list, from 1.
    """

    number: int


PoseTold = Literal["near", "unknown"] | CoarsePose | Candidate
"""Where the meshes are: ``near`` is within about 2 degrees and 5 mm of the scanner's frame."""

MeshScale = Literal["known", "near", "unknown"]
"""What is known of the meshes' size: all of it, it to a per cent, or to a factor of 2."""


def read_pose(row: CsvRow) -> PoseTold:
    """Read the column ``pose``; empty is ``near``.

    Raises
    ------
    DataError
        If it is none of the forms of ``PoseTold``; the message names file, row and column.
    """
    text = row["pose"] or "near"
    if text in ("near", "unknown"):
        return cast(Literal["near", "unknown"], text)
    if chosen := re.fullmatch(r"candidate +0*([1-9][0-9]{0,8})", text, re.ASCII):
        return Candidate(int(chosen[1]))
    return _read_coarse(row, text)


def _read_coarse(row: CsvRow, text: str) -> CoarsePose:
    numbers = [number_or_nan(number) for number in text.split()]
    if len(numbers) != 7 or not all(map(math.isfinite, numbers)):
        raise row.error("pose", f"{_EXPECTED}, got {text!r}")
    norm = math.hypot(*numbers[:4])
    if not NORM_RANGE[0] <= norm <= NORM_RANGE[1]:
        raise row.error(
            "pose", f"the quaternion qx qy qz qw must have norm 1, got {norm:.3g} in {text!r}"
        )
    qx, qy, qz, qw = (number / norm for number in numbers[:4])
    return CoarsePose((qx, qy, qz, qw), (numbers[4], numbers[5], numbers[6]))


def read_mesh_scale(row: CsvRow) -> MeshScale:
    """Read the column ``mesh_scale``: what is known of the meshes' size; empty is ``known``.

    Raises
    ------
    DataError
        If it is none of ``MeshScale``, or a scale that is unknown goes with meshes that lie
        in the scanner's frame.
    """
    told = row.choice("mesh_scale", ("known", "near", "unknown"), default="known")
    scale = cast(MeshScale, told)
    if scale == "unknown" and read_pose(row) == "near":
        raise row.error("mesh_scale", "is unknown, but meshes whose pose is near have their scale")
    return scale
