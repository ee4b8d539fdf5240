"""The phantoms that calibrate a scanner: staircases of known steps, and balls at known places.

Both are given in the object frame as they stand for the view ``pa``: x to the viewer's right, y
along the beam, z up. Lengths are centimetres.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import trimesh
from jaxtyping import Float
from manifold3d import Manifold

from xden_builder.phantoms.shapes import box, sphere, to_mesh, tube, union

__all__ = ["BALLS", "PLATES", "BallTube", "Stair"]


@dataclass(frozen=True, slots=True)
class Stair:
    """Steps of one material in a column, their backs in one plane, y = 0.

    Parameters
    ----------
    name
        Of the file of its mesh.
    material
        A name of the material library.
    thickness_cm
        Along the beam, of each step from the top down.
    x_cm, top_z_cm
        Middle of the column, and of the first step.
    spacing_cm
        From the middle of a step to that of the next.
    height_cm, width_cm
        Of one step, along z and x.
    """

    name: str
    material: str
    thickness_cm: tuple[float, ...]
    x_cm: float
    top_z_cm: float
    spacing_cm: float
    height_cm: float
    width_cm: float

    @property
    def centres_cm(self) -> Float[np.ndarray, "steps 3"]:
        """Middle of each step."""
        z = self.top_z_cm - self.spacing_cm * np.arange(len(self.thickness_cm))
        return np.stack([np.full(len(z), self.x_cm), -np.array(self.thickness_cm) / 2, z], axis=1)

    @property
    def mesh(self) -> trimesh.Trimesh:
        """All steps, those that touch as one solid."""
        steps = [
            box((self.width_cm, thick, self.height_cm)).translate(tuple(centre))
            for thick, centre in zip(self.thickness_cm, self.centres_cm.tolist(), strict=True)
        ]
        return to_mesh(union(steps))


def _stops(
    name: str, x_cm: float, width_cm: float, steps: int, top_z_cm: float, spacing_cm: float
) -> Stair:
    """Bar of lead along a staircase: beside each step it shows the stray light alone."""
    return Stair(name, "lead", (0.3,) * steps, x_cm, top_z_cm, spacing_cm, spacing_cm, width_cm)


PLATES: Final[Mapping[str, Sequence[Stair]]] = {
    "light": (
        _stops("stops_left", -3.25, 1.5, 10, 9.0, 2.0),
        Stair(
            *("aluminium", "aluminium"),
            (0.1, 0.2, 0.3, 0.5, 0.8, 1.2, 1.6, 2.4, 3.2, 4.0),
            *(-1.25, 9.0, 2.0, 2.0, 2.5),
        ),
        _stops("stops", 0.75, 1.5, 10, 9.0, 2.0),
        Stair("pmma", "pmma", (1.0, 2.0, 4.0, 6.0, 8.0), 2.75, 8.0, 4.0, 4.0, 2.5),
    ),
    "heavy": (
        _stops("stops_left", -2.35, 1.0, 8, 8.4, 2.4),
        Stair(
            *("steel", "steel"),
            (0.05, 0.1, 0.2, 0.3, 0.4, 0.6, 0.8, 1.0),
            *(-1.25, 8.4, 2.4, 2.4, 1.2),
        ),
        _stops("stops", -0.15, 1.0, 8, 8.4, 2.4),
        Stair("copper", "copper", (0.01, 0.02, 0.05, 0.1, 0.2, 0.3), 1.6, 7.5, 3.0, 3.0, 2.5),
    ),
}
"""Two plates, scanned one at a time: what aluminium and plastic scatter would outshine steel.

Staircases stand between bars of lead that touch them. No air shines in beside a step then, and what
arrives behind the lead on both sides arrives behind the step as well. Steel and the lead beside it
are narrow: the light behind thick steel is little more than what scatters nearby, and wide steel
shines on itself and not on the lead.
"""


RIM_CM: Final = 3.0
"""From the last ball to the end of the tube, so that the far rim's shadow stays off the balls."""


@dataclass(frozen=True, slots=True)
class BallTube:
    """Steel balls in the wall of a plastic tube, upright about the z axis.

    The balls wind around the tube, each at a height of its own.

    Parameters
    ----------
    count
        Of balls.
    ball_cm
        Diameter of a ball.
    radius_cm
        From the axis to the centre of a ball.
    wall_cm
        Of the tube, half of it inside that radius.
    spacing_cm, turn_deg
        From one ball to the next: down the axis, and around it.
    first_deg
        Of the top ball, from the x axis towards y.
    """

    count: int
    ball_cm: float
    radius_cm: float
    wall_cm: float
    spacing_cm: float
    turn_deg: float
    first_deg: float

    @property
    def centres_cm(self) -> Float[np.ndarray, "balls 3"]:
        """Centre of each ball, from the top down."""
        steps = np.arange(self.count)
        angle = np.deg2rad(self.first_deg + self.turn_deg * steps)
        z = self.spacing_cm * ((self.count - 1) / 2 - steps)
        return np.stack([self.radius_cm * np.cos(angle), self.radius_cm * np.sin(angle), z], axis=1)

    @property
    def balls_mesh(self) -> trimesh.Trimesh:
        """All balls."""
        return to_mesh(union(self._balls()))

    @property
    def tube_mesh(self) -> trimesh.Trimesh:
        """The tube with a socket for each ball."""
        return to_mesh(self._tube() - union(self._balls()))

    def _balls(self) -> list[Manifold]:
        centres = self.centres_cm.tolist()
        return [sphere(self.ball_cm / 2, (x, y, z)) for x, y, z in centres]

    def _tube(self) -> Manifold:
        half_cm = self.centres_cm[0, 2] + RIM_CM
        outer_cm, inner_cm = (self.radius_cm + side * self.wall_cm / 2 for side in (1, -1))
        return tube(outer_cm, inner_cm, -half_cm, half_cm)


BALLS: Final = BallTube(24, 0.6, 10.0, 0.4, 0.8, 90.0, 27.0)
"""24 balls of 6 mm, as bearings have them, in a tube of 20 cm.

By quarter turns from 27 degrees all shadows stay 2.5 cm apart in both views, and off the dark
edges and rims of the tube, from any distance of 90 cm or more. Turned by a quarter or upside down
it is the same phantom."""
