"""Published sizes against the meshes: their order, and entries of other objects."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from xden1k.errors import DataError
from xden_builder.published.sizes import size_order
from xden_builder.published.survey import Survey

CM_PER_UNIT = 4.0
EXTENTS = np.random.default_rng(3).uniform(0.2, 2.0, (30, 3))


def surveys(sizes: np.ndarray, extents: np.ndarray = EXTENTS) -> list[Survey]:
    return [
        survey(k, size, extent)
        for k, (size, extent) in enumerate(zip(sizes.tolist(), extents.tolist(), strict=True))
    ]


def survey(number: int, size_cm: Sequence[float], extent: Sequence[float]) -> Survey:
    unit = (1.0, 1.0, 1.0)
    boxes = tuple(extent), unit, tuple(size_cm), unit, unit
    return Survey(f"xden1k-{number:04d}", [[0.5] * 48] * 2, *boxes, ())


def test_sizes_in_another_order_and_rounded_to_a_millimetre_are_the_meshes_own():
    assert size_order(surveys((CM_PER_UNIT * EXTENTS[:, [2, 0, 1]]).round(1))) == (1, 2, 0)


@pytest.mark.parametrize(("step", "told"), [(3, "3 places after"), (-1, "1 places before")])
def test_entries_of_other_objects_are_told_with_how_far_they_are_off(step, told):
    with pytest.raises(DataError, match=rf"metadata: .* {told} it: the keys are shifted"):
        size_order(surveys(CM_PER_UNIT * np.roll(EXTENTS, step, axis=0)))


def test_one_wrong_entry_or_sizes_of_no_sense_are_not_taken_for_a_shift():
    one_wrong = CM_PER_UNIT * EXTENTS
    one_wrong[4] = one_wrong[5]
    assert size_order(surveys(one_wrong)) == (0, 1, 2)
    size_order(surveys(np.random.default_rng(4).uniform(1, 9, EXTENTS.shape)))
    size_order(surveys(np.roll(EXTENTS[:5], 1, axis=0), EXTENTS[:5]))
