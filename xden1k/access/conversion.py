"""Rows of ``datasets`` in other forms: decoded, of plain types, as tensors.

What :func:`xden1k.load_dataset` and the alias give decodes by itself. These are for rows that came
another way, for rows that go to someone without this package, and for training on rows.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import datasets
import numpy as np
from datasets import (
    Array2D,
    Array3D,
    DatasetDict,
    Features,
    Image,
    IterableDataset,
    IterableDatasetDict,
    List,
    Value,
)
from jaxtyping import Float32

from xden1k.errors import DataError, MissingExtraError
from xden1k.format.codec import MAX_TRANSMISSION
from xden1k.format.features import PackedArray
from xden1k.format.packing import pack, with_arrays
from xden1k.format.schema import ARRAY_COLUMNS

__all__ = ["decode", "to_plain", "to_tensors"]

ROWS_AT_ONCE: Final = 8
_CODES: Final = 65535 / MAX_TRANSMISSION
_STREAMS_DECODE = tuple(map(int, datasets.__version__.split(".")[:3])) >= (4, 8, 4)
"""Whether what ``map`` makes of a stream decodes in this version of ``datasets``."""
_PLAIN: Final = {
    "mesh_vertices": Array2D((None, 3), "float32"),
    "mesh_faces": Array2D((None, 3), "int32"),
    "face_part": List(Value("uint8")),
}


def decode(rows: Any) -> Any:
    """Give rows whose array columns are bytes the type that decodes them.

    For rows that did not come by ``load_dataset``: of ``Dataset.from_parquet``, of
    ``load_dataset("parquet", ...)``, or loaded before ``import xden1k``. Rows that decode already
    come back as they are. Of a dataset that is no stream the bytes are copied into the cache of
    ``datasets``, once.

    Parameters
    ----------
    rows
        A ``Dataset``, an ``IterableDataset``, or a dict of them, as ``load_dataset`` gives it.

    Returns
    -------
    The same kind, with the same columns

    Raises
    ------
    DataError
        If it is nothing of the kind, or a radiograph comes without its ``..._shape`` column.
    MissingExtraError
        If it is a stream, and ``datasets`` is older than 4.8.4.
    """
    return _each(rows, _decoded)


def to_plain(rows: Any) -> Any:
    """Give the array columns types that every installation of ``datasets`` has.

    For ``save_to_disk``, ``to_parquet`` and ``push_to_hub`` to people without this package. Grids
    become ``Array3D``, ``uint8`` or ``float32``; vertices and faces ``Array2D``; radiographs
    ``Image``, PNG of 16 bits: transmission = pixel * (1.25 / 65535), 0 = invalid. Reading such
    rows takes ten times as long and more. In a stream the radiographs stay bytes of PNG.

    Parameters
    ----------
    rows
        Rows that decode: a ``Dataset``, an ``IterableDataset``, or a dict of them.

    Returns
    -------
    The same kind, with the same columns

    Raises
    ------
    DataError
        If it is nothing of the kind, its arrays are bytes (see :func:`decode`), or a radiograph
        was changed and is no transmission in 65535 steps any more.
    """
    return _each(rows, _plain)


def to_tensors(batch: Mapping[str, Sequence[Any]]) -> dict[str, list[Any]]:
    """Make tensors of what a batch of rows holds, for ``rows.with_transform(to_tensors)``.

    Arrays become tensors of their type: ``labels`` stay uint8, where ``with_format("torch")``
    makes int64 of them and takes several times as long. Fractions and lists of them become float32
    tensors. Whole numbers, texts, images, lists of these and what is unknown (None) stay as they
    are.

    Parameters
    ----------
    batch
        Column name to values, as ``datasets`` hands it to a transform.

    Examples
    --------
    >>> row = to_tensors({"com_cm": [[0.0, 1.0, 2.0]], "object_id": ["mug-0001"]})
    >>> row["com_cm"][0].dtype, row["object_id"]
    (torch.float32, ['mug-0001'])
    """
    return {name: [_tensor(value) for value in values] for name, values in batch.items()}


def _tensor(value: Any) -> Any:
    import torch

    if isinstance(value, np.ndarray):
        return torch.from_numpy(value)
    if isinstance(value, float) or (isinstance(value, list) and _is_numbers(value)):
        return torch.tensor(value, dtype=torch.float32)
    return value


def _is_numbers(values: list[Any]) -> bool:
    """Whether a list, or the lists in it, are fractions alone."""
    return bool(values) and all(
        _is_numbers(value) if isinstance(value, list) else isinstance(value, float)
        for value in values
    )


def _each(rows: Any, convert: Callable[[Any], Any]) -> Any:
    if isinstance(rows, DatasetDict | IterableDatasetDict):
        return type(rows)({split: convert(part) for split, part in rows.items()})
    if isinstance(getattr(rows, "features", None), Features):
        return convert(rows)
    raise DataError(
        f"rows of datasets are wanted, with their features known, got {type(rows).__name__}"
    )


def _decoded(rows: Any) -> Any:
    given = rows.features
    wanted = with_arrays(given)
    if wanted == given:
        return rows
    if isinstance(rows, IterableDataset) and not _STREAMS_DECODE:
        raise MissingExtraError(
            f"datasets {datasets.__version__} does not decode a stream that was mapped: "
            "pip install 'datasets>=4.8.4', or load without streaming"
        )
    for name in (name for name in wanted if wanted[name] != given[name]):
        shape = ARRAY_COLUMNS[name].shape
        if isinstance(shape, str) and shape not in given:
            raise DataError(f"{name} cannot be decoded without the column {shape}: load that too")
    chosen = {} if isinstance(rows, IterableDataset) else rows.format
    made = _mapped(rows.with_format("arrow"), pack, wanted, {"features": wanted})
    return made.with_format(**chosen)


def _plain(rows: Any) -> Any:
    given = rows.features
    if with_arrays(given) != given:
        raise DataError("the array columns of these rows are bytes: give xden1k.decode(rows)")
    names = [name for name, each in given.items() if isinstance(each, PackedArray)]
    if not names:
        return rows
    wanted = Features({name: _plain_type(name, each) for name, each in given.items()})
    return _mapped(rows.with_format(None), _plain_batch, wanted, {"names": names})


def _mapped(
    rows: Any, convert: Callable[..., Any], features: Features, options: dict[str, Any]
) -> Any:
    """Map batches; ``convert`` must be found by its name, else hashing it takes seconds."""
    how = {} if isinstance(rows, IterableDataset) else {"writer_batch_size": ROWS_AT_ONCE}
    return rows.map(
        convert,
        batched=True,
        batch_size=ROWS_AT_ONCE,
        features=features,
        fn_kwargs=options,
        **how,
    )


def _plain_batch(batch: Mapping[str, list[Any]], names: Sequence[str]) -> dict[str, list[Any]]:
    return {name: [_plain_value(name, value) for value in batch[name]] for name in names}


def _plain_type(name: str, feature: Any) -> Any:
    if not isinstance(feature, PackedArray):
        return feature
    if name in _PLAIN:
        return _PLAIN[name]
    codec = ARRAY_COLUMNS.get(name)
    if codec is None:
        raise DataError(f"{name} is no column of the dataset, and of no plain type known here")
    if isinstance(codec.shape, str):
        return Image()
    return Array3D(codec.shape, "uint8" if codec.scale is None else "float32")


def _plain_value(name: str, value: np.ndarray | None) -> Any:
    if value is None or not isinstance(ARRAY_COLUMNS[name].shape, str):
        return value
    from PIL import Image as PILImage

    file = io.BytesIO()
    PILImage.fromarray(_codes(name, value)).save(file, format="png", compress_level=1)
    return {"bytes": file.getvalue(), "path": None}


def _codes(name: str, image: Float32[np.ndarray, "rows columns"]) -> np.ndarray:
    codes = np.rint(image * np.float32(_CODES))
    if not (np.abs(codes / np.float32(_CODES) - image) <= 1e-6).all() or codes.max() > 65535:
        raise DataError(
            f"{name} is no transmission in 65535 steps any more: drop it, or make plain before it "
            "is changed"
        )
    return codes.astype(np.uint16)
