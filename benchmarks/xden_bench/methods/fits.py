"""What a method learned: made once, kept in a folder, taken up again.

::

    FOLDER/fit.json   which method learned from what: a Fit
    FOLDER/state/     whatever the method saves
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from dataclasses import MISSING, asdict, dataclass, fields
from pathlib import Path
from typing import Any, Final

from xden1k.errors import DataError
from xden1k.predictions import Target
from xden1k.predictor import Budget, Examples, Method, Storable, takes_budget

__all__ = ["Fit", "fit_or_take_up", "load_fit", "read_fit"]

FIT_FILE: Final = "fit.json"
STATE_NAME: Final = "state"
SCHEMA: Final = "xden-fit/1"


@dataclass(frozen=True, slots=True)
class Fit:
    """What a fit depends on.

    Parameters
    ----------
    method, version, inputs
        Of the method.
    target, seed
        What was learned, and from which random numbers.
    budget
        Epochs and seconds allowed; None if the method's own.
    manifest_sha256
        Of the dataset whose training split it saw.
    code_sha256, fingerprint
        Of the code, and of whatever else the method depends on.
    pictures
        Where colour pictures came from.
    train_objects
        How many objects of the training split it saw, drawn by the seed; None for all.
    """

    method: str
    version: str
    inputs: tuple[str, ...]
    target: Target
    seed: int
    budget: Mapping[str, Any] | None
    manifest_sha256: str
    code_sha256: str
    fingerprint: str
    pictures: str = ""
    train_objects: int | None = None
    schema: str = SCHEMA

    def to_json(self) -> str:
        """Return the text of ``fit.json``."""
        return json.dumps(asdict(self), sort_keys=True, indent=2) + "\n"


def fit_or_take_up(
    predictor: Method, train: Examples, fit: Fit, budget: Budget | None, folder: Path
) -> None:
    """Let a method learn; where it can store what it learned, do so, or take it up if it is there.

    Parameters
    ----------
    predictor
        A trainable method.
    train
        What it learns from.
    fit, budget
        What the fit depends on.
    folder
        Where it is kept: complete or not at all.

    Raises
    ------
    DataError
        If the folder holds another fit, or the method takes no budget.
    """
    if not isinstance(predictor, Storable):
        _learn(predictor, train, fit.seed, budget)
        return
    if folder.exists():
        if (found := read_fit(folder)) != fit:
            raise DataError(f"{folder} holds another fit: {_difference(found, fit)}")
    else:
        _learn(predictor, train, fit.seed, budget)
        _save(predictor, fit, folder)
    # also after learning: a run goes on after a kill with the very state it began with
    predictor.load(folder / STATE_NAME)


def load_fit(predictor: Storable, wanted: Fit, folder: Path) -> Fit:
    """Take up what a method learned in another run, perhaps on another dataset.

    Parameters
    ----------
    predictor
        The method.
    wanted
        What a fit made here and now would be.
    folder
        Where the other is kept.

    Raises
    ------
    DataError
        If the folder holds no fit, or one of another method, version, inputs or target.
    """
    fit = read_fit(folder)
    found, expected = ((one.method, one.version, one.inputs, one.target) for one in (fit, wanted))
    if found != expected:
        raise DataError(f"{folder} holds the fit of {found}, expected {expected}")
    predictor.load(folder / STATE_NAME)
    return fit


def read_fit(folder: Path) -> Fit:
    """Read what a stored fit depends on.

    Raises
    ------
    DataError
        If the folder holds no fit.
    """
    path = folder / FIT_FILE
    if not path.is_file():
        raise DataError(f"{folder}: no fit there, it has no {FIT_FILE}")
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as err:
        raise DataError(f"{path}: not JSON: {err}") from err
    names = {field.name for field in fields(Fit)}
    needed = {field.name for field in fields(Fit) if field.default is MISSING} | {"schema"}
    if (
        not isinstance(values, dict)
        or not needed <= set(values) <= names
        or values["schema"] != SCHEMA
    ):
        raise DataError(f"{path}: must be {SCHEMA} with the keys {sorted(needed)}")
    return Fit(**{**values, "inputs": tuple(values["inputs"])})


def _learn(predictor: Method, train: Examples, seed: int, budget: Budget | None) -> None:
    if budget is None:
        predictor.fit(train, seed=seed)
    elif takes_budget(predictor):
        predictor.fit(train, seed=seed, budget=budget)
    else:
        raise DataError(f"the method {predictor.name} takes no budget")


def _save(predictor: Storable, fit: Fit, folder: Path) -> None:
    folder.parent.mkdir(parents=True, exist_ok=True)
    new = folder.with_name(f".{folder.name}.new")
    shutil.rmtree(new, ignore_errors=True)
    (new / STATE_NAME).mkdir(parents=True)
    predictor.save(new / STATE_NAME)
    (new / FIT_FILE).write_text(fit.to_json(), encoding="utf-8")
    new.rename(folder)


def _difference(found: Fit, wanted: Fit) -> str:
    one, other = asdict(found), asdict(wanted)
    return ", ".join(
        f"{key} {one[key]!r}, here {other[key]!r}" for key in one if one[key] != other[key]
    )
