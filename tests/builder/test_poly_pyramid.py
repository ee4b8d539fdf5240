"""The search for a pose on one resolution: its steps, on residuals that are linear."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from jaxtyping import Bool, Float64
from numpy.testing import assert_allclose

from xden_builder.fit.problem import Evaluation
from xden_builder.poly.descent import descend
from xden_builder.poly.pyramid import LOST_FROM, Level
from xden_builder.poly.remains import doubt, much_left
from xden_builder.poly.target import Averaged

Vector = Float64[np.ndarray, "_n"]
FREE = np.full(3, np.inf)


class Line(Level):
    """Residuals ``matrix @ unknowns - 1``, told with slopes of any sign."""

    matrix: Float64[np.ndarray, "n u"]
    sign: int
    tried: list[Vector]

    def __init__(self, matrix: Float64[np.ndarray, "n u"], sign: int = 1) -> None:
        for name, value in (("matrix", matrix), ("sign", sign), ("tried", [])):
            object.__setattr__(self, name, value)

    def residuals(self, unknowns: Vector) -> list[Vector]:
        self.tried.append(unknowns)
        return [self.matrix @ unknowns - 1]

    def residuals_and_slopes(self, unknowns: Vector) -> tuple[list[Vector], list[Vector]]:
        return [self.matrix @ unknowns - 1], [self.sign * self.matrix]

    def believed(self, _: list[Vector]) -> Line:
        return self

    def loss(self, unknowns: Vector, residuals: list[Vector]) -> float:
        return float(residuals[0] @ residuals[0])

    def evaluate(
        self, unknowns: Vector, residuals: list[Vector], slopes: list[Vector]
    ) -> Evaluation:
        loss = self.loss(unknowns, residuals)
        return Evaluation(loss, slopes[0].T @ residuals[0], slopes[0].T @ slopes[0], ())


def line(sign: int = 1) -> Line:
    return Line(np.random.default_rng(0).normal(size=(9, 3)), sign)


def test_a_descent_ends_at_the_least_squares_with_the_residuals_there() -> None:
    level = line()
    end = descend(level, np.zeros(3), 3, -FREE, FREE)
    best = np.linalg.lstsq(level.matrix, np.ones(9))[0]
    assert_allclose(end.unknowns, best, atol=1e-5)
    assert_allclose(end.residuals[0], level.matrix @ end.unknowns - 1)
    assert_allclose(end.before[0], -1)


def test_a_refused_step_is_not_tried_again_next_to_where_it_was() -> None:
    level, start = line(sign=-1), np.zeros(3)  # uphill: every step is refused
    end = descend(level, start, 1, -FREE, FREE)
    assert_allclose(end.unknowns, start)
    lengths = np.array([np.linalg.norm(each) for each in level.tried])
    assert len(lengths) > 2
    assert (lengths[1:] < 0.95 * lengths[:-1]).all()


NONE = np.zeros(0)


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


def test_large_residuals_pull_by_the_slope_of_what_they_leave() -> None:
    level, step = Met(), 1e-6
    for off in (-9.0, -1.0, 0.5, 2.2, 3.0, 8.0):
        ahead, behind = (level.tempered(np.array([off + way])) for way in (step, -step))
        (weight,) = level.weights_of(np.array([off]))
        assert_allclose((ahead - behind) / (2 * step), 2 * weight * off, rtol=1e-4)


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
        known, whole = np.ones(image.shape, dtype=np.bool_), np.zeros(image.shape, dtype=np.bool_)
        masks = [np.arange(image.size)[None] < len(seen)]
        averaged = Averaged(np.float32(image), known, whole, np.zeros(image.shape))
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
