"""The dataset for torch: samples are dicts of tensors."""

from __future__ import annotations

import operator
import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
import torch
from torch.utils.data import Dataset, default_collate

from xden1k.access.geometry import GEOMETRY_PARTS, VIEWS, geometry_tensors
from xden1k.access.hub import data_root
from xden1k.errors import DataError, did_you_mean
from xden1k.folder import DatasetFolder
from xden1k.folder.listing import check_known
from xden1k.format.records import decode_codes, decode_geometry
from xden1k.format.schema import ARRAY_COLUMNS
from xden1k.format.shards import Row
from xden1k.values.types import FIELD_SIZE, DensityObject

__all__ = ["FIELDS", "RAGGED_FIELDS", "Sample", "XDen1K", "collate"]

Sample = dict[str, Any]
"""A sample: field name to tensor, text or list of texts."""

_PART_FIGURES: Final = {
    "part_density": "part_density_g_cm3",
    "part_density_sd": "part_density_sd_g_cm3",
    "part_apparent_density": "part_apparent_density_g_cm3",
    "part_lac": "part_lac_per_cm",
    "part_color_rgb": "part_color_rgb",
}
"""Columns of one figure for each part; the field has one more in front, the air's."""
_TEXTS: Final = ("object_id", "category", "source")
_LISTS: Final = ("flags", "part_names", "part_materials", "part_density_source", "part_flags")
_VALID: Final = {f"xray_{view}_valid": f"xray_{view}" for view in VIEWS}
_GEOMETRY: Final = {
    f"xray_{view}_{part}": (view, part) for view in VIEWS for part in GEOMETRY_PARTS
}
_INERTIA: Final = ((0, 3, 4), (3, 1, 5), (4, 5, 2))
"""Places of xx, yy, zz, xy, xz, yz in the tensor."""

FIELDS = (
    *("object_id", "category", "xray_pa", "xray_lat", "density", "apparent_density"),
    *("occupancy", "envelope", "labels", "part_density", "mesh_vertices", "mesh_faces"),
    *("face_part", "grid_origin_cm", "voxel_size_cm", "mass_g", "com_cm"),
    *("inertia_g_cm2", "weighed_mass_g", "source", "flags", *_VALID, *_GEOMETRY),
    *("part_names", "part_materials", "part_density_source", "part_flags"),
    *("part_density_sd", "part_apparent_density", "part_lac", "part_color_rgb"),
)
"""What a sample may hold."""
_RADIOGRAPH_FIELDS: Final = frozenset({*_VALID, *_VALID.values(), *_GEOMETRY})
"""What a sample of an object without radiographs does not hold."""
RAGGED_FIELDS = frozenset({*_PART_FIGURES, "mesh_vertices", "mesh_faces", "face_part"})
"""Fields whose size is the object's own; :func:`collate` keeps them as lists."""


