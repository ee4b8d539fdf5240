"""Tubes by SpekPy (Poludniowski et al. 2021, doi:10.1002/mp.14945), and what a lab says of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from xden1k.errors import require
from xden_builder.phantoms.peer.matter import EXTRA
from xden_builder.physics.source import Tube

__all__ = ["PeerTube", "draw_tube"]

CONSOLE_KV: Final = 100.0
"""What the console shows; generators may be off by a few percent."""
AIR_CM: Final = 100.0
LOWEST_KEV: Final = 12.0
"""Fewer than 1e-6 of the photons below it pass 2 mm of aluminium and the air."""


@dataclass(frozen=True, slots=True)
class PeerTube:
    """A tungsten tube as it is.

    Parameters
    ----------
    kv, anode_deg, mas
        Voltage, angle of the anode and charge.
    aluminium_cm, copper_cm
        Filters.
    """

    kv: float
    anode_deg: float
    mas: float
    aluminium_cm: float
    copper_cm: float

    def photons_per_cm2(self) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
        """Energies of the 1 keV bins and the photons in each, at 100 cm on the central ray.

        By SpekPy's model ``kqp``; the tables of the fit are made with another one.

        Raises
        ------
        MissingExtraError
            If SpekPy is not installed.
        """
        spek = require("spekpy", EXTRA).Spek(
            kvp=self.kv, th=self.anode_deg, dk=1.0, physics="kqp", z=AIR_CM, mas=self.mas
        )
        spek.filter("Al", 10 * self.aluminium_cm).filter("Cu", 10 * self.copper_cm)
        energies_kev, fluence = spek.filter("Air", 10 * AIR_CM).get_spectrum(diff=False)
        kept = energies_kev > LOWEST_KEV
        return np.asarray(energies_kev[kept]), np.asarray(fluence[kept])

    def told(self, *, copper: bool) -> Tube:
        """Return what the lab states: the console's voltage, aluminium as guaranteed, plates.

        Parameters
        ----------
        copper
            Whether it knows of the copper.

        Examples
        --------
        >>> tube = PeerTube(102.0, 14.0, 100.0, aluminium_cm=0.29, copper_cm=0.0104)
        >>> tube.told(copper=True).filtration_cm
        {'Al': 0.25, 'Cu': 0.01}
        """
        filters = {"Al": math.floor(20 * self.aluminium_cm + 1e-9) / 20}
        if copper and (plates_cm := round(self.copper_cm, 2)):
            filters["Cu"] = plates_cm
        return Tube(kv=CONSOLE_KV, mas=self.mas, filtration_cm=filters)


def draw_tube(rng: np.random.Generator) -> PeerTube:
    """Draw a tube: 95 to 105 kV, 8 to 16 degrees, 2 to 4 mm Al, plates of up to 0.3 mm Cu.

    A plate is as thick as it should be within 5 %.
    """
    return PeerTube(
        kv=round(rng.uniform(95.0, 105.0), 1),
        anode_deg=round(rng.uniform(8.0, 16.0), 1),
        mas=float(rng.choice([40.0, 80.0, 125.0])),
        aluminium_cm=round(rng.uniform(0.2, 0.4), 3),
        copper_cm=round(float(rng.choice([0.0, 0.01, 0.02, 0.03])) * rng.uniform(0.95, 1.05), 5),
    )
