"""What a method's process is told when it asks."""

from __future__ import annotations

from functools import cached_property
from typing import Any, Final

from xden1k.errors import DataError
from xden1k.folder import DatasetFolder
from xden1k.format.records import decode_target
from xden1k.predictor import SampleView
from xden1k.values.modality import Modality
from xden_bench.methods.running import Options
from xden_bench.methods.scope import Task

__all__ = ["SHOWN", "Answers"]

SHOWN: Final = tuple(
    name
    for name, attribute in vars(SampleView).items()
    if isinstance(attribute, cached_property) and not name.startswith("_")
)
"""Attributes of a sample that can be asked for."""


class Answers:
    """Answers within what a method declared, whatever it asks.

    Parameters
    ----------
    folder
        The dataset.
    task
        Its ``ids`` and ``train_ids`` are the objects that may be asked about.
    reads
        What the method declared.
    options
        How it is run.
    """

    def __init__(
        self, folder: DatasetFolder, task: Task, reads: Modality, options: Options
    ) -> None:
        self._folder, self._reads, self._options = folder, reads, options
        self._train_ids = frozenset(task.train_ids)
        self._ids = self._train_ids | frozenset(task.ids)
        self._latest: SampleView | None = None

    def __call__(self, what: str, object_id: str = "", name: str = "") -> Any:
        """Return what was asked for.

        Parameters
        ----------
        what
            ``sample``, an attribute of an object as the method may see it; ``density`` or
            ``truth``, of an object to learn from; ``command``.
        object_id, name
            Of which object, which attribute.

        Raises
        ------
        ModalityError
            If the attribute needs what was not declared.
        DataError
            If it is none of these, or the dataset does not hold it.
        """
        if what == "command":
            return self._options.command
        if what == "sample" and object_id in self._ids and name in SHOWN:
            return getattr(self._sample(object_id), name)
        if what == "density" and object_id in self._train_ids:
            target = self._options.target
            return decode_target(self._folder.row(object_id, [target]), object_id, target)
        if what == "truth" and object_id in self._train_ids:
            return self._folder.object(object_id)
        asked = " ".join(filter(None, (what, name, object_id)))
        raise DataError(f"the method asked for what it is not shown: {asked[:120]!a}")

    def _sample(self, object_id: str) -> SampleView:
        """Return the object that was asked about last, or another; what was read of it is kept."""
        if self._latest is None or self._latest.object_id != object_id:
            pictures, target = self._options.pictures, self._options.target
            self._latest = SampleView(self._folder, object_id, self._reads, pictures, target)
        return self._latest
