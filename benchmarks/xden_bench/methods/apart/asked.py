"""What a method sees in its own process: samples and examples that ask for what they show."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, cast

from xden1k.predictions import Target
from xden1k.predictor import Example, Examples, SampleView
from xden1k.values.arrays import Grid
from xden1k.values.modality import Modality
from xden1k.values.types import DensityObject
from xden_bench.methods.apart.answers import SHOWN
from xden_bench.methods.scope import TRAIN, Task

__all__ = ["Ask", "AskedExamples", "AskedSample", "AskingScope"]

Ask = Callable[..., Any]
"""Called as :class:`xden_bench.methods.apart.answers.Answers` is."""


class AskedSample:
    """An object as :class:`xden1k.predictor.SampleView` shows it, without the dataset behind it.

    Parameters
    ----------
    object_id, reads, target
        As there. Another ``reads`` opens nothing: the other process knows what was declared.
    ask
        Gives an attribute when it is touched.
    """

    def __init__(self, object_id: str, reads: Modality, target: Target, ask: Ask) -> None:
        self.object_id, self.reads, self.target = object_id, reads, target
        self._ask = ask

    def __getattr__(self, name: str) -> Any:
        if name not in SHOWN:
            raise AttributeError(f"a sample has no {name!r}; it shows {sorted(SHOWN)}")
        value = self._ask("sample", self.object_id, name)
        setattr(self, name, value)  # asked once
        return value


@dataclass(frozen=True, slots=True, eq=False)
class _AskedExample:
    """What a method learns from, as :class:`xden1k.predictor.Example`."""

    sample: AskedSample
    density_g_cm3: Grid
    ask: Ask

    @property
    def truth(self) -> DensityObject:
        """Everything known of a training object."""
        known: DensityObject = self.ask("truth", self.sample.object_id)
        return known


class AskedExamples:
    """Training objects, as :class:`xden1k.predictor.Examples`; one in memory at a time.

    Parameters
    ----------
    ids
        Of its objects.
    reads, target
        As there.
    ask
        Gives what is asked for.
    """

    split = TRAIN

    def __init__(self, ids: tuple[str, ...], reads: Modality, target: Target, ask: Ask) -> None:
        self.reads, self.target = reads, target
        self._ids, self._ask = ids, ask

    def __len__(self) -> int:
        return len(self._ids)

    def __iter__(self) -> Iterator[Example]:
        yield from self.only(range(len(self)))

    def only(self, numbers: Iterable[int]) -> Iterator[Example]:
        """Go through some of them, by their places; no other is read."""
        for object_id in [self._ids[number] for number in sorted(set(numbers))]:
            density = self._ask("density", object_id)
            sample = AskedSample(object_id, self.reads, self.target, self._ask)
            yield cast(Example, _AskedExample(sample, density, self._ask))


@dataclass(frozen=True, slots=True)
class AskingScope:
    """A dataset that lies on the other side.

    Parameters
    ----------
    task
        What is to be predicted.
    reads, target
        As the method declared, and what it predicts.
    ask
        Gives what is asked for.
    """

    task: Task
    reads: Modality
    target: Target
    ask: Ask

    def sample(self, object_id: str) -> SampleView:
        """Return an object as the method may see it."""
        return cast(SampleView, AskedSample(object_id, self.reads, self.target, self.ask))

    def train(self) -> Examples:
        """Return what the method may learn from.

        Raises
        ------
        DataError
            If there is nothing.
        """
        ids = self.task.learned_from
        return cast(Examples, AskedExamples(ids, self.reads, self.target, self.ask))

    def command(self) -> str:
        """Return the command that runs this again."""
        command: str = self.ask("command")
        return command
