"""Archetypes: how each kind of object is built, one module for each family.

Each is a function of random numbers and a size; see :data:`xden_builder.phantoms.pieces.Build`.
"""

from collections.abc import Mapping
from typing import Final

from xden_builder.phantoms.archetypes.containers import bottle, jar
from xden_builder.phantoms.archetypes.electronics import flashlight, remote_control
from xden_builder.phantoms.archetypes.handtools import hammer, scissors, screwdriver
from xden_builder.phantoms.archetypes.hardware import bolt, padlock
from xden_builder.phantoms.archetypes.kitchen import frying_pan, kettle, mug
from xden_builder.phantoms.archetypes.sports import ball, cored_ball, dumbbell
from xden_builder.phantoms.archetypes.stationery import glue_stick, pen, pencil
from xden_builder.phantoms.pieces import Build

__all__ = ["ARCHETYPES"]

ARCHETYPES: Final[Mapping[str, Build]] = {
    build.__name__: build
    for build in (
        ball,
        bolt,
        bottle,
        cored_ball,
        dumbbell,
        flashlight,
        frying_pan,
        glue_stick,
        hammer,
        jar,
        kettle,
        mug,
        padlock,
        pen,
        pencil,
        remote_control,
        scissors,
        screwdriver,
    )
}
"""By name, the name of the function."""
