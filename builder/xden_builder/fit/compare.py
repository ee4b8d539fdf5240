"""Levenberg-Marquardt against Adam on full frames, to the same loss."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from xden1k.rays import PathLengths
from xden1k.values.views import XRayView
from xden_builder.fit.adam import fit_lac_adam
from xden_builder.fit.lac import fit_lac
from xden_builder.fit.levenberg import minimise
from xden_builder.fit.problem import Problem
from xden_builder.fit.values import DEFAULT_ADAM, PAPER_OBJECTIVE, AdamSettings, LacFit
from xden_builder.fit.weighting import uniform

__all__ = ["SolverComparison", "compare_solvers"]


@dataclass(frozen=True, slots=True)
class SolverComparison:
    """Processor time of both solvers for the same loss.

    Parameters
    ----------
    lm_cpu_seconds, adam_cpu_seconds
        Time of the process, all threads, from path lengths and images to the finished fit.
    lm_loss, adam_loss
        Sum of squared residuals of transmission over both whole frames, computed alike.
    least_loss
        The smallest seen: of both, and of Levenberg-Marquardt started where Adam ended.
    lm_iterations, adam_steps
        Steps each took.
    """

    lm_cpu_seconds: float
    adam_cpu_seconds: float
    lm_loss: float
    adam_loss: float
    least_loss: float
    lm_iterations: int
    adam_steps: int

    @property
    def ratio(self) -> float:
        """How many times the processor time Adam needs."""
        return self.adam_cpu_seconds / self.lm_cpu_seconds

    @property
    def lm_excess(self) -> float:
        """Loss of Levenberg-Marquardt above the least, relative."""
        return self.lm_loss / self.least_loss - 1

    @property
    def adam_excess(self) -> float:
        """Loss of Adam above the least, relative."""
        return self.adam_loss / self.least_loss - 1


def compare_solvers(
    views: Sequence[tuple[PathLengths, XRayView]],
    adam: AdamSettings = DEFAULT_ADAM,
    loss_rtol: float = 1e-4,
    repeats: int = 5,
) -> SolverComparison:
    """Time both solvers on the paper's objective: whole frames, no weights, no gain.

    Levenberg-Marquardt runs to convergence, Adam until its loss is within ``loss_rtol`` of that.

    Parameters
    ----------
    views
        Path lengths, of one ray a pixel, and image of each view.
    adam
        Its settings; the target loss is set here.
    loss_rtol
        How much more than the least loss Adam may leave.
    repeats
        Levenberg-Marquardt takes milliseconds: the mean of so many runs.
    """
    best = fit_lac(views, PAPER_OBJECTIVE)  # also compiles
    lm_seconds, _ = _timed(lambda: [fit_lac(views, PAPER_OBJECTIVE) for _ in range(repeats)][-1])
    target = replace(adam, target_loss=best.loss * (1 + loss_rtol))
    fit_lac_adam(views, replace(target, max_steps=1))  # loads and warms up torch
    adam_seconds, slow = _timed(lambda: fit_lac_adam(views, target))
    return SolverComparison(
        lm_cpu_seconds=lm_seconds / repeats,
        adam_cpu_seconds=adam_seconds,
        lm_loss=best.loss,
        adam_loss=slow.loss,
        least_loss=min(best.loss, slow.loss, _loss_from(slow, views)),
        lm_iterations=best.iterations,
        adam_steps=slow.iterations,
    )


def _loss_from(fit: LacFit, views: Sequence[tuple[PathLengths, XRayView]]) -> float:
    """Where Levenberg-Marquardt ends from another start than its own."""
    problem = Problem.of(views, PAPER_OBJECTIVE, {})
    evaluate = partial(problem.evaluate, weighting=uniform(problem.views))
    start = np.append(np.nan_to_num(fit.lac_per_cm), fit.gain)
    bounds = problem.bounds(PAPER_OBJECTIVE)
    return minimise(evaluate, start, *bounds, PAPER_OBJECTIVE.max_iterations).evaluation.loss


def _timed(run: Callable[[], LacFit]) -> tuple[float, LacFit]:
    begin = time.process_time()
    result = run()
    return time.process_time() - begin, result