class XDen1K(Dataset[Sample]):
    """Objects of one split as torch samples.

    A sample is a dict of

    - ``object_id``, ``category``, ``source``: str; ``flags``: list of str;
    - ``xray_pa``, ``xray_lat``: float32 (rows, columns), transmission; 0 = invalid pixel;
      ``xray_pa_valid``, ``xray_lat_valid``: bool (rows, columns), False = invalid pixel;
    - ``xray_pa_source``: float32 (4), focal spot in cm and 1, or, for a parallel beam, its
      direction negated and 0; ``xray_pa_pixel00_cm``, ``xray_pa_column_step_cm``,
      ``xray_pa_row_step_cm``: float32 (3), the *centre* of pixel (0, 0) and the way to the next
      column and row; ``xray_pa_projection``: float32 (3, 4), for :func:`xden1k.project`; and the
      same of ``xray_lat``; all in the object frame;
    - ``density``, ``apparent_density``: float32 (64, 64, 64), g/cm³, voxel means; ``density`` is
      not a number where only attenuation is known, both are in the split ``private``;
    - ``occupancy``, ``envelope``: float32 (64, 64, 64), shares of a voxel, 0 to 1;
    - ``labels``: uint8 (128, 128, 128), 0 = air, k = part k;
    - ``part_density``, ``part_density_sd``, ``part_apparent_density``: float32 (K + 1), g/cm³,
      entry 0 is air; ``part_lac``: float32 (K + 1), 1/cm; ``part_color_rgb``: float32 (K + 1, 3),
      0 to 1; not a number where unknown;
    - ``part_names``, ``part_materials``, ``part_density_source``: lists of K str, entry k - 1 is
      part k; ``part_flags``: list of K lists of str;
    - ``mesh_vertices`` float32 (V, 3), cm; ``mesh_faces`` int32 (F, 3); ``face_part`` uint8 (F);
    - ``grid_origin_cm``, ``com_cm``: float32 (3); ``voxel_size_cm``, ``mass_g``: float32, 0-d;
      ``weighed_mass_g``: float32, 0-d, not a number if never on a scale;
      ``inertia_g_cm2``: float32 (3, 3), about the centre of mass.

    An object without radiographs has a sample without any ``xray_`` field.

    Rows are read one at a time, and of a row only what the fields need. Any start method of
    ``DataLoader`` workers will do.

    Parameters
    ----------
    root
        A dataset folder, or a URL that fsspec knows, ``hf://datasets/OWNER/NAME@TAG``, of which
        only what the fields need is fetched; None = as :func:`xden1k.data_root` finds it.
    split
        ``train``, ``val``, ``test``, ``unseen``, or ``private`` where a folder withholds answers.
    fields
        What a sample holds, one or some of :data:`FIELDS`; None = everything there is.
    categories
        Only objects of this category, or of one of these; None = all.
    transform
        Called with each sample, gives what is handed out: one of
        :mod:`xden1k.access.transforms`, or any other. Workers that are spawned must be able to
        pickle it.

    Raises
    ------
    DataError
        If there is no such folder, split, field or category, no object of the categories in the
        split, or a field of radiographs is asked for and objects have none.
    """

    def __init__(
        self,
        root: str | os.PathLike[str] | None = None,
        split: str = "train",
        fields: str | Sequence[str] | None = None,
        *,
        categories: str | Sequence[str] | None = None,
        transform: Callable[[Sample], Any] | None = None,
    ) -> None:
        self.fields = FIELDS if fields is None else _several(fields)
        if unknown := sorted(set(self.fields) - set(FIELDS)):
            hint = did_you_mean(unknown[0], FIELDS)
            raise DataError(f"unknown fields {unknown}{hint}; there are {list(FIELDS)}")
        self.split = split
        self.folder = DatasetFolder(data_root(root))
        self.ids = self.folder.ids(split)
        self.categories = None if categories is None else _several(categories)
        self.transform = transform
        if self.categories is not None:
            self.ids = _of_categories(self.folder, self.ids, self.categories, split)
        if fields is not None and (asked := _RADIOGRAPH_FIELDS.intersection(self.fields)):
            _refuse_without_radiographs(self.folder, split, self.ids, sorted(asked))
        self._columns = list(dict.fromkeys(c for name in self.fields for c in _columns(name)))

    def __repr__(self) -> str:
        options = {
            "fields": None if self.fields == FIELDS else self.fields,
            "categories": self.categories,
            "transform": self.transform,
        }
        given = "".join(f", {name}={v!r}" for name, v in options.items() if v is not None)
        return f"XDen1K({str(self.folder.root)!r}, {self.split!r}{given}): {len(self)} objects"

    def __len__(self) -> int:
        return len(self.ids)

    def __getitem__(self, index: object) -> Any:
        number = _number(index)
        if not -len(self) <= number < len(self):
            raise IndexError(f"no sample {number}: {self!r}")
        object_id = self.ids[number]
        sample = _sample(self.folder.row(object_id, self._columns), self.fields)
        return sample if self.transform is None else self.transform(sample)

    def __getitems__(self, indices: Sequence[int]) -> list[Any]:
        """Return samples of several objects, in the order asked for; ``DataLoader`` calls it."""
        return [self[index] for index in indices]

    def object(self, object_id: str) -> DensityObject:
        """Return one object, of any split: views, parts with their meshes, fields.

        Raises
        ------
        MissingObjectError
            If there is no such object.
        """
        return self.folder.object(object_id)


def _several(names: str | Sequence[str]) -> tuple[str, ...]:
    return (names,) if isinstance(names, str) else tuple(names)


def _of_categories(
    folder: DatasetFolder, ids: tuple[str, ...], categories: tuple[str, ...], split: str
) -> tuple[str, ...]:
    of = dict(zip(folder.ids(), folder.light_column("category"), strict=True))
    for name in categories:
        check_known(folder, "category", name, of.values())
    chosen = tuple(name for name in ids if of[name] in categories)
    if not chosen:
        raise DataError(f"{folder.root}: split {split!r} has no object of {list(categories)}")
    return chosen


def _refuse_without_radiographs(
    folder: DatasetFolder, split: str, ids: tuple[str, ...], asked: Sequence[str]
) -> None:
    if without := folder.without_radiographs(split).intersection(ids):
        raise DataError(
            f"{folder.root}: {len(without)} of {len(ids)} objects of the split {split!r} have no "
            f"radiographs, and so no {', '.join(asked)}: leave these fields out"
        )


