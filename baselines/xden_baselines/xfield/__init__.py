"""X-Field: density and parts at any point inside, from two radiographs and the outer surface.

torch is imported by what needs it, not here.
"""

from xden_baselines.xfield.methods import (
    XFieldBoth,
    XFieldGeometryContrastive,
    XFieldGeometryDensity,
    XFieldPaper,
    XFieldPixel,
    XFieldRays,
    XFieldVoxel,
)
from xden_baselines.xfield.settings import Settings

__all__ = [
    "Settings",
    "XFieldBoth",
    "XFieldGeometryContrastive",
    "XFieldGeometryDensity",
    "XFieldPaper",
    "XFieldPixel",
    "XFieldRays",
    "XFieldVoxel",
]
