"""What befalls the files of one object, drawn as often as in meshes from generators and scans."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Final

from xden_builder.phantoms.phantom import Plan

__all__ = ["Defects", "draw_defects"]

DROPPED_SHARES: Final = (0.0, 0.002, 0.01)
OPEN_BOTTOM: Final = 0.30
FLIPPED: Final = 0.35
INNER_FACES: Final = 0.20
BY_MATERIAL: Final = 0.50
NO_TABLE: Final = 0.15
SIZE_SD: Final = 0.004


@dataclass(frozen=True, slots=True)
class Defects:
    """Flaws of one object's files; seams of the texture, which split vertices, are always there.

    Parameters
    ----------
    dropped_share
        Of the faces that are missing, here and there.
    open_bottom
        Whether what the object stands on was never seen.
    flipped
        Whether a patch of faces is wound the other way.
    inner_faces
        Whether faces of inner surfaces were left in.
    by_material
        Whether the scene has one geometry for each material, rather than one in all.
    no_table
        Whether ``part_lac_density.json`` is missing.
    size_factors
        By which the stated size is off, by axis of the mesh file.
    """

    dropped_share: float
    open_bottom: bool
    flipped: bool
    inner_faces: bool
    by_material: bool
    no_table: bool
    size_factors: tuple[float, float, float]

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON."""
        return asdict(self)


def draw_defects(plan: Plan) -> Defects:
    """Draw the flaws of an object, each by itself."""
    rng = plan.rng("twin defects")
    first, second, third = (1.0 + SIZE_SD * rng.standard_normal(3)).tolist()
    return Defects(
        dropped_share=float(rng.choice(DROPPED_SHARES)),
        open_bottom=bool(rng.random() < OPEN_BOTTOM),
        flipped=bool(rng.random() < FLIPPED),
        inner_faces=bool(rng.random() < INNER_FACES),
        by_material=bool(rng.random() < BY_MATERIAL),
        no_table=bool(rng.random() < NO_TABLE),
        size_factors=(first, second, third),
    )
