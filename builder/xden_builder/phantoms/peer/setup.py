"""One scanner of the bench: as it is, and as its ``scanner.toml`` tells."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np

from xden1k.values.arrays import Vec3
from xden1k.values.views import ViewGeometry
from xden_builder.capture import ScannerFile, ViewFile
from xden_builder.phantoms.peer.screen import Screen, draw_screen
from xden_builder.phantoms.peer.tube import PeerTube, draw_tube
from xden_builder.phantoms.phantom import random_numbers
from xden_builder.physics.source import Detector

__all__ = ["VIEWS", "BenchSettings", "Setup", "draw_setup"]

VIEWS: Final = ("pa", "lat")
PANEL_CM: Final = 43.0
OFF_CM: Final = 0.1
"""How far source and panel may be from where they are said to be."""
_ALONG: Final = {"pa": (0.0, 1.0, 0.0), "lat": (1.0, 0.0, 0.0)}
_RIGHT: Final = {"pa": (1.0, 0.0, 0.0), "lat": (0.0, -1.0, 0.0)}
_DOWN: Final = (0.0, 0.0, -1.0)
_NOWHERE: Final = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class BenchSettings:
    """What decides a folder's images.

    Parameters
    ----------
    seed
        Of scanner and objects.
    size_px
        Pixels along each side of a panel.
    screen
        A key of :data:`xden_builder.phantoms.peer.screen.SCREENS`.
    scatter
        Factor on single scatter; None: drawn for each object.
    unannotated_share
        Of the objects of two parts or more: one part has no mesh.
    """

    seed: int
    size_px: int = 256
    screen: str = "csi"
    scatter: float | None = None
    unannotated_share: float = 0.0


@dataclass(frozen=True, slots=True)
class Setup:
    """A scanner, the same for all objects of a folder.

    Parameters
    ----------
    size_px
        Pixels along each side of a panel.
    tube, screen
        What sends photons and what stops them.
    source_object_cm, gap_cm
        From the focal spot to the origin of the object frame, and on to the panel.
    blur_cm
        Standard deviation of the spread of light on the panel.
    source_off_cm, panel_off_cm
        By view: where source and panel are, less where they are said to be.
    """

    size_px: int
    tube: PeerTube
    screen: Screen
    source_object_cm: float
    gap_cm: float
    blur_cm: float
    source_off_cm: dict[str, tuple[float, float, float]]
    panel_off_cm: dict[str, tuple[float, float, float]]

    @property
    def pitch_cm(self) -> float:
        """Width of a pixel."""
        return PANEL_CM / self.size_px

    def geometry(self, view: str) -> ViewGeometry:
        """Place a view as it is."""
        return self._placed(view, self.source_off_cm[view], self.panel_off_cm[view])

    def told(self, *, copper: bool) -> ScannerFile:
        """Return what the lab says of the scanner, of its copper only if it knows of it."""
        views = {
            view: ViewFile(f"{view}.tif", "transmission", self._placed(view, _NOWHERE, _NOWHERE))
            for view in VIEWS
        }
        return ScannerFile(views, self.tube.told(copper=copper), Detector(self.screen.told))

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON."""
        return asdict(self)

    def _placed(
        self,
        view: str,
        source_off_cm: tuple[float, float, float],
        panel_off_cm: tuple[float, float, float],
    ) -> ViewGeometry:
        along, right, down = (np.array(each) for each in (_ALONG[view], _RIGHT[view], _DOWN))
        middle = self.gap_cm * along + np.array(panel_off_cm)
        return ViewGeometry(
            beam="cone",
            source_cm=np.array(source_off_cm) - self.source_object_cm * along,
            pixel00_cm=middle - (PANEL_CM - self.pitch_cm) / 2 * (right + down),
            column_step_cm=self.pitch_cm * right,
            row_step_cm=self.pitch_cm * down,
            shape=(self.size_px, self.size_px),
        )


def draw_setup(seed: int, size_px: int, screen: str) -> Setup:
    """Draw a scanner: 90 to 150 cm from source to object, 15 to 35 cm on to the panel."""
    rng = random_numbers(seed, "peer/scanner")
    return Setup(
        size_px=size_px,
        tube=draw_tube(rng),
        screen=draw_screen(rng, screen),
        source_object_cm=round(rng.uniform(90.0, 150.0), 1),
        gap_cm=round(rng.uniform(15.0, 35.0), 1),
        blur_cm=round(rng.uniform(0.01, 0.04), 4),
        source_off_cm={view: _off(rng) for view in VIEWS},
        panel_off_cm={view: _off(rng) for view in VIEWS},
    )


def _off(rng: np.random.Generator) -> tuple[float, float, float]:
    """Draw a shift in any direction."""
    way: Vec3 = rng.normal(size=3)
    x, y, z = (OFF_CM * rng.random() * way / np.linalg.norm(way)).tolist()
    return x, y, z
