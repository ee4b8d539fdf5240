"""What of a capture a rebuild may look at."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from xden1k.rays import outer_surface
from xden_builder.capture import Capture, CapturePart
from xden_builder.reconstruct.settings import BuildSettings

__all__ = ["WHOLE", "as_told", "as_whole"]

WHOLE: Final = "whole"
"""Name of the part that an outer surface is."""


def as_told(capture: Capture, settings: BuildSettings) -> Capture:
    """Return a capture as a rebuild is told it.

    Parameters
    ----------
    capture
        As its folder holds it.
    settings
        ``labels="withheld"`` blanks material and ``hollow`` of every part, and the weighed mass:
        all that tells a density apart from the images. ``geometry="outer"`` makes one part of all.
    """
    if settings.labels == "withheld":
        parts = tuple(replace(part, material="", hollow=False) for part in capture.parts)
        capture = replace(capture, parts=parts, weighed_mass_g=None)
    return as_whole(capture) if settings.geometry == "outer" else capture


def as_whole(capture: Capture) -> Capture:
    """Return a capture of one part, the outer surface of all: hollow, of unknown material."""
    outer = outer_surface([part.mesh for part in capture.parts])
    return replace(capture, parts=(CapturePart(WHOLE, outer, hollow=True),))
