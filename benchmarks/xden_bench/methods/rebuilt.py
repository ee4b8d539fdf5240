"""A dataset folder as a submission: what the builder reconstructed, against the truth.

On phantoms the blind builder is the upper row of the X-ray track: the simulator knows the truth and
the builder has seen none of it. A folder that was built with the captures' labels is another row,
which declares them and has no rank: a named material all but tells its density. What a folder was
built from stands in each of its rows; one that does not say so counts as built with labels. On
scans the truth *is* the builder's reconstruction: the row compares a thing with itself, says so,
and has no rank.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from statistics import fmean
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from xden1k.errors import DataError
from xden1k.folder import DatasetFolder
from xden1k.format.records import decode_array
from xden1k.predictions import Target
from xden1k.predictor import Examples, Prediction, SampleView
from xden1k.values.cost import Cost
from xden1k.values.modality import Modality

__all__ = ["NAMES", "Rebuilt"]

NAMES: Final = ("builder", "builder-labels")
"""Of the row that was built blind, and of the one that was told the labels."""
SAME_PLACE = 0.01
"""Grids further apart than this share of a voxel are not the same."""
CIRCULAR = "circular: the truth of scans is the builder's own"


class Rebuilt:
    """The densities of another dataset folder of the same objects.

    Parameters
    ----------
    built
        What the builder wrote.
    target
        ``density`` or ``apparent_density``.

    Attributes
    ----------
    name, reads
        As the folder was built: ``builder``, or ``builder-labels``, which reads ``MATERIALS``.
    """

    version = "1"
    trainable = False
    external_data = False

    def __init__(self, built: DatasetFolder, target: Target) -> None:
        blind = _is_blind(built)
        self.name = NAMES[0] if blind else NAMES[1]
        self.reads = Modality.GEOMETRY | Modality.PARTS | Modality.XRAY
        if not blind:
            self.reads |= Modality.MATERIALS
        self._built = built
        self._target = target

    @property
    def notes(self) -> str:
        """By what it was made, from which folder and settings."""
        made, settings = self._built.manifest.builder, self._built.manifest.config_sha256
        facts = [
            f"reconstructed by {made}",
            f"manifest {self._built.manifest_sha256[:12]}",
            f"settings {settings[:12] or 'unknown'}",
        ]
        return ", ".join(facts)

    def cost(self) -> Cost | None:
        """Return what an object took the builder's workers, in the mean; of memory the most.

        With it goes an equal share of what finding the beam took, which objects share. None where
        the builder's report does not lie beside the folder, in ``BUILT.work``, or tells it of some
        objects only: of those kept from an interrupted run it knows no more.

        Raises
        ------
        DataError
            If the report is damaged.
        """
        root = self._built.root
        if not isinstance(root, Path):
            return None
        path = root.with_name(f"{root.name}.work") / "build_report.json"
        if not path.is_file():
            return None
        try:
            report = json.loads(path.read_bytes())
            shared_s = report.get("shared_processor_s")
            built = [one for one in report["objects"] if one["status"] == "built"]
            told = {one["object_id"]: _cost(one) for one in built}
        except (ValueError, KeyError, TypeError, AttributeError) as err:
            raise DataError(f"{path}: not a report of xden-build: {err!r}") from err
        costs = [one for one in told.values() if one is not None]
        if shared_s is None or len(costs) < len(built) or set(told) != set(self._built.ids()):
            return None
        memory = [one.peak_memory_gb for one in costs if one.peak_memory_gb is not None]
        return Cost(
            fmean(one.seconds for one in costs),
            fmean(one.processor_s for one in costs) + shared_s / len(costs),
            max(memory, default=None),
        )

    @property
    def fingerprint(self) -> str:
        """Checksum of the manifest of what was built."""
        return self._built.manifest_sha256

    def fit(self, train: Examples, *, seed: int) -> None:
        """Learn nothing."""

    def predict(self, sample: SampleView) -> Prediction:
        """Look up an object's density: its grid, or that of each part if its grid lies elsewhere.

        A rebuilt object lies where its annotated meshes do, which on phantoms are a little off the
        true ones. Parts of the same names then say what fills the true parts.

        Raises
        ------
        MissingObjectError
            If it was not rebuilt.
        DataError
            If it lies on another grid and has other parts, or only its attenuation is known.
        """
        columns = ["source", self._target, "grid_origin_cm", "voxel_size_cm"]
        row = self._built.row(sample.object_id, columns)
        remark = CIRCULAR if row["source"] == "scan" else ""
        if row[self._target] is None:
            raise DataError(f"{sample.object_id}: {self._built.root} has no {self._target} of it")
        apart = np.abs(np.array(row["grid_origin_cm"]) - sample.origin_cm).max()
        stretched = abs(row["voxel_size_cm"] / sample.voxel_size_cm - 1)
        if apart < SAME_PLACE * sample.voxel_size_cm and stretched < SAME_PLACE / 64:
            return Prediction(decode_array(row, self._target), remark=remark)
        return Prediction(self._by_part(sample), remark=remark)

    def _by_part(self, sample: SampleView) -> Float[np.ndarray, "parts"]:
        """Density of air and of each part, in the order of the dataset's parts."""
        column = f"part_{self._target}_g_cm3"
        built = self._built.row(sample.object_id, ["part_names", column])
        known = dict(zip(built["part_names"], built[column], strict=True))
        names = sample.part_names
        if sorted(names) != sorted(known):
            raise DataError(
                f"{sample.object_id}: in {self._built.root} it lies on another grid and has other "
                f"parts: {sorted(known)}, expected {sorted(names)}"
            )
        return np.array([0.0, *(known[name] for name in names)], dtype=np.float32)


def _cost(told: Mapping[str, Any]) -> Cost | None:
    """Return what the builder says that an object took; older ones did not say it."""
    names = [field.name for field in fields(Cost)]
    return Cost(*(told[name] for name in names)) if told.keys() >= set(names) else None


def _is_blind(built: DatasetFolder) -> bool:
    """Whether every object says that it was rebuilt with its labels withheld."""
    return all(_labels(row["meta_json"]) == "withheld" for row in built.rows(columns=["meta_json"]))


def _labels(meta_json: str) -> str:
    """Return what an object says of its labels; nothing if its builder stated no settings."""
    labels: str = json.loads(meta_json).get("settings", {}).get("labels", "")
    return labels
