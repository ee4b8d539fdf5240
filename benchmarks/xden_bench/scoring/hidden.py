"""What a method misjudges on view, and what no picture shows: a density error in two shares.

A perfect eye, such as ``seen-materials``, is told the true material of all that can be seen and
takes what lies behind for the same. Where it is wrong all the same, something is hidden: a cavity,
a filling, another material. Every voxel is one or the other, so that the two shares of an error
add up to the density MAE.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Bool

from xden1k.errors import DataError
from xden1k.predictions import Predictions, raise_errors
from xden1k.values.arrays import Grid
from xden1k.values.modality import Modality
from xden_bench.scoring.metrics import density_mae_g_cm3
from xden_bench.scoring.protocol import Protocol
from xden_bench.scoring.reference import Reference
from xden_bench.scoring.submission import Check, Progress

__all__ = ["SplitError", "hidden_voxels", "split_errors"]

HIDDEN_ABOVE: Final = 0.1
"""As a share of the larger density: a material differs from its table by less than that."""
FAINT_G_CM3: Final = 0.05
"""Differences of foams and of air, which hide nothing."""


@dataclass(frozen=True, slots=True)
class SplitError:
    """Mean over objects of a method's density error.

    Parameters
    ----------
    method
        Its name.
    density_mae_g_cm3
        As it is ranked: the sum of the next two.
    recognition_g_cm3
        Of it, what lies in voxels where the perfect eye is right.
    hidden_g_cm3
        Of it, what lies in voxels where the perfect eye is wrong.
    from_eye_g_cm3
        Mean absolute difference from the perfect eye: what perfect recognition would change.
    objects
        How many there are.
    """

    method: str
    density_mae_g_cm3: float
    recognition_g_cm3: float
    hidden_g_cm3: float
    from_eye_g_cm3: float
    objects: int


def hidden_voxels(truth_g_cm3: Grid, eye_g_cm3: Grid) -> Bool[np.ndarray, "x y z"]:
    """Voxels whose density is another than that of what is seen.

    Parameters
    ----------
    truth_g_cm3, eye_g_cm3
        Shape (x, y, z), voxel means: the truth, and the prediction of a perfect eye.

    Examples
    --------
    >>> hidden_voxels(np.array([[[7.8, 0.0]]]), np.array([[[7.7, 7.7]]])).tolist()
    [[[False, True]]]
    """
    least = np.maximum(HIDDEN_ABOVE * np.maximum(truth_g_cm3, eye_g_cm3), FAINT_G_CM3)
    hidden: Bool[np.ndarray, "x y z"] = np.abs(truth_g_cm3 - eye_g_cm3) > least
    return hidden


def split_errors(
    submission: Path, eye: Path, reference: Reference, protocol: Protocol, progress: Progress = iter
) -> SplitError:
    """Split the density MAE of a submission by what a perfect eye knows.

    Parameters
    ----------
    submission
        Of the method.
    eye
        Of a perfect eye, on the same split.
    reference
        The truth.
    protocol
        Whose density MAE it is.
    progress
        Goes through the object ids.

    Raises
    ------
    SubmissionError
        With every problem of either.
    DataError
        If ``eye`` is of a method that was told no materials, or the targets differ.
    OSError
        If a file is not there.
    """
    with Predictions(submission) as asked, Predictions(eye) as seen:
        _check_eye(asked, seen, eye)
        checks = [
            Check(asked, reference, protocol, progress=progress),
            Check(seen, reference, protocol),
        ]
        found = []
        for a, b in zip_longest(*(check.fields() for check in checks)):
            if a and b and a[0].object_id == b[0].object_id:  # else one has a problem, told below
                found.append(_errors(a[0].density_g_cm3, a[1], b[1], a[0].envelope))
        for check in checks:
            raise_errors(check.problems)
        assert asked.meta is not None
        total, recognition, hidden, from_eye = np.mean(found, axis=0).tolist()
        name = asked.meta.method
        return SplitError(name, total, recognition, hidden, from_eye, len(found))


def _check_eye(asked: Predictions, seen: Predictions, path: Path) -> None:
    """Refuse what is no perfect eye; a file that cannot be read is told of with its problems."""
    if asked.meta is None or seen.meta is None:
        return
    if not seen.meta.reads & (Modality.MATERIALS | Modality.TRUTH):
        raise DataError(
            f"{path}: expected a perfect eye, such as seen-materials, which is told materials; "
            f"{seen.meta.method} looks at {', '.join(seen.meta.inputs)}"
        )
    if asked.meta.target != seen.meta.target:
        raise DataError(
            f"{path}: its target is {seen.meta.target}, that of {asked.meta.method} "
            f"{asked.meta.target}"
        )


def _errors(truth: Grid, guess: Grid, eye: Grid, envelope: Grid) -> tuple[float, ...]:
    """In the order of :class:`SplitError`."""
    hidden = hidden_voxels(truth, eye)
    return (
        density_mae_g_cm3(truth, guess, envelope),
        density_mae_g_cm3(truth, np.where(hidden, truth, guess), envelope),
        density_mae_g_cm3(truth, np.where(hidden, guess, truth), envelope),
        density_mae_g_cm3(eye, guess, envelope),
    )
