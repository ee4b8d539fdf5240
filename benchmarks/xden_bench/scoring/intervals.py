"""Which means of a protocol get an interval, and by which way of drawing objects."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float64

from xden_bench.scoring.clusters import category_sums
from xden_bench.scoring.protocol import Protocol
from xden_bench.scoring.strata import strata
from xden_bench.scoring.studentised import Sampled, studentised_intervals

__all__ = ["protocol_intervals"]


def protocol_intervals(
    values: Float64[np.ndarray, "objects metrics"],
    categories: Sequence[str],
    names: Sequence[str],
    protocol: Protocol,
) -> Mapping[str, tuple[float, float]]:
    """Intervals of the means that a protocol trusts, by metric; of others there is none.

    Parameters
    ----------
    values
        Shape (objects, metrics).
    categories
        Of each object.
    names
        Metrics.
    protocol
        Which metrics have one, and from how many objects and categories on.
    """
    kept = [place for place, name in enumerate(names) if name in protocol.interval_metrics]
    sample = _sampled(values[:, kept], categories, protocol)
    if not kept or sample is None:
        return {}
    ends = studentised_intervals(sample, protocol.bootstrap_resamples, protocol.bootstrap_seed)
    return {
        names[place]: (low, high) for place, (low, high) in zip(kept, ends.T.tolist(), strict=True)
    }


def _sampled(
    values: Float64[np.ndarray, "objects metrics"], categories: Sequence[str], protocol: Protocol
) -> Sampled | None:
    """Say how objects were drawn; None where there are too few for an interval that covers.

    The categories of ``unseen`` are named by the protocol: objects of each of them are drawn. Else
    categories are.
    """
    sizes = Counter(categories)
    if len(categories) < protocol.min_interval_objects:
        return None
    if sizes.keys() == {*protocol.unseen_categories}:
        enough = min(sizes.values()) >= protocol.min_interval_stratum
        return strata(values, categories) if enough else None
    enough = len(sizes) >= protocol.min_interval_categories
    return category_sums(values, categories) if enough else None
