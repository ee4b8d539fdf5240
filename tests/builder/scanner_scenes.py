"""What the tests of the simulated scanner look at."""

import numpy as np
import trimesh

from xden_builder.phantoms import Phantom, PhantomPart, Plan, Scanner
from xden_builder.physics.source import Tube

WATER = (("H2O", 1.0),)
TUBE = Tube(kv=100.0, mas=126.0, filtration_cm={"Al": 0.25})
BARE = Scanner.realistic(128).ideal()
"""A tube, and nothing else that differs from the formulas."""


def block(*size_cm: float, material: str = "water", density: float = 1.0) -> Phantom:
    mesh = trimesh.creation.box(size_cm)
    part = PhantomPart("block", "body", mesh, material, density, (0.5, 0.5, 0.5))
    return Phantom(Plan(0, 0, 0), (part,))


def middle(image: np.ndarray) -> float:
    rows, columns = image.shape
    return float(image[rows // 2 - 1 : rows // 2 + 1, columns // 2 - 1 : columns // 2 + 1].mean())
