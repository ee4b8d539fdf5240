"""Which part is where inside: the points that are labelled, their regions, and ``segments.npz``.

::

    __meta__        0-d string, JSON: see SegmentsMeta
    labels/OBJECT_ID  (18, points) uint8: the cluster of each point, a row for each k = 2 to 19
    free/OBJECT_ID    (points,) uint8: the same with as many clusters as the method finds

An ordinary compressed ``.npz``, both arrays for every object of the split. Names of clusters mean
nothing. Drawing the points (:mod:`xden1k.segmentation.points`) needs the extra ``build``.
"""

from xden1k.predictions.meta import SegmentsMeta
from xden1k.segmentation.reader import SEGMENT_CODES, Segments, open_segments
from xden1k.segmentation.regions import material_regions, numbered
from xden1k.segmentation.values import (
    CLUSTER_COUNTS,
    GRID_SIZE,
    MAX_POINTS,
    Segmentation,
    SegmentPoints,
    points_sha256,
)
from xden1k.segmentation.writer import SegmentsWriter

__all__ = [
    "CLUSTER_COUNTS",
    "GRID_SIZE",
    "MAX_POINTS",
    "SEGMENT_CODES",
    "SegmentPoints",
    "Segmentation",
    "Segments",
    "SegmentsMeta",
    "SegmentsWriter",
    "material_regions",
    "numbered",
    "open_segments",
    "points_sha256",
]
