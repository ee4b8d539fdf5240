"""What the truth, the material table or the X-rays alone would give: rows to read others by.

The first four are oracles: they are told what no method knows and have no rank. All need the extra
``build``, whose path lengths two of them use.
"""

from __future__ import annotations

import json
import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path
from statistics import fmean

import numpy as np
from jaxtyping import Float32

from xden1k.errors import DataError
from xden1k.predictor import Example, Examples, Prediction, SampleView
from xden1k.rays import path_lengths
from xden1k.values.arrays import Grid
from xden1k.values.materials import families
from xden1k.values.modality import Modality
from xden1k.values.views import XRayView
from xden_baselines.geometry import nearest_filled, voxel_centres_cm
from xden_baselines.materials import nominal_densities_g_cm3
from xden_baselines.xray import OPAQUE, back_projected_lac_per_cm

__all__ = [
    "LabelNominal",
    "PartOracle",
    "PublishedLac017",
    "TrueMassUniform",
    "XrayMean",
    "XrayUniform",
    "shadow_lac_per_cm",
]

LAW_NAME = "law.json"
FAINTEST_PER_CM = 1e-3
"""Of foam with 0.006 g/cm³. Noise can make a shadow's sum less than nothing."""
MOST_G_CM3 = {"density": 25.0, "apparent_density": 700.0}
"""By target: what noise makes more of, the benchmark would refuse (``[max_density_g_cm3]`` of its
protocols). Osmium has 22.6."""
TOLD_APART = 1.1
"""Training objects whose attenuation differs by less than this factor tell no exponent."""
SUBRAYS = 2
VAGUE = "the median of a family stands for its members"

PartValues = Float32[np.ndarray, "parts"]


class _Oracle:
    """What the four have in common."""

    version = "1"
    trainable = False
    external_data = False

    @property
    def notes(self) -> str:
        """Nothing."""
        return ""

    def fit(self, train: Examples, *, seed: int) -> None:
        """Learn nothing."""


class TrueMassUniform(_Oracle):
    """Oracle of the mass, spread evenly over the envelope: what knowing the mass alone is worth."""

    name = "true-mass-uniform"
    reads = Modality.GEOMETRY | Modality.TRUTH

    def predict(self, sample: SampleView) -> Grid:
        """Predict the true mass over the volume inside the outer surface.

        Raises
        ------
        DataError
            If it is not known.
        """
        truth = sample.truth
        field = truth.density if sample.target == "density" else truth.apparent_density
        if field is None:
            raise DataError(f"{sample.object_id} has no known {sample.target}")
        matter = field.density_g_cm3.sum(dtype=np.float64)
        density: Grid = np.float32(matter / sample.envelope.sum(dtype=np.float64)) * sample.envelope
        return density


class PartOracle(_Oracle):
    """Oracle of each part's mean density: what no method that works by parts can pass."""

    name = "part-oracle"
    reads = Modality.PARTS | Modality.TRUTH

    def predict(self, sample: SampleView) -> PartValues:
        """Predict the true part densities.

        Raises
        ------
        DataError
            If a part has none.
        """
        name = f"{sample.target}_g_cm3"
        return _part_values(sample, [getattr(part, name) for part in sample.truth.parts])


class LabelNominal(_Oracle):
    """Oracle of each part's material, with the density the material table calls usual."""

    name = "label-nominal"
    reads = Modality.PARTS | Modality.MATERIALS

    def predict(self, sample: SampleView) -> Prediction:
        """Predict the nominal density of each part's label.

        Raises
        ------
        DataError
            If a part has no label, or the target is not the density.
        """
        if sample.target != "density":
            raise DataError("label-nominal knows true densities, not apparent ones")
        labels = [material.lower() for material in sample.part_materials]
        remark = VAGUE if {*labels} & {*families()} else ""
        return Prediction(_part_values(sample, nominal_densities_g_cm3(sample)), remark=remark)


class PublishedLac017(_Oracle):
    """Oracle of what the authors' release has as density: each part's attenuation over 0.17."""

    name = "published-lac017"
    reads = Modality.PARTS | Modality.TRUTH

    def predict(self, sample: SampleView) -> PartValues:
        """Predict the published densities.

        Raises
        ------
        DataError
            If the object is not of the release, a part has none, or the target is not the density.
        """
        if sample.target != "density":
            raise DataError("published-lac017 is the apparent density: predict the other one by it")
        if sample.truth.source != "published":
            raise DataError(
                f"published-lac017 is what the authors' release says: {sample.object_id} must be "
                f"of the source 'published', it is of {sample.truth.source!r}"
            )
        apparent = [part.apparent_density_g_cm3 for part in sample.truth.parts]
        return _part_values(sample, apparent)


