"""A method that looks for the truth wherever it could lie in its own process."""

from __future__ import annotations

import dataclasses
import gc
import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from xden1k.errors import XDenError
from xden1k.folder import DatasetFolder
from xden1k.predictor import SampleView
from xden1k.values.modality import Modality

ROOT_NAME = "the-dataset"
"""The folder's name, which the process must nowhere have in its memory or environment."""


def _folder(sample: Any, train: Any) -> Any:
    return sample.folder.row(sample.object_id, ["density"])


def _replaced(sample: Any, train: Any) -> Any:
    return dataclasses.replace(sample, reads=Modality.TRUTH).truth


def _private(sample: Any, train: Any) -> Any:
    return sample._object.density


def _training_folder(sample: Any, train: Any) -> Any:
    return train.folder.object(sample.object_id)


def _written_reads(sample: Any, train: Any) -> Any:
    sample.reads = ~Modality.NONE
    return sample.truth


def _rebuilt(sample: Any, train: Any) -> Any:
    return SampleView(sample.folder, sample.object_id, Modality.TRUTH).truth


def _as_training(sample: Any, train: Any) -> Any:
    return sample._ask("truth", sample.object_id)


def _as_training_density(sample: Any, train: Any) -> Any:
    return sample._ask("density", sample.object_id)


def _row(sample: Any, train: Any) -> Any:
    return sample._ask("sample", sample.object_id, "_row")


def _parts(sample: Any, train: Any) -> Any:
    return sample.part_materials


def _memory(sample: Any, train: Any) -> Any:
    """Every dataset folder that is in memory, and every text that names one."""
    found = [one for one in gc.get_objects() if isinstance(one, DatasetFolder)]
    held = (text for one in gc.get_objects() for text in gc.get_referents(one))
    texts = {str(text) for text in held if isinstance(text, str | Path)} - {ROOT_NAME}
    return found + [text for text in texts if ROOT_NAME in text]


def _environment(sample: Any, train: Any) -> Any:
    return [one for one in (*os.environ.values(), *sys.argv) if ROOT_NAME in one]


def _parent_of_a_path(sample: Any, train: Any) -> Any:
    paths = [one for one in vars(sample).values() if isinstance(one, Path)]
    return [child for path in paths for child in path.parent.iterdir()]


ATTACKS: dict[str, Callable[[Any, Any], Any]] = {
    one.__name__: one
    for one in (
        _folder,
        _replaced,
        _private,
        _training_folder,
        _written_reads,
        _rebuilt,
        _as_training,
        _as_training_density,
        _row,
        _parts,
        _memory,
        _environment,
        _parent_of_a_path,
    )
}


class Spy:
    """Declares the outer surface, learns, and tries each attack on its first object."""

    name, version, reads = "spy", "1", Modality.GEOMETRY
    trainable, external_data = True, False
    notes = ""

    def __init__(self, told: str) -> None:
        self._told = Path(told)

    def fit(self, train: Any, *, seed: int) -> None:
        self._train = train
        self._learned = [(one.density_g_cm3.sum(), one.truth.mass_g) for one in train]

    def predict(self, sample: Any) -> Any:
        if not self._told.exists():
            outcomes = {name: self._try(attack, sample) for name, attack in ATTACKS.items()}
            outcomes["learned"] = str(len(self._learned))
            self._told.write_text(json.dumps(outcomes))
        sys.stdout.write("this line must not end in the pipe\n")
        return sample.envelope

    def _try(self, attack: Callable[[Any, Any], Any], sample: Any) -> str:
        try:
            found = attack(sample, self._train)
        except (AttributeError, TypeError, XDenError) as err:
            return f"refused: {type(err).__name__}"
        return f"found {found!r}"[:200] if len(found) else "nothing"


class Crashing(Spy):
    """Has a fault of its own."""

    def predict(self, sample: Any) -> Any:
        raise ZeroDivisionError("a fault of the method")


class Dying(Spy):
    """Is killed, once, at its third object."""

    def predict(self, sample: Any) -> Any:
        seen = self._told.read_text() if self._told.exists() else ""
        self._told.write_text(seen + "x")
        if len(seen) == 2:
            os.kill(os.getpid(), 9)
        return sample.envelope


class Understating(Spy):
    """Declares less in its file than it is shown."""

    reads = Modality.GEOMETRY | Modality.PARTS

    def predict(self, sample: Any) -> Any:
        type(self).reads = Modality.GEOMETRY
        return sample.envelope * sample.occupancy
