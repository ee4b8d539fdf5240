"""The size of meshes that are right to a per cent: by the outlines that two cone beams show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from xden1k.values.arrays import Vec3
from xden_builder.capture import Capture
from xden_builder.physics.source import Tube
from xden_builder.poly.model.radiograph import gain_prior
from xden_builder.poly.pose import refine_pose
from xden_builder.poly.scene import set_scene
from xden_builder.poly.settings import PolySettings
from xden_builder.poly.start import first_guess
from xden_builder.registration.placement import RigidPlacement
from xden_builder.registration.reduced import USUAL_KEV

__all__ = ["Size", "find_size"]


@dataclass(frozen=True, slots=True, eq=False)
class Size:
    """How large an object is beside its meshes.

    Parameters
    ----------
    factor
        Length of the object over that of its meshes.
    sd
        Standard deviation of the factor.
    centre_cm
        Shape (3,): what meshes are enlarged about.
    """

    factor: float
    sd: float
    centre_cm: Vec3

    @property
    def placement(self) -> RigidPlacement:
        """That gives meshes this size."""
        return RigidPlacement(np.eye(3), (1 - self.factor) * self.centre_cm, self.factor)

    def after(self, placement: RigidPlacement | None) -> RigidPlacement:
        """Where meshes stand that were placed, if they were, before they got this size."""
        if placement is None:
            return self.placement
        moved = self.placement.apply(placement.translation_cm[None])[0]
        return RigidPlacement(placement.rotation, moved, self.factor * placement.scale)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Size:
        """Read what :meth:`to_dict` gives."""
        return cls(values["factor"], values["sd"], np.array(values["centre_cm"]))

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON."""
        return {"factor": self.factor, "sd": self.sd, "centre_cm": self.centre_cm.tolist()}


def find_size(capture: Capture, order: Sequence[int]) -> Size:
    """Find how large an object is beside its meshes, along with its pose, which is left as told.

    Two cone beams, each from its own side, tell where an object is, and so how much its shadows
    are magnified.

    Parameters
    ----------
    capture
        Its parts stand near their place in the scanner's frame, and have their size to a per cent.
    order
        Which part owns space first, see :func:`xden1k.rays.ownership_order`.

    Raises
    ------
    DataError
        If the source is outside the tables.
    """
    told = replace(capture, tube=capture.tube or Tube(energy_kev=USUAL_KEV))
    scene = set_scene(told, order, PolySettings())
    guess = first_guess(scene)
    fit = refine_pose(
        scene.views,
        scene.saturated,
        [gain_prior(bounds) for bounds in scene.gains],
        scene.outlines.beams,
        scene.meshes,
        scene.order,
        guess.outline_stand_ins.mac_cm2_g,
        guess.density_g_cm3,
        scene.turned,
        sized=True,
    )
    factor = float(np.exp(fit.unknowns[-1]))
    return Size(factor, factor * float(fit.sd[-1]), np.array(fit.pose.centre_cm))
