"""What one capture says of the beam that it shares with the others of its folder."""

from __future__ import annotations

from xden_builder.capture import Capture
from xden_builder.capture.space import divide
from xden_builder.poly.survey import Clue, survey
from xden_builder.reconstruct.plausible import check_places
from xden_builder.reconstruct.settings import BuildSettings
from xden_builder.reconstruct.withheld import as_told
from xden_builder.registration.capture import registered

__all__ = ["find_clues"]


def find_clues(capture: Capture, settings: BuildSettings) -> tuple[Clue, ...]:
    """Find what a capture says of its beam: nothing where no tube is known.

    Raises
    ------
    DataError
        As :func:`xden_builder.reconstruct.object.reconstruct`.
    """
    if capture.tube is None or capture.tube.kv is None:
        return ()
    capture = registered(as_told(capture, settings)).capture
    check_places(capture.parts, capture.fitted_views)
    space = divide(capture.parts)
    return survey(capture, space, settings.poly)