def _number(index: Any) -> int:
    try:
        return operator.index(index)
    except TypeError:
        pass
    if isinstance(index, slice):
        how = "Subset(dataset, range(len(dataset))[a:b]) of torch.utils.data"
    elif isinstance(index, str):
        how = f"dataset[dataset.ids.index({index!r})], or dataset.object({index!r})"
    else:
        how = "dataset.__getitems__(numbers), or Subset of torch.utils.data"
    raise DataError(f"a sample is named by one number, not by {index!r}: use {how}")


def _columns(name: str) -> tuple[str, ...]:
    """Return the columns a field is made of."""
    if name in _GEOMETRY:
        return ("meta_json",)
    name = _VALID.get(name, _PART_FIGURES.get(name, name))
    codec = ARRAY_COLUMNS.get(name)
    return (name, codec.shape) if codec and isinstance(codec.shape, str) else (name,)


def _sample(row: Row, fields: tuple[str, ...]) -> Sample:
    made = _geometry(row) if "meta_json" in row else {}
    if "meta_json" in row and not made:
        fields = tuple(name for name in fields if name not in _RADIOGRAPH_FIELDS)
    for valid in [name for name in fields if name in _VALID]:
        codes = decode_codes(row, _VALID[valid])
        made |= {_VALID[valid]: _values(codes, _VALID[valid]), valid: torch.from_numpy(codes > 0)}
    return {name: made[name] if name in made else _value(row, name) for name in fields}


def _geometry(row: Row) -> Sample:
    return {
        f"xray_{view}_{part}": tensor
        for view, geometry in decode_geometry(row).items()
        for part, tensor in geometry_tensors(geometry).items()
    }


def _value(row: Row, name: str) -> Any:
    if name in _TEXTS or name in _LISTS:
        return row[name]
    if name in _PART_FIGURES:
        values = torch.tensor(row[_PART_FIGURES[name]], dtype=torch.float32)
        return torch.cat([torch.zeros_like(values[:1]), values])
    if name in ("density", "apparent_density") and row[name] is None:
        return torch.full((FIELD_SIZE,) * 3, np.nan)
    if name in ARRAY_COLUMNS:
        return _values(decode_codes(row, name), name)
    value = torch.tensor(np.nan if row[name] is None else row[name], dtype=torch.float32)
    return value[torch.tensor(_INERTIA)] if name == "inertia_g_cm2" else value


def _values(codes: np.ndarray, name: str) -> torch.Tensor:
    """Values of stored codes, as :meth:`ArrayCodec.values`: torch is faster with float16."""
    stored, scale = torch.from_numpy(codes), ARRAY_COLUMNS[name].scale
    return stored if scale is None else stored.to(torch.float32).mul_(scale)


def collate(samples: Sequence[Mapping[str, Any]], *, one_size: bool = False) -> Sample:
    """Join samples to a batch, for ``DataLoader(..., collate_fn=xden1k.collate)``.

    Tensors are stacked along a new first axis. Texts, meshes and what is one for each part become
    lists, and so do radiographs if their sizes differ, or some objects of the batch have none: in
    these lists, and in those of the radiographs' geometry, None stands for what there is not.

    Parameters
    ----------
    samples
        With the same fields.
    one_size
        Refuse radiographs of different sizes: ``partial(xden1k.collate, one_size=True)``.

    Raises
    ------
    DataError
        If samples differ in other fields than those of radiographs, or sizes differ that must not.
    """
    if not samples:
        return {}
    names = dict.fromkeys(name for sample in samples for name in sample)
    for number, sample in enumerate(samples):
        if odd := sorted((sample.keys() ^ samples[0].keys()) - _RADIOGRAPH_FIELDS):
            raise DataError(f"samples 0 and {number} of a batch differ in their fields: {odd}")
    batch = {name: _joined(name, [sample.get(name) for sample in samples]) for name in names}
    if one_size:
        for name in names:
            if name not in RAGGED_FIELDS and isinstance(batch[name], list):
                _refuse_several_sizes(name, batch[name])
    return batch


def _refuse_several_sizes(name: str, values: list[Any]) -> None:
    sizes = [tuple(value.shape) for value in values if isinstance(value, torch.Tensor)]
    if sizes and len(sizes) < len(values):
        raise DataError(
            f"{name} is in {len(sizes)} of the {len(values)} samples of one batch: the others have "
            "no radiographs; leave it or them out"
        )
    if sizes:
        raise DataError(
            f"{name} has different sizes in one batch, {sizes}: crop or pad them to one "
            "with xden1k.access.transforms.CropViews(size=...)"
        )


def _joined(name: str, values: list[Any]) -> Any:
    if name in RAGGED_FIELDS or not all(isinstance(value, torch.Tensor) for value in values):
        return values
    same = all(value.shape == values[0].shape for value in values)
    # Stacks; in a worker into memory shared with the parent, which saves a copy.
    return default_collate(values) if same else values