class _Calibrated(ABC):
    """A map of attenuation, turned into density by a power law fitted on the training objects.

    Metals attenuate more per gram than plastics, so that one factor would be wrong for both.
    """

    name: str
    version = "1"
    reads = Modality.GEOMETRY | Modality.XRAY
    trainable = True
    external_data = False

    def __init__(self) -> None:
        self._factor = self._exponent = math.nan

    @property
    def notes(self) -> str:
        """The law."""
        return f"density = {self._factor:.3g} · attenuation^{self._exponent:.3g}, g/cm³ of 1/cm"

    def fit(self, train: Examples, *, seed: int) -> None:
        """Fit the logarithms of the objects' mean density and attenuation, by least squares."""
        means = [_log_means(one, self._lac(one.sample)) for one in train]
        (lac, density), centre = np.array(means).T, np.mean(means, axis=0)
        # alike objects tell a factor only
        is_told = np.ptp(lac) > math.log(TOLD_APART)
        slope = np.polyfit(lac - centre[0], density - centre[1], 1)[0] if is_told else 1.0
        self._exponent = float(slope)
        self._factor = math.exp(centre[1] - self._exponent * centre[0])

    def predict(self, sample: SampleView) -> Grid:
        """Predict by the law, in the envelope."""
        lac = self._lac(sample).clip(0, None)
        density: Grid = np.float32(self._factor) * lac ** np.float32(self._exponent)
        return np.asarray(density.clip(max=MOST_G_CM3[sample.target]) * sample.envelope)

    def save(self, folder: Path) -> None:
        """Write the law."""
        law = {"factor": self._factor, "exponent": self._exponent}
        (folder / LAW_NAME).write_text(json.dumps(law))

    def load(self, folder: Path) -> None:
        """Read the law."""
        law = json.loads((folder / LAW_NAME).read_text())
        self._factor, self._exponent = float(law["factor"]), float(law["exponent"])

    @abstractmethod
    def _lac(self, sample: SampleView) -> Grid:
        """Attenuation of what is in each voxel, 1/cm; its share of the voxel not yet counted."""


def _log_means(one: Example, lac_per_cm: Grid) -> tuple[float, float]:
    """Logarithms of an object's mean attenuation and mean density inside the outer surface."""
    weight = one.sample.envelope.astype(np.float64)
    lac, density = ((weight * lac_per_cm).sum(), one.density_g_cm3.sum(dtype=np.float64))
    return math.log(max(lac / weight.sum(), FAINTEST_PER_CM)), math.log(density / weight.sum())


class XrayUniform(_Calibrated):
    """Attenuation of the whole shadow over the volume inside the outer surface, everywhere."""

    name = "xray-uniform"

    def _lac(self, sample: SampleView) -> Grid:
        mean = fmean(shadow_lac_per_cm(sample, view) for view in sample.views)
        return np.full_like(sample.envelope, mean)


class XrayMean(_Calibrated):
    """Mean of the attenuation along the two rays through each voxel."""

    name = "xray-mean"

    def _lac(self, sample: SampleView) -> Grid:
        lac: Grid = back_projected_lac_per_cm(sample).mean(axis=0)
        return lac


def shadow_lac_per_cm(sample: SampleView, view: XRayView) -> float:
    """Mean attenuation inside the outer surface, from the sum of a radiograph's shadow.

    With p the line integral at a pixel of solid angle dΩ and r the distance from the source,
    ``Σ p dΩ = ∫ LAC / r² dV``: over ``∫ 1 / r² dV`` of the envelope it is exact for a homogeneous
    body, however deep in the cone. For a parallel beam dΩ is an area and r is 1.

    Parameters
    ----------
    sample
        Needs ``GEOMETRY``.
    view
        A radiograph that shows all of it.
    """
    geometry, inside = view.geometry, sample.envelope > 0
    pixels = path_lengths([sample.outer_mesh], [0], geometry, SUBRAYS).pixels
    integral = -np.log(np.where(view.valid, view.transmission, 1).clip(OPAQUE, None))
    known = nearest_filled(integral[..., None], view.valid[..., None]).ravel()[pixels]
    rows, columns = (one.astype(np.float64) for one in np.divmod(pixels, geometry.shape[1]))
    solid_angle = abs(np.linalg.det(geometry.matrix)) / geometry.cm_per_depth(rows, columns) ** 3
    weight = sample.envelope[inside].astype(np.float64) * sample.voxel_size_cm**3
    if geometry.source_cm is not None:
        centres = voxel_centres_cm(sample, inside)
        weight /= ((centres - geometry.source_cm) ** 2).sum(axis=1)
    return float((known * solid_angle).sum() / weight.sum())


def _part_values(sample: SampleView, densities: Sequence[float]) -> PartValues:
    """Air, then each part."""
    if not np.isfinite(densities).all():
        raise DataError(f"{sample.object_id}: a part has no known {sample.target}")
    return np.array([0.0, *densities], dtype=np.float32)
