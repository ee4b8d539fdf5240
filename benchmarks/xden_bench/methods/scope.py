"""What a run takes from a dataset: the objects to predict, samples of them, and examples."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from xden1k.errors import DataError
from xden1k.folder import DatasetFolder
from xden1k.predictions import Target
from xden1k.predictor import Examples, PictureSource, SampleView
from xden1k.values.modality import Modality

__all__ = ["FolderScope", "Scope", "Task"]

TRAIN = "train"
"""The split that is learned from."""


@dataclass(frozen=True, slots=True)
class Task:
    """What is to be predicted, and from which dataset.

    Parameters
    ----------
    split, ids
        The objects to predict.
    train_ids
        Those to learn from, all or some of the training split; empty where there are none.
    version, manifest_sha256
        Of the dataset.
    """

    split: str
    ids: tuple[str, ...]
    train_ids: tuple[str, ...]
    version: str
    manifest_sha256: str

    @classmethod
    def of(
        cls,
        folder: DatasetFolder,
        split: str,
        train_objects: int | None = None,
        seed: int = 0,
    ) -> Task:
        """Return the task of predicting a split of a dataset folder.

        Parameters
        ----------
        folder, split
            What is to be predicted.
        train_objects
            How many objects of the training split to learn from; None for all.
        seed
            Of their draw.

        Raises
        ------
        DataError
            If there is no such split, or it has not as many training objects.
        """
        train_ids = folder.ids(TRAIN) if TRAIN in folder.manifest.splits else ()
        if train_objects is not None:
            train_ids = _drawn(train_ids, train_objects, seed)
        return cls(
            split=split,
            ids=folder.ids(split),
            train_ids=train_ids,
            version=folder.manifest.version,
            manifest_sha256=folder.manifest_sha256,
        )

    @property
    def learned_from(self) -> tuple[str, ...]:
        """The objects to learn from.

        Raises
        ------
        DataError
            If there are none.
        """
        if not self.train_ids:
            raise DataError(f"the dataset has no split {TRAIN!r} to learn from")
        return self.train_ids


def _drawn(ids: Sequence[str], count: int, seed: int) -> tuple[str, ...]:
    """Those with the least checksums of seed and id: fewer are among more; in their order."""
    if not 1 <= count <= len(ids):
        raise DataError(
            f"the number of training objects must be from 1 to {len(ids)}, "
            f"all of the split {TRAIN!r}, got {count}"
        )

    def draw(object_id: str) -> bytes:
        return hashlib.sha256(f"{seed} {object_id}".encode()).digest()

    drawn = set(sorted(ids, key=draw)[:count])
    return tuple(one for one in ids if one in drawn)


@runtime_checkable
class Scope(Protocol):
    """The dataset as far as a run needs it."""

    @property
    def task(self) -> Task:
        """What is to be predicted."""
        ...

    def sample(self, object_id: str) -> SampleView:
        """Return an object as the method may see it."""
        ...

    def train(self) -> Examples:
        """Return what the method may learn from."""
        ...

    def command(self) -> str:
        """Return the command that runs this again; asked when all is predicted."""
        ...


@dataclass(frozen=True, slots=True)
class FolderScope:
    """A dataset folder in the process of the method, which could read all of it.

    Parameters
    ----------
    folder, task
        The dataset, and what of it is predicted.
    reads
        What the method declared.
    target
        ``density`` or ``apparent_density``.
    pictures
        Where colour pictures come from, if there are any.
    told_command
        That runs this again.
    """

    folder: DatasetFolder
    task: Task
    reads: Modality
    target: Target = "density"
    pictures: PictureSource | None = None
    told_command: str = ""

    def sample(self, object_id: str) -> SampleView:
        """Return an object as the method may see it."""
        return SampleView(self.folder, object_id, self.reads, self.pictures, self.target)

    def train(self) -> Examples:
        """Return what the method may learn from.

        Raises
        ------
        DataError
            If there is nothing.
        """
        ids = self.task.learned_from
        return Examples(self.folder, TRAIN, self.reads, self.target, self.pictures, ids)

    def command(self) -> str:
        """Return the command that runs this again."""
        return self.told_command
