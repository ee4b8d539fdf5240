"""Methods that keep count, stop half-way, or are run in a process that dies."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path
from typing import Any

import numpy as np

from xden1k.folder import open_folder
from xden1k.predictor import Budget, Examples, Prediction, SampleView
from xden1k.values.modality import Modality
from xden_bench.methods.running import run_predictor


class Counting:
    """Draws one number from its seed; keeps count of what is asked of it."""

    name, version, reads = "counting", "1", Modality.GEOMETRY
    trainable, external_data = True, False
    notes = ""
    fingerprint = "a"

    def __init__(self, dies_at: int | None = None, how: str = "raise") -> None:
        self.fits, self.asked = 0, list[str]()
        self.budget: Budget | None = None
        self.learned_from = list[str]()
        self.value = np.nan
        self._dies_at, self._how = dies_at, how

    def fit(self, train: Examples, *, seed: int, budget: Budget | None = None) -> None:
        self.fits += 1
        self.budget = budget
        self.learned_from = [example.sample.object_id for example in train]
        self.value = float(np.random.default_rng(seed).random())

    def predict(self, sample: SampleView) -> Any:
        if len(self.asked) == self._dies_at:
            if self._how == "kill":
                os.kill(os.getpid(), signal.SIGKILL)
            raise KeyboardInterrupt
        self.asked.append(sample.object_id)
        return np.float32(self.value) * sample.envelope


class Storing(Counting):
    """The same, and can store what it learned."""

    name = "storing"

    def save(self, folder: Path) -> None:
        (folder / "value.json").write_text(json.dumps(self.value))

    def load(self, folder: Path) -> None:
        self.value = json.loads((folder / "value.json").read_text())


class Talking(Counting):
    """Says all there is to say of a prediction."""

    name, trainable = "talking", False
    notes = "by heart"

    def __init__(self, answers: int = 20) -> None:
        super().__init__()
        self.answers = answers

    def predict(self, sample: SampleView) -> Prediction:
        self.asked.append(sample.object_id)
        first = len(self.asked) == 1
        return Prediction(
            sample.envelope,
            0.1 * sample.envelope,
            mass_native_g=7.0,
            model="replay:12ab" if first else "replay:34cd",
            answers=self.answers,
            fallbacks=2 if first else 0,
            device="cuda",
            remark="remembered",
        )


def run_and_die(root: str, out: str) -> None:
    """Be killed at the third object."""
    run_predictor(Storing(2, "kill"), open_folder(root), "test", Path(out))
