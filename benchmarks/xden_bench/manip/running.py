"""Trying rows on the same candidates and draws, in as many goes as it takes.

A trial depends on its object, regime, draw and candidate, not on who chose it: rows that choose
alike share it. What is done is kept beside the rows until all are there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float64

from xden1k.errors import DataError, did_you_mean
from xden1k.values.mass import MassProperties
from xden_bench.manip.choosing import Chooser, candidate_of
from xden_bench.manip.draws import Draw
from xden_bench.manip.item import Item
from xden_bench.manip.outcome import OUTCOMES, Trial
from xden_bench.manip.protocol import ManipProtocol, SolverRules
from xden_bench.manip.row_files import write_row
from xden_bench.manip.rows import TrialRow
from xden_bench.manip.scene import gripper_scene
from xden_bench.manip.scenes import Scenes
from xden_bench.manip.trial import pick
from xden_bench.methods.partial import Facts, Kept, PartialRun, code_sha256, partial_run
from xden_bench.scoring.submission import Progress

__all__ = ["Tries", "Variant", "run_rows", "varied"]

KEPT_NAME: Final = "rows"
Figures = Float64[np.ndarray, "choosers trials figures"]
"""Of a trial: place of the outcome, wrist moment, turn, warnings."""


@dataclass(frozen=True, slots=True)
class Variant:
    """How a run departs from the protocol; a row says so, and a table is of one variant.

    Parameters
    ----------
    solver
        Numbers of the table [solver] that are others.
    friction_scale
        Of the friction of every draw.
    homogeneous
        Whether the objects' mass is spread evenly: then no centre of mass is worth more than the
        centroid.
    """

    solver: Mapping[str, float]
    friction_scale: float = 1.0
    homogeneous: bool = False

    @property
    def numbers(self) -> dict[str, float]:
        """Every number that is another, by name."""
        scale = {"friction_scale": self.friction_scale} if self.friction_scale != 1 else {}
        return {**self.solver, **scale}


def varied(rules: ManipProtocol, variant: Variant) -> ManipProtocol:
    """Return the protocol with a variant's numbers.

    Raises
    ------
    DataError
        If one is none of the table [solver].
    """
    known = [name for name in SolverRules.__slots__ if name not in ("solref", "solimp")]
    for name in variant.solver:
        if name not in known:
            raise DataError(f"[solver] has no number {name!r}{did_you_mean(name, known)}")
    kinds = {name: type(getattr(rules.solver, name)) for name in variant.solver}
    numbers = {name: kinds[name](value) for name, value in variant.solver.items()}
    return replace(rules, solver=replace(rules.solver, **numbers))


@dataclass(frozen=True, slots=True)
class Tries:
    """Rows to be made.

    Parameters
    ----------
    scenes
        The objects.
    choosers
        Who takes which candidate.
    variant
        How the run departs from the protocol.
    """

    scenes: Scenes
    choosers: Sequence[Chooser]
    variant: Variant

    @property
    def rules(self) -> ManipProtocol:
        """The protocol, as it is varied."""
        return varied(self.scenes.rules, self.variant)

    @property
    def identity(self) -> dict[str, Any]:
        """All that the trials depend on."""
        return {
            "scenes": self.scenes.sha256,
            "choosers": [[one.name, one.submission_sha256] for one in self.choosers],
            "varied": self.variant.numbers,
            "homogeneous": self.variant.homogeneous,
            "code": code_sha256(Variant),
        }

    def mass(self, item: Item) -> MassProperties:
        """Mass properties that an object is tried with."""
        return item.homogeneous if self.variant.homogeneous else item.mass

    def draw(self, item: Item, regime: str, number: int) -> Draw:
        """Conditions of a trial."""
        draw = item.draws[regime][number]
        return replace(draw, friction=draw.friction * self.variant.friction_scale)

    def candidate(self, chooser: Chooser, item: Item, regime: str, number: int) -> int:
        """Index of the candidate that a chooser takes in a trial."""
        key = self.scenes.rules.seed, item.object_id, "random", regime, number
        return candidate_of(chooser, item, key)

    def tried(self, object_id: str) -> Figures:
        """Try one object by every chooser."""
        item, rules = self.scenes.item(object_id), self.rules
        model = gripper_scene(item.hulls, self.mass(item), rules).compile()

        @cache
        def figures(regime: str, number: int, candidate: int) -> list[float]:
            grasp, width_cm = item.grasps.pose(candidate), float(item.grasps.width_cm[candidate])
            draw = self.draw(item, regime, number)
            return _figures(pick(model, item.rest, grasp, width_cm, draw, rules))

        return np.array(
            [
                [figures(*trial, self.candidate(chooser, item, *trial)) for trial in _trials(item)]
                for chooser in self.choosers
            ]
        )

    def row(self, place: int, figures: Sequence[Figures]) -> list[tuple[TrialRow, ...]]:
        """Trials of every object by one chooser."""
        return [
            tuple(
                self._trial(item, self.choosers[place], regime, number, values)
                for (regime, number), values in zip(_trials(item), found[place], strict=True)
            )
            for item, found in zip(self.scenes.items(), figures, strict=True)
        ]

    def _trial(
        self,
        item: Item,
        chooser: Chooser,
        regime: str,
        number: int,
        values: Float64[np.ndarray, "figures"],
    ) -> TrialRow:
        draw = self.draw(item, regime, number)
        candidate = self.candidate(chooser, item, regime, number)
        place, moment_nm, turn_deg, warnings = values.tolist()
        return TrialRow(
            regime=regime,
            draw=number,
            friction=draw.friction,
            grip_force_n=draw.grip_force_n,
            candidate=candidate,
            score=float(item.grasps.score[candidate]),
            width_cm=float(item.grasps.width_cm[candidate]),
            height_cm=float(item.grasps.centre_cm[candidate, 2]),
            lever_cm=item.lever_cm(candidate, self.mass(item).com_cm),
            outcome=OUTCOMES[int(place)],
            wrist_moment_nm=moment_nm,
            turn_deg=turn_deg,
            warnings=int(warnings),
        )


def run_rows(
    tries: Tries,
    out: Path,
    facts: Mapping[str, Any],
    workers: int = 1,
    progress: Progress = iter,
) -> tuple[Path, ...]:
    """Try every chooser on every object, and write a row of each.

    Parameters
    ----------
    tries
        What is tried.
    out
        Folder of the rows.
    facts
        More that each row says: how it was made.
    workers
        Processes.
    progress
        Goes through the objects that are left to do.

    Returns
    -------
    tuple of Path
        The rows, in the order of the choosers.

    Raises
    ------
    DataError
        If another process is writing rows there, two choosers have one name, or a number that is
        varied is none.
    """
    _refuse_twice([chooser.name for chooser in tries.choosers])
    variant = tries.variant
    numbers = {**tries.scenes.varied, **variant.numbers}
    said = {**facts, "varied": numbers, "homogeneous": variant.homogeneous}
    out.mkdir(parents=True, exist_ok=True)
    with partial_run(out / KEPT_NAME, tries.identity) as partly:
        figures = _figures_of_all(tries, partly, workers, progress)
        return tuple(
            write_row(out, tries.scenes, chooser, tries.row(place, figures), said)
            for place, chooser in enumerate(tries.choosers)
        )


def _refuse_twice(names: Sequence[str]) -> None:
    if twice := {name for name in names if names.count(name) > 1}:
        raise DataError(f"two rows of the name {min(twice)!r}: run one at a time")


def _figures_of_all(
    tries: Tries, partly: PartialRun, workers: int, progress: Progress
) -> list[Figures]:
    """Take up the objects that are done, and try the others."""
    figures: list[Figures] = [partly.read(place).arrays["values"] for place in range(partly.count)]
    left = tries.scenes.ids[len(figures) :]
    for _, found in zip(progress(left), _mapped(tries.tried, left, workers), strict=True):
        partly.keep(len(figures), Kept({"values": found}, Facts(0.0)))
        figures.append(found)
    return figures


def _mapped(tried: Callable[[str], Figures], ids: Sequence[str], workers: int) -> Iterator[Figures]:
    """Try objects in their order, here or in processes of their own."""
    if workers == 1 or len(ids) < 2:
        yield from map(tried, ids)
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        yield from pool.map(tried, ids)


def _trials(item: Item) -> list[tuple[str, int]]:
    """Regime and number of each trial."""
    return [(name, number) for name, draws in item.draws.items() for number in range(len(draws))]


def _figures(trial: Trial) -> list[float]:
    place = OUTCOMES.index(trial.outcome)
    return [place, trial.wrist_moment_nm, trial.turn_deg, trial.warnings]
