"""An empty ``segments.npz``, and the rows to read others by under their own names."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np

from xden1k.errors import DataError
from xden1k.segmentation import CLUSTER_COUNTS, SegmentsMeta, SegmentsWriter, open_segments
from xden1k.values.modality import Track
from xden_bench.methods.baseline import Options, find_method, run_predictor
from xden_bench.methods.template import INPUTS
from xden_bench.scoring.names import skeleton
from xden_bench.scoring.protocol import is_trivial
from xden_bench.scoring.regions import SegmentReference
from xden_bench.scoring.segments import score_segment_file
from xden_bench.scoring.submission import PLACEHOLDER, Progress

__all__ = ["SEGMENTS_TO_FILL_IN", "check_reading_row", "write_segment_template"]

SEGMENTS_TO_FILL_IN: Final[Mapping[str, str]] = {
    "labels/ID": "cluster of each point, a row for each k from 2 to 19, in place of the zeros",
    "free/ID": "cluster of each point, as many as the method finds",
    "method": "the name to print",
    "inputs": "everything the method looks at",
    "training_data": "everything it was trained on",
    "external_data": "true if that is more than this dataset, pretrained weights included",
    "code, paper, command, notes, seed, seconds_per_object, hardware": "if there are any",
}
"""What an author replaces in the file, and by what."""


def write_segment_template(
    path: Path, reference: SegmentReference, track: Track, progress: Progress = iter
) -> SegmentsMeta:
    """Write a submission in which all points have one label, and the name is still to be given.

    Parameters
    ----------
    path
        The ``segments.npz`` to write; one that is there is replaced.
    reference
        The split to answer for; its truth is not read.
    track
        Where the method is to run.
    progress
        Goes through the object ids.

    Returns
    -------
    SegmentsMeta
        What the file says about itself.
    """
    with SegmentsWriter(path) as writer:
        for object_id in progress(reference.ids):
            voxels = reference.drawn(object_id).points.voxels
            nothing = np.zeros((len(CLUSTER_COUNTS), len(voxels)), dtype=np.uint8)
            writer.add(object_id, voxels, nothing, nothing[0])
        meta = SegmentsMeta(
            method=PLACEHOLDER,
            dataset_revision=reference.revision,
            manifest_sha256=reference.manifest_sha256,
            config=reference.rules.config,
            split=reference.split,
            inputs=INPUTS[track],
            training_data=(),
            external_data=False,
            points_seed=reference.rules.points_seed,
            points_sha256=writer.points_sha256,
        )
        writer.finish(meta)
    return meta


def check_reading_row(path: Path, reference: SegmentReference) -> None:
    """Refuse a submission under the name of a row to read others by that does not hold its labels.

    The installed method runs again on the dataset.

    Parameters
    ----------
    path
        A valid submission.
    reference
        What it answers for.

    Raises
    ------
    DataError
        If a label differs.
    """
    with open_segments(path) as found:
        method = found.meta.method if found.meta else ""
    if not is_trivial(method, reference.rules):
        return
    name = next(one for one in reference.rules.unranked if skeleton(one) == skeleton(method))
    with tempfile.TemporaryDirectory() as scratch:
        own = Path(scratch) / "own.npz"
        options = Options(points_seed=reference.rules.points_seed)
        run_predictor(find_method(name), reference.folder, reference.split, own, options)
        sums = [score_segment_file(one, reference).arrays_sha256 for one in (path, own)]
    if sums[0] != sums[1]:
        raise DataError(
            f"{path}: the name {name!r} is that of a row to read others by, and its labels are "
            "others: give the method a name of its own"
        )
