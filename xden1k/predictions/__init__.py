"""``preds.npz``: the one file a method hands to the benchmark.

::

    __meta__               0-d string, JSON: see SubmissionMeta
    density/OBJECT_ID      (64, 64, 64) float32 or float16, voxel means on the object's field grid
    part_density/OBJECT_ID (parts + 1,) float32, entry 0 = air; only where the inputs include parts
    density_sd/OBJECT_ID, part_density_sd/OBJECT_ID: beside every density or none, of its shape

An ordinary compressed ``.npz``, one of the two arrays for every object of the split, in g/cm³ or
kg/m³ as the meta data declare. The optional ``_sd`` is the standard deviation of the error that the
method expects, in the same units. Baselines write it and the benchmark reads it; files come from
strangers, so the reader trusts nothing in them.
"""

from xden1k.predictions.meta import MAX_TEXT, SCHEMA, MethodMeta, SubmissionMeta, Target, Units
from xden1k.predictions.problems import (
    CODES,
    SUSPICIONS,
    Problem,
    listed,
    raise_errors,
    raise_suspicions,
)
from xden1k.predictions.reader import Predictions, open_predictions
from xden1k.predictions.writer import PredictionsWriter, write_predictions

__all__ = [
    "CODES",
    "MAX_TEXT",
    "SCHEMA",
    "SUSPICIONS",
    "MethodMeta",
    "Predictions",
    "PredictionsWriter",
    "Problem",
    "SubmissionMeta",
    "Target",
    "Units",
    "listed",
    "open_predictions",
    "raise_errors",
    "raise_suspicions",
    "write_predictions",
]
