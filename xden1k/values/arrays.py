"""Names for the array shapes that recur in signatures."""

import numpy as np
from jaxtyping import Bool, Float, Float32, Integer, UInt8

__all__ = ["Faces", "Grid", "Image", "Labels", "Mask", "Points", "Vec3"]

Vec3 = Float[np.ndarray, "3"]
"""A point or a direction in the object frame, cm."""
Points = Float[np.ndarray, "points 3"]
"""Points in the object frame, cm."""
Faces = Integer[np.ndarray, "faces 3"]
"""Vertex indices of triangles, counter-clockwise seen from outside."""
Image = Float32[np.ndarray, "rows columns"]
"""One value for each detector pixel."""
Mask = Bool[np.ndarray, "rows columns"]
"""True where a pixel is meant."""
Grid = Float[np.ndarray, "x y z"]
"""One value for each voxel, axes in the order x, y, z."""
Labels = UInt8[np.ndarray, "label_x label_y label_z"]
"""0 = air, k = part k; finer than the grids of the same object."""
