"""What of a capture a rebuild may look at."""

from __future__ import annotations

from dataclasses import replace

from xden_builder.capture import Capture
from xden_builder.reconstruct.settings import Labels

__all__ = ["as_told"]


def as_told(capture: Capture, labels: Labels) -> Capture:
    """Return a capture with its labels, or with all that tells a density apart from the images.

    Parameters
    ----------
    capture
        As its folder holds it.
    labels
        ``withheld`` blanks material and ``hollow`` of every part, and the weighed mass.
    """
    if labels == "read":
        return capture
    parts = tuple(replace(part, material="", hollow=False) for part in capture.parts)
    return replace(capture, parts=parts, weighed_mass_g=None)
