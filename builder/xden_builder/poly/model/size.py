"""How large an object is beside its meshes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

import numpy as np
import trimesh

from xden1k.values.arrays import Points, Vec3
from xden_builder.capture.pose import MeshScale

__all__ = ["SIZE_SDS", "SIZE_SDS_MOST", "Size"]

SIZE_SDS: Final[Mapping[MeshScale, float]] = MappingProxyType(
    {"known": 0.005, "near": 0.01, "unknown": 0.005}
)
"""Standard deviation of the logarithm of the object's size over that of its meshes, before the
images, by what is told of the meshes: assumptions. One that was unknown is found before."""
SIZE_SDS_MOST: Final = 3.0
"""A size is never farther off than so many standard deviations: what looks so is something else,
such as wrong units or a part without a mesh."""
NEARLY: Final = 0.999
"""Share of that from which on a size is at its bound."""


@dataclass(frozen=True, slots=True, eq=False)
class Size:
    """How large an object is beside its meshes.

    Parameters
    ----------
    factor
        Length of the object over that of its meshes.
    sd
        Relative standard deviation of it.
    centre_cm
        Shape (3,): what meshes are enlarged about.
    factor_by_light
        The factor that light alone would have, where differences of pixels tell it: meshes of
        another size are no part without a mesh. None where light tells it.
    """

    factor: float
    sd: float
    centre_cm: Vec3
    factor_by_light: float | None = None

    def enlarged(self, mesh: trimesh.Trimesh) -> trimesh.Trimesh:
        """Give a mesh this size; its faces stay as they are."""
        vertices = self.applied(np.asarray(mesh.vertices))
        return trimesh.Trimesh(vertices, mesh.faces, process=False)

    def applied(self, points_cm: Points) -> Points:
        """Move points of a mesh as they move when it is given this size.

        Examples
        --------
        >>> Size(1.5, 0.0, np.array([0.0, 0.0, 1.0])).applied(np.array([[1.0, 0.0, 3.0]])).tolist()
        [[1.5, 0.0, 4.0]]
        """
        return np.asarray(self.factor * points_cm + (1 - self.factor) * self.centre_cm)

    def at_bound(self, told: MeshScale) -> bool:
        """Whether it is as far off as it may be, or would be by light alone.

        Examples
        --------
        >>> [Size(factor, 0.001, np.zeros(3)).at_bound("known") for factor in (1.014, 1.0152)]
        [False, True]
        >>> Size(1.01, 0.001, np.zeros(3), factor_by_light=1.0152).at_bound("known")
        True
        """
        factors = np.array([self.factor, self.factor_by_light or self.factor])
        return bool(np.abs(np.log(factors)).max() > NEARLY * SIZE_SDS_MOST * SIZE_SDS[told])

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Size:
        """Read what :meth:`to_dict` gives, the factor that is told."""
        return cls(values["factor"], values["sd"], np.array(values["centre_cm"]))

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON; ``factor_by_light``, which judges the fit alone, is not kept."""
        return {"factor": self.factor, "sd": self.sd, "centre_cm": self.centre_cm.tolist()}
