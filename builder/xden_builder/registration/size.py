"""The size of an object whose source has no spectrum: by the outlines that two views show.

A spectrum's fit finds it along with its pose (:mod:`xden_builder.poly.pose`).
"""

from __future__ import annotations

from dataclasses import replace

from xden_builder.capture import Capture
from xden_builder.capture.space import Space
from xden_builder.physics.source import Tube
from xden_builder.poly.model.size import Size
from xden_builder.poly.pose import find_pose
from xden_builder.poly.scene import set_scene
from xden_builder.poly.settings import PolySettings
from xden_builder.poly.start import first_guess
from xden_builder.registration.reduced import USUAL_KEV

__all__ = ["find_size"]


def find_size(capture: Capture, space: Space) -> Size:
    """Find how large an object is beside its meshes, along with its pose, which is left as told.

    Parameters
    ----------
    capture
        Its parts stand near their place in the scanner's frame, and have their size to a per cent.
    space
        What is each part's.

    Raises
    ------
    DataError
        If the source is outside the tables.
    """
    told = replace(capture, tube=capture.tube or Tube(energy_kev=USUAL_KEV))
    settings = PolySettings()
    return find_pose(first_guess(set_scene(told, space, settings)), settings).size
