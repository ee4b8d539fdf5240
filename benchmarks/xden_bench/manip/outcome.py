"""What can become of a pick; reading it needs no simulator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

__all__ = ["OUTCOMES", "Outcome", "Trial"]

Outcome = Literal["held", "slipped", "rotated"]
OUTCOMES: Final[tuple[Outcome, ...]] = ("held", "slipped", "rotated")


@dataclass(frozen=True, slots=True)
class Trial:
    """What became of one pick.

    Parameters
    ----------
    outcome
        ``held`` if the centre of mass was high enough after hold and shake, and the object turned
        little in the hand; else ``rotated`` if it is still in the hand, and ``slipped`` if not.
    wrist_moment_nm
        Mean over the hold, tared before the grasp.
    turn_deg
        Of the object in the hand since it closed, the larger of those after hold and shake.
    warnings
        Of the solver; none where all is sound.
    """

    outcome: Outcome
    wrist_moment_nm: float
    turn_deg: float
    warnings: int
