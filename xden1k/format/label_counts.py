"""What the labels of a dataset show and do not, as counts of parts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any, Final

from xden1k.format.records import decode_array, split_meshes
from xden1k.values.labels import count_label_voxels, labels_err

__all__ = ["LABEL_COUNTS", "label_counts"]

LABEL_COUNTS: Final = ("parts", "voxels_err", "no_voxels", "no_material", "material_doubted")
"""What is counted: all parts; those whose label voxels err by more than a fifth about the volume of
their mesh; those that have a volume and no label voxel; those that nobody gave a material, but for
withheld ones; those whose material the fit doubts."""


def label_counts(row: Mapping[str, Any]) -> Counter[str]:
    """Count the parts of an encoded row by what their labels show.

    Parameters
    ----------
    row
        With labels, meshes and parts.

    Raises
    ------
    DataError
        If a grid or the meshes are not to be decoded.
    """
    volumes = [float(mesh.volume) if len(mesh.faces) else 0.0 for mesh in split_meshes(row)]
    voxels = count_label_voxels(decode_array(row, "labels"), len(volumes))
    err = labels_err(voxels, row["voxel_size_cm"] / 2, volumes)
    known = [source != "withheld" for source in row["part_density_source"]]
    materials = zip(row["part_materials"], known, strict=True)
    counted = (
        len(volumes),
        int(err.sum()),
        sum(volume > 0 and not count for volume, count in zip(volumes, voxels, strict=True)),
        sum(told and not material for material, told in materials),
        sum("label_doubted" in flags for flags in row["part_flags"]),
    )
    return Counter(dict(zip(LABEL_COUNTS, counted, strict=True)))
