"""How the objects of a split were drawn, and which means of a protocol get an interval."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float64

from xden_bench.scoring.clusters import category_sums
from xden_bench.scoring.protocol import Rules
from xden_bench.scoring.strata import strata
from xden_bench.scoring.studentised import Sampled, studentised_intervals

__all__ = ["protocol_intervals", "sampled"]


def protocol_intervals(
    values: Float64[np.ndarray, "objects metrics"],
    categories: Sequence[str],
    names: Sequence[str],
    protocol: Rules,
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
    if not kept or not _is_enough(categories, protocol):
        return {}
    sample = sampled(values[:, kept], categories, protocol)
    ends = studentised_intervals(sample, protocol.bootstrap_resamples, protocol.bootstrap_seed)
    return {
        names[place]: (low, high) for place, (low, high) in zip(kept, ends.T.tolist(), strict=True)
    }


def sampled(
    values: Float64[np.ndarray, "objects columns"], categories: Sequence[str], protocol: Rules
) -> Sampled:
    """Say how objects were drawn.

    The categories of the split ``unseen`` are named by the protocol: objects of each of them are
    drawn. Else categories are.

    Parameters
    ----------
    values
        Shape (objects, columns).
    categories
        Of each object.
    protocol
        Which categories are unseen.
    """
    sizes = Counter(categories)
    if sizes.keys() == {*protocol.unseen_categories} and min(sizes.values()) > 1:
        return strata(values, categories)
    return category_sums(values, categories)


def _is_enough(categories: Sequence[str], protocol: Rules) -> bool:
    """Whether there are so many objects that intervals cover."""
    sizes = Counter(categories)
    if len(categories) < protocol.min_interval_objects:
        return False
    if sizes.keys() == {*protocol.unseen_categories}:
        return min(sizes.values()) >= protocol.min_interval_stratum
    return len(sizes) >= protocol.min_interval_categories
