"""Rays through part meshes: exact path lengths, who owns what, and voxels.

Needs the extra ``build``.
"""

from xden1k.rays.lengths import PathLengths, path_lengths
from xden1k.rays.priority import ownership_order

__all__ = ["PathLengths", "ownership_order", "path_lengths"]
