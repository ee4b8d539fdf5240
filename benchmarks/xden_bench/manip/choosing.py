"""Which candidate a method or a control takes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from xden1k.errors import DataError
from xden1k.predictions import Predictions, raise_errors
from xden1k.values.arrays import Vec3
from xden_bench.manip.draws import keyed_generator
from xden_bench.manip.grasps import nearest
from xden_bench.manip.item import Item
from xden_bench.manip.protocol import ManipProtocol
from xden_bench.scoring.metrics import integrate
from xden_bench.scoring.protocol import load_protocol
from xden_bench.scoring.reference import Reference
from xden_bench.scoring.submission import Check, Progress

__all__ = ["Chooser", "candidate_of", "controls", "submitted"]

Rule = Literal["top", "random", "nearest"]


@dataclass(frozen=True, slots=True, eq=False)
class Chooser:
    """A row: how it takes a candidate of each object.

    Parameters
    ----------
    name
        Of the method or control.
    rule
        ``top`` takes the best score, ``random`` any, ``nearest`` the one nearest to a centre.
    centres_cm
        That centre by object, in the object's frame, shape (3,); none for other rules.
    without_mass
        Objects of which the method predicts no mass: their centre is the envelope's centroid.
    inputs
        What the method looks at, by the names of a submission.
    submission_sha256, submission_command
        Of the method's file, and what made it; empty for a control.
    """

    name: str
    rule: Rule
    centres_cm: Mapping[str, Vec3]
    without_mass: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    submission_sha256: str = ""
    submission_command: str = ""


def controls(items: Mapping[str, Item], rules: ManipProtocol) -> Iterator[Chooser]:
    """Every control: top score, random, uniform, true, and true shifted along the longest axis."""
    yield Chooser("top", "top", {})
    yield Chooser("random", "random", {})
    yield Chooser("uniform", "nearest", {name: one.uniform_cm for name, one in items.items()})
    for shift_cm in (0.0, *(sign * one for one in rules.shifts_cm for sign in (1, -1))):
        centres = {name: one.mass.com_cm + shift_cm * one.long_axis for name, one in items.items()}
        yield Chooser(f"true{shift_cm:+g}cm" if shift_cm else "true", "nearest", centres)


def submitted(
    path: Path, items: Mapping[str, Item], reference: Reference, progress: Progress = iter
) -> Chooser:
    """Take the centres of mass of a submission, integrated as its scores are.

    Parameters
    ----------
    path
        The ``preds.npz``.
    items
        Of the scenes.
    reference
        The split that they are of.
    progress
        Goes through ids.

    Raises
    ------
    SubmissionError
        With every problem of the file, as in scoring.
    """
    centres: dict[str, Vec3] = {}
    empty: list[str] = []
    with Predictions(path) as predictions:
        check = Check(predictions, reference, load_protocol(), progress=progress)
        for truth, grid, _ in check.fields():
            if truth.object_id in items:
                found = integrate(grid, truth.envelope, truth.origin_cm, truth.voxel_size_cm)
                centres[truth.object_id] = found.com_cm
                empty += [truth.object_id] if found.mass_g == 0 else []
        raise_errors(check.problems)
        meta = predictions.meta
        assert meta is not None
        return Chooser(
            meta.method,
            "nearest",
            centres,
            tuple(empty),
            meta.inputs,
            predictions.sha256,
            meta.command,
        )


def candidate_of(chooser: Chooser, item: Item, key: tuple[str | int, ...]) -> int:
    """Index of the candidate that is taken.

    Parameters
    ----------
    chooser, item
        Who takes one of whose candidates.
    key
        Of the trial, which decides for ``random``.
    """
    if chooser.rule == "top":
        return int(item.grasps.score.argmax())
    if chooser.rule == "random":
        return int(keyed_generator(*key).integers(len(item.grasps)))
    (centre_cm,) = item.rest.to_world(chooser.centres_cm[item.object_id][None])
    return nearest(item.grasps, centre_cm)


def by_name(choosers: Iterator[Chooser], names: tuple[str, ...]) -> tuple[Chooser, ...]:
    """Keep the choosers of some names, in the order of the names.

    Raises
    ------
    DataError
        If there is none of a name.
    """
    found = {one.name: one for one in choosers}
    if unknown := [name for name in names if name not in found]:
        raise DataError(f"no control {unknown[0]!r}; there are {list(found)}")
    return tuple(found[name] for name in names)
