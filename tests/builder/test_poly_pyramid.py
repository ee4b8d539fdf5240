"""The search for a pose on one resolution: its steps, on residuals that are linear."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64
from numpy.testing import assert_allclose

from xden_builder.fit.problem import Evaluation
from xden_builder.poly.descent import descend
from xden_builder.poly.pyramid import LOST_FROM, Level

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


class Tempered(Level):
    """Nothing but how residuals count."""

    def __init__(self) -> None:
        object.__setattr__(self, "lost_from", LOST_FROM)


def test_large_residuals_pull_by_the_slope_of_what_they_leave() -> None:
    level, step = Tempered(), 1e-6
    for off in (-9.0, -1.0, 0.5, 2.2, 3.0, 8.0):
        ahead, behind = (level.tempered(np.array([off + way])) for way in (step, -step))
        (weight,) = level.weights_of(np.array([off]))
        assert_allclose((ahead - behind) / (2 * step), 2 * weight * off, rtol=1e-4)
