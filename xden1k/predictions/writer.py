"""Writing ``preds.npz``: complete or not at all, and the same bytes for the same values."""

from __future__ import annotations

import os
import re
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Literal, TypeVar

import numpy as np
from jaxtyping import Float, Shaped

from xden1k.errors import DataError
from xden1k.predictions.archive import OBJECT_ID
from xden1k.predictions.meta import MethodMeta, SubmissionMeta, parse_meta
from xden1k.predictions.npz import write_member
from xden1k.predictions.problems import raise_errors
from xden1k.predictions.reader import GRID_SHAPE, MAX_VALUE, pooling

__all__ = ["PredictionsWriter", "SubmissionWriter", "write_predictions"]


Writer = TypeVar("Writer", bound="SubmissionWriter")


class SubmissionWriter:
    """Writes an archive object by object. The file appears when :meth:`finish` is called.

    Parameters
    ----------
    path
        The file to write. One that is there is replaced.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._seen: set[str] = set()
        path.parent.mkdir(parents=True, exist_ok=True)
        self._partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
        self._archive = zipfile.ZipFile(self._partial, "w")

    def __enter__(self: Writer) -> Writer:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._archive.close()
        self._partial.unlink(missing_ok=True)

    def finish(self, meta: MethodMeta) -> None:
        """Write the meta data and put the file in its place.

        Raises
        ------
        SubmissionError
            If the meta data break the format.
        """
        text = meta.to_json()
        raise_errors(parse_meta(text, type(meta))[1])
        write_member(self._archive, "__meta__", np.array(text))
        self._archive.close()
        self._partial.replace(self._path)

    def _check_id(self, object_id: str) -> None:
        """Refuse an id that no dataset has, or that came before."""
        if not re.fullmatch(OBJECT_ID, object_id):
            raise DataError(f"{self._path}: object id {object_id!a} must match {OBJECT_ID}")
        if object_id in self._seen:
            raise DataError(f"{self._path}: {object_id} was predicted twice")

    def _append(self, object_id: str, arrays: Mapping[str, Shaped[np.ndarray, "..."]]) -> None:
        """Append the arrays of an object, by the first part of their names."""
        self._seen.add(object_id)
        for name, array in arrays.items():
            write_member(self._archive, f"{name}/{object_id}", array)


class PredictionsWriter(SubmissionWriter):
    """Writes a ``preds.npz``.

    Parameters
    ----------
    path
        As in :class:`SubmissionWriter`.
    dtype
        Of the grids as stored. float16 keeps three digits, steps of 0.004 at 7.8 g/cm³.

    Examples
    --------
    ::

        with PredictionsWriter(Path("preds.npz")) as writer:
            for object_id in ids:
                writer.add(object_id, predict(object_id))
            writer.finish(meta)
    """

    def __init__(self, path: Path, dtype: Literal["float32", "float16"] = "float32") -> None:
        super().__init__(path)
        self._dtype = dtype
        self._has_sd = False

    def add(self, object_id: str, values: object, sd: object = None) -> None:
        """Append one object's prediction.

        Parameters
        ----------
        object_id
            As in the dataset.
        values
            A NumPy array of floats or integers, in the units the meta data will declare: shape
            (64, 64, 64), voxel means on the object's field grid; or shape (parts + 1,), entry 0
            (air) being 0.
        sd
            The standard deviation of ``values``: such an array of the same shape, for every
            object or for none.

        Raises
        ------
        DataError
            If one is no such array, the shape is neither, air has a density, a value is negative,
            above 1e9 or not finite (float16 ends at 65,504), ``sd`` came for some objects only,
            the object came before, or its id has characters other than letters, digits, ``._-``.
        """
        self._check_id(object_id)
        if self._seen and self._has_sd != (sd is not None):
            raise DataError(f"{object_id}: sd must be given for all objects or for none")
        stored = self._stored(object_id, values)
        kind = "part_density" if stored.ndim == 1 else "density"
        arrays = {kind: stored}
        if sd is not None:
            arrays[f"{kind}_sd"] = self._stored(f"{object_id}: sd", sd)
            if (found := arrays[f"{kind}_sd"].shape) != stored.shape:
                raise DataError(f"{object_id}: sd: shape must be {stored.shape}, got {found}")
        self._has_sd = sd is not None
        self._append(object_id, arrays)

    def _stored(self, where: str, values: object) -> Float[np.ndarray, "..."]:
        """Return an array as it will be stored; ``where`` opens each message."""
        if not isinstance(values, np.ndarray) or values.dtype.kind not in "fiu":
            raise DataError(
                f"{where}: must be a NumPy array of floats or integers, got {_described(values)}"
            )
        per_part = values.ndim == 1 and len(values) > 1
        if values.shape != GRID_SHAPE and not per_part:
            raise DataError(
                f"{where}: shape must be {GRID_SHAPE} or (parts + 1,), got {values.shape}"
                f"{pooling(values.shape)}"
            )
        with np.errstate(over="ignore"):  # found as infinity in the next line
            stored = values.astype("float32" if per_part else self._dtype)
        limit = np.float32(MAX_VALUE)  # has no float16
        if not ((stored >= 0) & (stored <= limit)).all():  # false for nan as well
            expected = f"values must be finite, >= 0 and <= {MAX_VALUE:g} as {stored.dtype}"
            raise DataError(f"{where}: {expected}")
        if per_part and stored[0] != 0:
            raise DataError(f"{where}: entry 0 is air and must be 0, got {stored[0]}")
        return stored


def _described(values: object) -> str:
    kind = f"{type(values).__module__}.{type(values).__qualname__}".removeprefix("builtins.")
    return f"{kind} of {values.dtype}" if isinstance(values, np.ndarray) else kind


def write_predictions(
    path: Path | str,
    meta: SubmissionMeta,
    predictions: Iterable[
        tuple[str, Float[np.ndarray, "..."]]
        | tuple[str, Float[np.ndarray, "..."], Float[np.ndarray, "..."] | None]
    ],
    dtype: Literal["float32", "float16"] = "float32",
) -> None:
    """Write a submission, one object in memory at a time.

    Parameters
    ----------
    path
        The ``preds.npz`` to write.
    meta
        What it says about itself.
    predictions
        Object id, array and, if there is one, its standard deviation, as in
        :meth:`PredictionsWriter.add`. The order is kept.
    dtype
        Of the grids as stored.

    Raises
    ------
    DataError
        If a prediction or the meta data break the format. Nothing is written then.
    """
    with PredictionsWriter(Path(path), dtype) as writer:
        for prediction in predictions:
            writer.add(*prediction)
        writer.finish(meta)
