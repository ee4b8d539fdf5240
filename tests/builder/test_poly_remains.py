"""What a pose leaves of the images."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from jaxtyping import Bool, Float64

from xden_builder.poly.pyramid import LOST_FROM, Level
from xden_builder.poly.remains import all_left, doubt, much_left
from xden_builder.poly.target import Averaged

Vector = Float64[np.ndarray, "_n"]
NONE = np.zeros(0)
UNKNOWN, SATURATED = 0.123, 0.321
"""Stand for pixels of no value, and for those known from below alone."""


class Met(Level):
    """Nothing but how residuals count, and which of them are where the object is."""

    off: Vector

    def __init__(self, off: Vector = NONE) -> None:
        for name, value in (("off", off), ("lost_from", LOST_FROM)):
            object.__setattr__(self, name, value)

    def counted(self, _: object) -> Iterator[tuple[Bool[np.ndarray, "_n"], Vector]]:
        yield np.ones(len(self.off), dtype=np.bool_), self.off

    def met(self, _: Vector) -> Iterator[Bool[np.ndarray, "_n"]]:
        yield np.ones(len(self.off), dtype=np.bool_)


@pytest.mark.parametrize(
    ("there", "everywhere", "much"), [(0.5, 0.2, True), (0.3, 0.2, False), (0.3, 0.3, True)]
)
def test_much_is_left_by_the_pixels_that_meet_an_object_or_by_all(
    monkeypatch: pytest.MonkeyPatch, there: float, everywhere: float, much: bool
) -> None:
    monkeypatch.setattr(Met, "mean_left", lambda *_: everywhere**2)
    assert much_left(Met(np.full(9, there)), NONE, []) is much


class Seen(Met):
    """One view of which nothing is rendered: residuals, and where the object is, are told."""

    inside: list[bool]

    def __init__(self, off: list[float], met: list[bool], seen: Vector, beside: Vector) -> None:
        super().__init__(np.array(off))
        image = np.concatenate([seen, beside])[None]
        known, at_least = image != UNKNOWN, image == SATURATED
        masks = [np.arange(image.size)[None] < len(seen)]
        averaged = Averaged(np.float32(image), known, at_least, np.zeros(image.shape))
        given = (("inside", met), ("measured", [seen]), ("masks", masks), ("whole", [averaged]))
        for name, value in given:
            object.__setattr__(self, name, value)

    def lights(self, _: Vector) -> tuple[list[float], list[float]]:
        return [1.0], [0.0]

    def met(self, _: Vector) -> Iterator[Bool[np.ndarray, "_n"]]:
        yield np.array(self.inside)


def doubted(off: list[float], met: list[bool], seen: list[float], beside: list[float]) -> float:
    return doubt(Seen(off, met, np.array(seen), np.array(beside)), NONE, [])


def test_much_left_of_few_pixels_is_less_doubt_than_as_much_spread_over_all() -> None:
    all_met, seen = [True] * 10, [0.5] * 10
    few = doubted([0.0] * 9 + [np.sqrt(2.5)], all_met, seen, [])
    each = doubted([0.5] * 10, all_met, seen, [])
    assert few < 0.3 * each


def test_light_that_something_took_counts_as_much_beside_what_is_compared() -> None:
    compared = doubted([0.1, 10.0], [True, False], [0.6, 0.5], [1.0])
    assert doubted([0.1], [True], [0.6], [0.5, 1.0]) == pytest.approx(compared)


def test_air_that_no_object_meets_says_nothing_of_a_pose() -> None:
    alone = doubted([0.1], [True], [0.6], [])
    assert doubted([0.1, 0.2], [True, False], [0.6, 0.99], [1.01]) == pytest.approx(alone)


@pytest.mark.parametrize("told", [UNKNOWN, SATURATED])
def test_what_is_not_told_beside_what_is_compared_is_no_shade(told: float) -> None:
    assert doubted([0.1], [True], [0.6], [told]) == doubted([0.1], [True], [0.6], [])


def test_squares_of_shade_beside_what_is_compared_count_as_those_of_pixels_that_are() -> None:
    shade = (0.9 - 1.0) / 0.05
    compared = Seen([0.3, shade], [True, False], np.array([0.6, 0.9]), np.array([1.0]))
    beside = Seen([0.3], [True], np.array([0.6]), np.array([0.9, 1.0]))
    assert all_left(beside, NONE, [beside.off]) == pytest.approx(
        all_left(compared, NONE, [compared.off])
    )
