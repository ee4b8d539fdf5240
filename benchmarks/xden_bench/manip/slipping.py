"""The slip ratio beside what picks in simulation did, by one contact patch for all of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from xden_bench.manip.closed_forms import slip_ratio
from xden_bench.manip.item import Item
from xden_bench.manip.rows import ObjectRow, Row, TrialRow
from xden_bench.manip.scenes import Scenes

__all__ = ["CAUSES", "SlipCheck", "SlipTrial", "fitted_radius_cm", "slip_check", "slip_trials"]

RADII_CM: Final = np.arange(0.1, 3.01, 0.1)
"""Effective radii of a patch among which one is chosen."""
NEAR: Final = 0.1
"""By how much a ratio may miss 1 and decide nothing."""
BESIDE_CM: Final = 2.0
"""Along the closing axis: a weight further from the pads turns them about another axis."""
CAUSES: Final = {
    "near": "within 10 % of the limit",
    "beside": "lost, its weight over 2 cm beside the pads along the closing axis: no torsion",
    "turned": "lost by turning in the hand",
    "dropped": "lost out of the hand",
    "caught": "held, by more than torsion",
}
"""What is behind a disagreement: the first that is true."""


@dataclass(frozen=True, slots=True)
class SlipTrial:
    """One trial, as far as the slip ratio goes.

    Parameters
    ----------
    object_id, mass_g
        Of the object.
    trial
        Of a row.
    beside_cm
        How far the centre of mass is from the pads along the closing axis.
    """

    object_id: str
    mass_g: float
    trial: TrialRow
    beside_cm: float

    def ratio(self, radius_cm: float) -> float:
        """Slip ratio by a patch."""
        one = self.trial
        return slip_ratio(self.mass_g, one.grip_force_n, one.friction, one.lever_cm, radius_cm)

    def agrees(self, radius_cm: float) -> bool:
        """Whether it was held as foretold, or lost as foretold."""
        return (self.ratio(radius_cm) < 1) == self.trial.is_held

    def cause(self, radius_cm: float) -> str:
        """Key of :data:`CAUSES`, of a trial that disagrees."""
        if abs(self.ratio(radius_cm) - 1) <= NEAR:
            return "near"
        if self.trial.is_held:
            return "caught"
        if self.beside_cm > BESIDE_CM:
            return "beside"
        return "turned" if self.trial.outcome == "rotated" else "dropped"


@dataclass(frozen=True, slots=True)
class SlipCheck:
    """How the slip ratio compares with trials.

    Parameters
    ----------
    radius_cm
        Effective, of the contact patch.
    trials
        How many different ones.
    agreement
        Share of them.
    causes
        Of the others: how many, by :data:`CAUSES`.
    by_object
        How many of its trials disagree, and of how many; objects that agree in all are left out.
    """

    radius_cm: float
    trials: int
    agreement: float
    causes: Mapping[str, int]
    by_object: Mapping[str, tuple[int, int]]


def slip_trials(scenes: Scenes, rows: Sequence[Row]) -> tuple[SlipTrial, ...]:
    """Every different trial of rows: those that several rows share count once.

    Raises
    ------
    DataError
        If the rows are of other scenes, or with the mass spread evenly.
    """
    scenes.refuse_others(rows[0].facts, homogeneous=False)
    items = {item.object_id: item for item in scenes.items()}
    trials = {
        (one.object_id, trial.regime, trial.draw, trial.candidate): (one, trial)
        for row in rows
        for one in row.objects
        for trial in one.trials
    }
    return tuple(_slip_trial(items[one.object_id], one, trial) for one, trial in trials.values())


def _slip_trial(item: Item, one: ObjectRow, trial: TrialRow) -> SlipTrial:
    (com_cm,) = item.rest.to_world(item.mass.com_cm[None])
    arm_cm = com_cm - item.grasps.centre_cm[trial.candidate]
    beside_cm = float(abs(arm_cm @ item.grasps.closing[trial.candidate]))
    return SlipTrial(one.object_id, one.mass_g, trial, beside_cm)


def fitted_radius_cm(trials: Collection[SlipTrial]) -> float:
    """Radius that agrees with most trials, the least of equal ones."""
    shares = [sum(one.agrees(radius) for one in trials) for radius in RADII_CM]
    return round(float(RADII_CM[int(np.argmax(shares))]), 1)


def slip_check(trials: Collection[SlipTrial], radius_cm: float) -> SlipCheck:
    """Compare trials, of which there is one at least, with the slip ratio by a radius."""
    wrong = [one for one in trials if not one.agrees(radius_cm)]
    counts = Counter(one.object_id for one in trials)
    causes = Counter(one.cause(radius_cm) for one in wrong)
    return SlipCheck(
        radius_cm,
        len(trials),
        1 - len(wrong) / len(trials),
        {name: causes[name] for name in CAUSES},
        {
            name: (count, counts[name])
            for name, count in Counter(one.object_id for one in wrong).most_common()
        },
    )
