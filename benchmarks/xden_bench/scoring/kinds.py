"""Where segments are lost: by the number of regions, what of a part can be seen, and its thickness.

Needs the extra ``build``.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float64, UInt8
from scipy import ndimage

from xden1k.errors import DataError
from xden1k.predictions import raise_errors
from xden1k.rays import PathLengths, path_lengths
from xden1k.segmentation import Segmentation, Segments
from xden1k.segmentation.points import owner_voxels
from xden1k.values.thickness import plate_thickness_cm
from xden1k.values.types import DensityObject
from xden1k.values.views import XRayView
from xden_bench.scoring.overlap import PERCENT, iou_matrix, many_to_one, score_segments
from xden_bench.scoring.regions import DrawnObject, Regions, SegmentReference
from xden_bench.scoring.segments import SegmentCheck
from xden_bench.scoring.submission import Progress

__all__ = ["KINDS", "Kind", "Seen", "part_ious", "segment_kinds", "visible_parts"]

DARK: Final = 0.01
"""Transmission below which a ray tells nothing, and the least change of it that shows a part."""
OPAQUE_SHARE: Final = 0.1
"""Share of the rays through an object that tell nothing, in one view, which makes it opaque."""
THIN_CM: Final = 0.2
"""Mean thickness below which a part is thin."""
VOID: Final = 0

KINDS: Final = (
    "objects of 2 regions",
    "objects of 3 or 4 regions",
    "objects of 5 or more regions",
    "transparent objects",
    "opaque objects",
    "visible parts",
    "visible parts, in an X-ray",
    "visible parts, in no X-ray",
    "hidden parts, in an X-ray",
    "hidden parts, in no X-ray",
    "thin parts",
    "thick parts",
    "enclosed voids",
)


@dataclass(frozen=True, slots=True)
class Kind:
    """How well one kind of objects or parts is found.

    Parameters
    ----------
    count
        Objects or parts.
    iou
        Mean, percent: of objects by protocol A, of parts with the cluster that fits best.
    """

    count: int
    iou: float


class Seen:
    """What of an object can be seen.

    Parameters
    ----------
    whole
        Its parts, with their attenuation, and its radiographs.

    Raises
    ------
    DataError
        If it has no radiographs, or the attenuation of a part is not known.
    """

    def __init__(self, whole: DensityObject) -> None:
        lac = np.array([part.lac_per_cm for part in whole.parts])
        if not whole.views or not np.isfinite(lac).all():
            missing = "attenuation of every part" if whole.views else "radiographs"
            raise DataError(f"{whole.object_id} must have {missing}: what can be seen is not known")
        meshes = [part.mesh for part in whole.parts]
        ways = [path_lengths(meshes, range(len(meshes)), view.geometry) for view in whole.views]
        self._dark = [_dark_share(*pair) for pair in zip(whole.views, ways, strict=True)]
        self._changes = np.max([_changes(one, lac) for one in ways], axis=0)

    @property
    def opaque(self) -> bool:
        """Whether over a tenth of the rays through it have a transmission below 0.01 in a view."""
        return max(self._dark) > OPAQUE_SHARE

    def shown(self, part: int) -> bool:
        """Whether the transmission of some pixel would rise by over 0.01 without a part, from 1.

        Monochromatic, by the part's attenuation.
        """
        return bool(self._changes[part - 1] > DARK)


def _dark_share(view: XRayView, ways: PathLengths) -> float:
    behind = view.transmission.flat[ways.pixels][view.valid.flat[ways.pixels]]
    return float(np.mean(behind < DARK)) if len(behind) else 1.0


def _changes(ways: PathLengths, lac_per_cm: Float64[np.ndarray, "k"]) -> Float64[np.ndarray, "k"]:
    """Largest rise of the transmission of a pixel without each part."""
    if not len(ways.pixels):
        return np.zeros(len(lac_per_cm))
    exponents = ways.lengths_cm.mean(axis=1) * lac_per_cm
    all_in = exponents.sum(axis=1, keepdims=True)
    return np.asarray((np.exp(exponents - all_in) - np.exp(-all_in)).max(axis=0))


def visible_parts(owners: UInt8[np.ndarray, "x y z"]) -> frozenset[int]:
    """Parts of which a voxel has a face outside the object.

    Parameters
    ----------
    owners
        As :func:`xden1k.segmentation.points.owner_voxels` gives them.
    """
    inside = np.pad(ndimage.binary_fill_holes(owners > 0), 1)
    surface = (inside & ~ndimage.binary_erosion(inside))[1:-1, 1:-1, 1:-1]
    return frozenset(np.unique(owners[surface]).tolist())


def part_ious(parts: UInt8[np.ndarray, "points"], answer: Segmentation) -> Mapping[int, float]:
    """IoU of each part that is there with the cluster that fits it best, percent.

    Of the number of clusters that ``iou_b_part`` takes.

    Parameters
    ----------
    parts
        Shape (points,): who owns each, 0 = void.
    answer
        Of a method, for the same points.

    Examples
    --------
    >>> labels = np.tile(np.array([0, 0, 0, 1, 1], np.uint8), (18, 1))
    >>> part_ious(np.array([0, 0, 0, 0, 2], np.uint8), Segmentation(labels, labels[0]))
    {0: 75.0, 2: 50.0}
    """
    matrices = [iou_matrix(parts, row) for row in answer.labels]
    best = max(matrices, key=many_to_one).max(axis=1)
    return dict(zip(np.unique(parts).tolist(), (PERCENT * best).tolist(), strict=True))


def segment_kinds(
    path: Path, reference: SegmentReference, progress: Progress = iter
) -> Mapping[str, Kind]:
    """Mean IoU of each kind of objects and of parts that there is, in the order of ``KINDS``.

    A part is visible if one of its voxels of the 256³ grid has a face that is outside the object,
    and thin if a plate of its volume and surface would be thinner than 2 mm.

    Parameters
    ----------
    path
        A ``segments.npz``.
    reference
        The truth.
    progress
        Goes through the object ids.

    Raises
    ------
    SubmissionError
        With every problem of the submission.
    OSError
        If there is no such file.
    DataError
        If an object has no radiographs, or an attenuation is not known.
    """
    found: dict[str, list[float]] = defaultdict(list)
    with Segments(path) as segments:
        check = SegmentCheck(segments, reference, None, progress)
        for drawn, answer in check.answers():
            seen = Seen(reference.folder.object(drawn.row["object_id"]))
            truth = drawn.regions(reference.rules.region_gap_g_cm3)
            for kind, iou in (
                *_of_object(truth, answer, seen),
                *_of_parts(drawn, truth, answer, seen),
            ):
                found[kind].append(iou)
        raise_errors(check.problems, path)
    means = {kind: Kind(len(ious), float(np.mean(ious))) for kind, ious in found.items()}
    return {kind: means[kind] for kind in KINDS if kind in means}


def _of_object(truth: Regions, answer: Segmentation, seen: Seen) -> Iterator[tuple[str, float]]:
    """Protocol A of an object, by each of its kinds; nothing of an object of one region."""
    regions = len(np.unique(truth.materials))
    if regions == 1:
        return
    iou = score_segments(truth.materials, truth.parts, answer)["iou_a"]
    number = "2" if regions == 2 else "3 or 4" if regions < 5 else "5 or more"
    yield f"objects of {number} regions", iou
    yield "opaque objects" if seen.opaque else "transparent objects", iou


def _of_parts(
    drawn: DrawnObject, truth: Regions, answer: Segmentation, seen: Seen
) -> Iterator[tuple[str, float]]:
    """IoU of each part, by each of its kinds; nothing of an object of a single part."""
    ious = part_ious(truth.parts, answer)
    if len(ious) == 1:
        return
    visible = visible_parts(owner_voxels(drawn.meshes, drawn.grid))
    for part, iou in ious.items():
        if part == VOID:
            yield "enclosed voids", iou
            continue
        ray = "an X-ray" if seen.shown(part) else "no X-ray"
        yield f"{'visible' if part in visible else 'hidden'} parts, in {ray}", iou
        if part in visible:
            yield "visible parts", iou
        thin = plate_thickness_cm(drawn.meshes[part - 1]) < THIN_CM
        yield "thin parts" if thin else "thick parts", iou
