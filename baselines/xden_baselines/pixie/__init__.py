"""Pixie style and its relatives: 3D networks trained on the training split.

torch is imported by what needs it, not here.
"""

from xden_baselines.pixie.predictor import (
    ColourUNet,
    ColourUNetFull,
    GeometryUNet,
    PixieStyle,
    PixieStyleFull,
    XRayUNet,
)
from xden_baselines.pixie.settings import Settings

__all__ = [
    "ColourUNet",
    "ColourUNetFull",
    "GeometryUNet",
    "PixieStyle",
    "PixieStyleFull",
    "Settings",
    "XRayUNet",
]
