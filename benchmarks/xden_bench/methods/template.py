"""An empty submission: what an author copies and fills in. It is valid once it has a name."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np

from xden1k.predictions import SubmissionMeta, write_predictions
from xden1k.values.modality import Track
from xden1k.values.types import FIELD_SIZE
from xden_bench.scoring.protocol import Protocol
from xden_bench.scoring.reference import Reference
from xden_bench.scoring.submission import PLACEHOLDER

__all__ = ["TO_FILL_IN", "write_template"]

INPUTS: Final[Mapping[Track, tuple[str, ...]]] = {
    "geometry": ("mesh",),
    "rgb": ("mesh", "rgb"),
    "rgb_parts": ("mesh", "rgb", "parts"),
    "xray": ("mesh", "xray"),
}
"""What a method of each track looks at; the author corrects it."""

TO_FILL_IN: Final[Mapping[str, str]] = {
    "density/ID": "your voxel means, in place of the zeros",
    "density_sd/ID": "optional, for all objects or none: their standard deviations",
    "method": "the name to print",
    "inputs": "everything the method looks at",
    "training_data": "everything it was trained on",
    "external_data": "true if that is more than this dataset, pretrained weights included",
    "code, paper, command, notes, seed": "if there are any",
    "seconds_per_object, processor_seconds_per_object, peak_memory_gb, hardware": "if measured",
}
"""What an author replaces in the file, and by what."""


def write_template(
    path: Path, reference: Reference, protocol: Protocol, track: Track
) -> SubmissionMeta:
    """Write a submission in which every density is zero, and the name is still to be given.

    Parameters
    ----------
    path
        The ``preds.npz`` to write; one that is there is replaced.
    reference
        The split to predict; its truth is not read.
    protocol
        Its first target is what the file predicts.
    track
        Where the method is to run.

    Returns
    -------
    SubmissionMeta
        What the file says about itself.
    """
    meta = SubmissionMeta(
        method=PLACEHOLDER,
        dataset_revision=reference.revision,
        manifest_sha256=reference.manifest_sha256,
        config=protocol.config,
        split=reference.split,
        inputs=INPUTS[track],
        training_data=(),
        external_data=False,
        target=protocol.targets[0],
    )
    nothing = np.zeros((FIELD_SIZE,) * 3, dtype=np.float32)
    write_predictions(path, meta, ((one, nothing) for one in reference.ids))
    return meta
