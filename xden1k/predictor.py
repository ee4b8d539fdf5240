"""What a method is to the benchmark: something that sees a sample and gives what is inside.

A :class:`Predictor` gives a density grid, a :class:`Segmenter` says which points belong together;
one class may be both. The benchmark finds methods by the entry-point group ``xden1k.predictors``;
each names a class that gives a method when called, without arguments or with settings by keyword.
Any package can add one. What only some can do is apart: :class:`Budgeted`, :class:`Storable`,
:class:`Fingerprinted`, and giving a :class:`Prediction` in place of an array.
"""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeGuard, runtime_checkable

import numpy as np
from jaxtyping import Float

from xden1k.access.samples import Example, Examples, PictureSource, SampleView
from xden1k.errors import DataError
from xden1k.segmentation import Segmentation, SegmentPoints
from xden1k.values.arrays import Grid
from xden1k.values.modality import Modality

__all__ = [
    "AsksAhead",
    "Budget",
    "Budgeted",
    "Example",
    "Examples",
    "Fingerprinted",
    "Illustrated",
    "Method",
    "PictureSource",
    "Prediction",
    "Predictor",
    "SampleView",
    "Segmenter",
    "Storable",
    "takes_budget",
]


@dataclass(frozen=True, slots=True)
class Budget:
    """How much training is allowed, in epochs, in seconds, or whichever ends first.

    A budget in seconds ends elsewhere on another machine: only epochs can be made again.

    Raises
    ------
    DataError
        If neither is given, or one is not positive.
    """

    epochs: int | None = None
    seconds: float | None = None

    def __post_init__(self) -> None:
        given = [value for value in (self.epochs, self.seconds) if value is not None]
        if not given or not all(0 < value < math.inf for value in given):
            raise DataError(f"a budget must be a positive number of epochs or seconds, got {self}")

    @classmethod
    def parse(cls, text: str) -> Budget:
        """Read ``20epochs`` or ``90s``.

        Raises
        ------
        DataError
            If it is neither.

        Examples
        --------
        >>> Budget.parse("20epochs"), Budget.parse("90s")
        (Budget(epochs=20, seconds=None), Budget(epochs=None, seconds=90.0))
        """
        if found := re.fullmatch(r"(\d{1,9}) ?epochs?", text):
            return cls(epochs=int(found[1]))
        if found := re.fullmatch(r"(\d{1,9}(?:\.\d{1,9})?) ?s", text):
            return cls(seconds=float(found[1]))
        raise DataError(f"a budget must be like 20epochs or 90s, got {text!r}")


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """A predicted density with what else is to be said of it.

    Parameters
    ----------
    density_g_cm3
        As :meth:`Predictor.predict` may give it alone.
    density_sd_g_cm3
        Standard deviation of the error that is expected, of the same shape; from a method that
        gives it for every object or for none.
    mass_native_g
        The mass by the method's own rule, where it has one: printed, never scored.
    model
        Which model answered: its id, or ``replay:HASH`` of recorded answers; empty if none.
    answers
        How many answers of a model it rests on, or would have.
    fallbacks
        For how many of them a substitute stood in.
    unanswered
        How many of them are missing, with nobody in their place.
    device
        Where it was computed.
    remark
        What else is to be said of this object, in words that others may share: the row counts them.
    """

    density_g_cm3: Grid | Float[np.ndarray, "parts"]
    density_sd_g_cm3: Grid | Float[np.ndarray, "parts"] | None = None
    mass_native_g: float | None = None
    model: str = ""
    answers: int = 0
    fallbacks: int = 0
    device: str = "cpu"
    remark: str = ""
    unanswered: int = 0


@runtime_checkable
class Method(Protocol):
    """What predictors and segmenters share.

    Attributes
    ----------
    name
        Display name, and by habit that of its entry point.
    version
        Raised whenever its predictions change.
    reads
        Everything it looks at; it decides the track.
    trainable
        True if :meth:`fit` learns from the training split.
    external_data
        True if it uses anything beyond this dataset, pretrained weights included.
    """

    name: str
    version: str
    reads: Modality
    trainable: bool
    external_data: bool

    @property
    def notes(self) -> str:
        """What a reader of its row must know, on one line; read after the last prediction.

        It follows from the fit alone: a run that goes on after an interruption does not predict
        every object again. What depends on the object is a :class:`Prediction`'s.
        """
        ...

    def fit(self, train: Examples, *, seed: int) -> None:
        """Learn from examples. Called once before the first answer, only if ``trainable``."""
        ...


@runtime_checkable
class Predictor(Method, Protocol):
    """A method that gives densities."""

    def predict(self, sample: SampleView) -> Grid | Float[np.ndarray, "parts"] | Prediction:
        """Predict the target in g/cm³.

        Voxel means of shape (64, 64, 64), 0 outside the envelope; or, by a method that reads
        ``PARTS``, one value for air and each part, shape (K + 1,); or a :class:`Prediction` with
        one of the two. The same sample gives the same values, whatever was predicted before.
        """
        ...


@runtime_checkable
class Segmenter(Method, Protocol):
    """A method that says which points inside an object belong together. It reads ``GEOMETRY``."""

    def segment(self, sample: SampleView, points: SegmentPoints) -> Segmentation:
        """Label points.

        The same sample and points give the same labels, whatever was asked before.

        Parameters
        ----------
        sample
            The object as the method may see it.
        points
            Inside its outer surface, enclosed cavities included.
        """
        ...


@runtime_checkable
class Budgeted(Method, Protocol):
    """A method that can be told how long to learn: :func:`takes_budget`."""

    def fit(self, train: Examples, *, seed: int, budget: Budget | None = None) -> None:
        """Learn from examples within a budget; None = the method's own."""
        ...


@runtime_checkable
class Storable(Protocol):
    """A method whose fit can be kept in a folder."""

    def save(self, folder: Path) -> None:
        """Write what :meth:`Predictor.fit` learned into an empty folder."""
        ...

    def load(self, folder: Path) -> None:
        """Take up what :meth:`save` wrote: predictions are the same as before, to the bit.

        Raises
        ------
        DataError
            If the folder does not hold it.
        """
        ...


@runtime_checkable
class Fingerprinted(Protocol):
    """A method that depends on more than its code, version and fit."""

    @property
    def fingerprint(self) -> str:
        """Checksum of what else it depends on: weights, recorded answers, settings.

        An interrupted run is continued only where it is the same.
        """
        ...


@runtime_checkable
class Illustrated(Protocol):
    """A method that reads ``RGB`` and brings its own pictures."""

    @property
    def pictures_of(self) -> PictureSource:
        """Where they come from."""
        ...


@runtime_checkable
class AsksAhead(Protocol):
    """A method that waits for others, as a chat model, and can ask for many objects at once."""

    def ask_ahead(self, samples: Iterator[SampleView]) -> None:
        """Ask all that will be asked for these samples, and keep the answers.

        Called before the first prediction. Samples are made one by one, as they are taken.
        """
        ...


def takes_budget(predictor: Method) -> TypeGuard[Budgeted]:
    """Whether a method is :class:`Budgeted`: its ``fit`` has a parameter ``budget``."""
    return "budget" in inspect.signature(predictor.fit).parameters
