"""A capture with its parts where they stand before the scanner, wherever their files have them."""

from __future__ import annotations

from dataclasses import dataclass

from xden_builder.capture import Capture
from xden_builder.capture.space import divide
from xden_builder.registration.placement import Registration, RigidPlacement
from xden_builder.registration.search import register

__all__ = ["Registered", "registered"]


@dataclass(frozen=True, slots=True, eq=False)
class Registered:
    """A capture whose pose is ``near``.

    Parameters
    ----------
    capture
        Its parts stand in the scanner's frame.
    registration
        How they came there; None where they were there already.
    """

    capture: Capture
    registration: Registration | None = None

    @property
    def placement(self) -> RigidPlacement | None:
        """By which they came there."""
        return None if self.registration is None else self.registration.placement


def registered(capture: Capture) -> Registered:
    """Put the parts of a capture into the scanner's frame, where they are not in it.

    Raises
    ------
    DataError
        As :func:`xden_builder.registration.search.register`, and
        :func:`xden_builder.capture.space.divide`.
    """
    if capture.pose == "near":
        return Registered(capture)
    registration = register(capture, divide(capture.parts))
    return Registered(registration.placement.of_capture(capture), registration)
