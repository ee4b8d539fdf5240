"""How much each effect of a scanner matters: the image with it against the image without.

``python -m xden_builder.phantoms.scanner.effects [SCANNER.toml]`` prints the table, of the
realistic scanner by default.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float
from tabulate import tabulate

from xden1k.values.arrays import Image, Mask
from xden_builder.phantoms.catalogue import CATALOGUE
from xden_builder.phantoms.phantom import Phantom, make_phantom, plan_objects
from xden_builder.phantoms.scanner.file import load_scanner
from xden_builder.phantoms.scanner.model import VIEWS, Scanner

__all__ = ["EffectSize", "effect_sizes", "effect_table", "main"]

FAINTEST = 0.02
"""Pixels darker than this are left out where -ln T is compared."""
LEAST_DEPTH = 0.05
"""And so are those behind next to nothing."""


@dataclass(frozen=True, slots=True)
class EffectSize:
    """How an effect changes images.

    Parameters
    ----------
    effect
        What is there in one image and not in the other.
    shadow
        Mean |difference of T| over the objects' shadows.
    shadow_worst
        Its 99th percentile.
    air
        Mean |difference of T| over all else.
    depth
        Median of p with the effect over p without it, less 1, where p = -ln T.
    """

    effect: str
    shadow: float
    shadow_worst: float
    air: float
    depth: float


def effect_sizes(phantoms: Sequence[Phantom], scanner: Scanner) -> list[EffectSize]:
    """Measure each effect of a polychromatic scanner by taking it away.

    Images are corrected by their open field, so that of the heel effect the hardness remains.
    Views of all objects are pooled. The spectrum is compared with photons of its mean energy.

    Parameters
    ----------
    phantoms
        A few objects, whose masks are their shadows.
    scanner
        :meth:`Scanner.realistic`, or another with a tube.
    """
    changes: dict[str, list[_Change]] = {name: [] for name in _PAIRS}
    for phantom in phantoms:
        _, chosen = scanner.setting_for(phantom)
        cameras = _cameras(replace(chosen, dead_share=0.0))
        for view in VIEWS:
            images = {name: camera(phantom, view) for name, camera in cameras.items()}
            shadow = images["spectrum alone"] < 1
            for name, (there, absent) in _PAIRS.items():
                changes[name].append(_change(images[there], images[absent], shadow))
    return [_size(name, change) for name, change in changes.items()]


def effect_table(sizes: Sequence[EffectSize]) -> str:
    """Write effect sizes as a Markdown table."""
    table: str = tabulate(
        [
            (
                size.effect,
                f"{size.shadow:.5f}",
                f"{size.shadow_worst:.5f}",
                f"{size.air:.5f}",
                f"{size.depth:+.2%}",
            )
            for size in sizes
        ],
        headers=("effect", "mean change of T, shadow", "99 %", "mean, air", "-ln T, median"),
        tablefmt="github",
        disable_numparse=True,
    )
    return table


_Camera = Callable[[Phantom, str], Image]
_Change = tuple[Float[np.ndarray, "_"], Float[np.ndarray, "_"], Float[np.ndarray, "_"]]
"""Shadow, air, and what is seen behind something."""

_PAIRS = {
    "spectrum": ("spectrum alone", "one energy"),
    "heel effect": ("expected", "no heel"),
    "scatter": ("expected", "no scatter"),
    "glare": ("expected", "no glare"),
    "focal spot": ("expected", "no focal spot"),
    "detector blur": ("expected", "no detector blur"),
    "exposure": ("exposed", "expected"),
    "noise of quanta": ("noise of quanta", "exposed"),
    "electronic noise": ("electronic noise", "exposed"),
    "mesh error": ("misplaced", "spectrum alone"),
}
"""The image with the effect, and that without."""


def _cameras(scanner: Scanner) -> dict[str, _Camera]:
    floating = replace(scanner, bits=None)
    expected, alone = replace(floating, exposure_sd=0.0), scanner.ideal()
    return {
        "expected": expected.radiograph,
        "no heel": replace(expected, heel=False).radiograph,
        "no scatter": replace(expected, scatter_level=0.0).radiograph,
        "no glare": replace(expected, glare_share=0.0).radiograph,
        "no focal spot": replace(expected, focal_spot_cm=0.0).radiograph,
        "no detector blur": replace(expected, detector_blur_cm=0.0).radiograph,
        "exposed": floating.radiograph,
        "noise of quanta": _noisy(replace(scanner, readout_sd_counts=0.0)),
        "electronic noise": _noisy(replace(scanner, quantum_noise=False)),
        "spectrum alone": alone.transmission,
        "one energy": replace(alone, energy_kev=scanner.reference_kev).transmission,
        "misplaced": _misplaced(scanner),
    }


def _noisy(scanner: Scanner) -> _Camera:
    """Take counts; the flat averages so many frames that it adds no noise of its own."""
    still = replace(scanner, flat_frames=10**6)
    return lambda phantom, view: still.corrected(phantom, view).transmission


def _misplaced(scanner: Scanner) -> _Camera:
    """Take what the meshes handed over would show."""

    def image(phantom: Phantom, view: str) -> Image:
        error = scanner.mesh_error(phantom.plan)
        parts = tuple(replace(part, mesh=error.applied(part.mesh)) for part in phantom.parts)
        return scanner.ideal().transmission(Phantom(phantom.plan, parts), view)

    return image


def _change(there: Image, absent: Image, shadow: Mask) -> _Change:
    """|Difference| in the shadow and beside it, and relative difference of -ln T."""
    one, other = there.astype(np.float64), absent.astype(np.float64)
    size = np.abs(one - other)
    seen = shadow & (np.minimum(one, other) > FAINTEST) & (other < np.exp(-LEAST_DEPTH))
    return size[shadow], size[~shadow], np.log(one[seen]) / np.log(other[seen]) - 1


def _size(name: str, changes: Sequence[_Change]) -> EffectSize:
    shadow, air, depth = (np.concatenate(each) for each in zip(*changes, strict=True))
    return EffectSize(
        name,
        float(shadow.mean()),
        float(np.quantile(shadow, 0.99)),
        float(air.mean()),
        float(np.median(depth)),
    )


def main(arguments: Sequence[str]) -> None:
    """Print the table for the first object, of seed 0, of every twelfth category."""
    scanner = load_scanner(Path(arguments[0])) if arguments else Scanner.realistic()
    phantoms = [make_phantom(plan) for plan in plan_objects(len(CATALOGUE), 0)[::12]]
    sys.stdout.write(effect_table(effect_sizes(phantoms, scanner)) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
