"""Rows: what came of one method or control, a JSON file each. All of it is simulated."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Bool, Float64

from xden1k.errors import DataError
from xden_bench.manip.item import Stratum
from xden_bench.manip.outcome import Outcome

__all__ = ["SCHEMA", "ObjectRow", "Row", "TrialRow", "read_joined_rows", "read_rows"]

SCHEMA: Final = 2
DIGITS: Final = 6
"""Of a number of a trial, after the point."""
SAME: Final = ("schema", "scenes_sha256", "protocol", "mujoco", "tier", "varied", "homogeneous")
"""What rows of one table agree on."""


@dataclass(frozen=True, slots=True)
class TrialRow:
    """One trial of a row.

    Parameters
    ----------
    regime, draw
        Which.
    friction, grip_force_n
        Of the draw.
    candidate
        Index of the grasp.
    score, width_cm, height_cm
        Of the grasp: by shape alone, between the contacts, above the table.
    lever_cm
        With which the true weight turns the object about the closing axis.
    outcome, wrist_moment_nm, turn_deg, warnings
        As in :class:`xden_bench.manip.trial.Trial`.
    """

    regime: str
    draw: int
    friction: float
    grip_force_n: float
    candidate: int
    score: float
    width_cm: float
    height_cm: float
    lever_cm: float
    outcome: Outcome
    wrist_moment_nm: float
    turn_deg: float
    warnings: int

    @property
    def is_held(self) -> bool:
        """Whether it is a success."""
        return self.outcome == "held"


@dataclass(frozen=True, slots=True)
class ObjectRow:
    """One object of a row.

    Parameters
    ----------
    object_id, category, stratum, mass_g
        Of the object.
    axial_error_cm
        Of the centre that was taken, along the longest axis; None where none was.
    trials
        In the order of regimes and draws.
    """

    object_id: str
    category: str
    stratum: Stratum
    mass_g: float
    axial_error_cm: float | None
    trials: tuple[TrialRow, ...]

    def columns(self) -> dict[str, Any]:
        """Return it as a file has it: a list for each number of its trials, rounded."""
        trials = {
            name: [_rounded(getattr(trial, name)) for trial in self.trials]
            for name in TrialRow.__slots__
        }
        return {**asdict(self), "trials": trials}

    @classmethod
    def of_columns(cls, values: Mapping[str, Any]) -> ObjectRow:
        """Return what :meth:`columns` wrote.

        Raises
        ------
        KeyError, TypeError, ValueError
            If it is not that.
        """
        columns = values["trials"]
        trials = zip(*(columns[name] for name in TrialRow.__slots__), strict=True)
        return cls(**{**values, "trials": tuple(TrialRow(*one) for one in trials)})


def _rounded(value: Any) -> Any:
    return round(value, DIGITS) if isinstance(value, float) else value


@dataclass(frozen=True, slots=True)
class Row:
    """What came of one method or control.

    Parameters
    ----------
    name
        Of it.
    facts
        All else that the file says.
    objects
        In the order of the scenes.
    """

    name: str
    facts: Mapping[str, Any]
    objects: tuple[ObjectRow, ...]

    @property
    def is_submission(self) -> bool:
        """Whether it is a method's row, and no control's."""
        return bool(self.facts["submission_sha256"])

    def held(self, stratum: Stratum) -> Bool[np.ndarray, "objects trials"]:
        """Successes on a stratum, shape (objects, trials)."""
        return np.array([[one.is_held for one in trials] for trials in self._trials(stratum)])

    def figures(self, stratum: Stratum, name: str) -> Float64[np.ndarray, "objects trials"]:
        """Return a number of each trial of a stratum, shape (objects, trials)."""
        return np.array(
            [[float(getattr(one, name)) for one in trials] for trials in self._trials(stratum)]
        )

    def axial_errors_cm(self, stratum: Stratum) -> Float64[np.ndarray, "objects"]:
        """Shape (objects,): not a number where no centre was taken."""
        errors = [one.axial_error_cm for one in self.objects if one.stratum == stratum]
        return np.array([np.nan if one is None else one for one in errors])

    def _trials(self, stratum: Stratum) -> list[tuple[TrialRow, ...]]:
        return [one.trials for one in self.objects if one.stratum == stratum]


def read_rows(paths: Sequence[Path]) -> tuple[Row, ...]:
    """Read rows that belong into one table.

    Raises
    ------
    DataError
        If a file is no row, two are of one name, or they are of different scenes or variants.
    """
    rows = [_read(path) for path in paths]
    _refuse_unlike(paths, rows, SAME)
    _refuse_twice([row.name for row in rows])
    return tuple(rows)


def read_joined_rows(paths: Sequence[Path]) -> tuple[Row, ...]:
    """Read rows of tables of several splits of one dataset, and join those of one name.

    Raises
    ------
    DataError
        If a file is no row, a name is missing in one of the tables or twice in it, an object is in
        two, or they are of different datasets or variants.
    """
    rows = [_read(path) for path in paths]
    _refuse_unlike(paths, rows, [name for name in SAME if name != "scenes_sha256"])
    tables: dict[str, list[Row]] = {}
    for path, row in zip(paths, rows, strict=True):
        if (found := _dataset(row)) != _dataset(rows[0]):
            raise DataError(f"{path}: of another dataset, {found}, than {paths[0]}")
        tables.setdefault(row.facts["scenes_sha256"], []).append(row)
    for table in tables.values():
        _refuse_twice([row.name for row in table])
    return tuple(_joined(name, tables.values()) for name in dict.fromkeys(row.name for row in rows))


def _dataset(row: Row) -> str:
    digest: str = row.facts["dataset"]["manifest_sha256"]
    return digest


def _joined(name: str, tables: Iterable[Sequence[Row]]) -> Row:
    """Join the rows of one name, of each table."""
    found = []
    for table in tables:
        same = [row for row in table if row.name == name]
        if not same:
            split = table[0].facts["dataset"]["split"]
            raise DataError(f"no row of {name!r} beside {table[0].name!r} of the split {split!r}")
        found += same
    objects = tuple(one for row in found for one in row.objects)
    ids = [one.object_id for one in objects]
    if twice := {one for one in ids if ids.count(one) > 1}:
        raise DataError(f"{min(twice)!r} is in two of the tables: they are not joined")
    splits = [row.facts["dataset"]["split"] for row in found]
    return Row(name, {**found[0].facts, "joined": splits}, objects)


def _refuse_unlike(paths: Sequence[Path], rows: Sequence[Row], names: Sequence[str]) -> None:
    for path, row in zip(paths, rows, strict=True):
        for name in names:
            if row.facts[name] != rows[0].facts[name]:
                raise DataError(
                    f"{path}: {name} is {row.facts[name]!r}, in {paths[0]} "
                    f"{rows[0].facts[name]!r}: no rows of one table"
                )


def _refuse_twice(names: Sequence[str]) -> None:
    if twice := {name for name in names if names.count(name) > 1}:
        raise DataError(f"two rows of the name {min(twice)!r}")


def _read(path: Path) -> Row:
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
        objects = tuple(map(ObjectRow.of_columns, values.pop("objects")))
        row = Row(values["method"], values, objects)
        missing = [name for name in (*SAME, "dataset") if name not in values]
    except (ValueError, KeyError, TypeError, AttributeError) as err:
        raise DataError(f"{path}: expected a row, from `xden-bench manip run`: {err}") from err
    if missing:
        raise DataError(f"{path}: expected a row, from `xden-bench manip run`; no {missing[0]!r}")
    return row
