"""``nerf2physics`` and ``pugs``: clouds of a scene, and masses in a JSON file beside the scenes.

::

    RUNS/scenes/NAME/points.npz    NeRF2Physics: points (N, 3), scene's frame, density (N, 2)
    RUNS/preds/preds_mass.json     NAME: [low, high] kg; may be missing

    RUNS/scenes/NAME/pred_result_density/dense_points.npy         PUGS: (N, 3), scene's frame
    RUNS/scenes/NAME/pred_result_density/dense_pred_density.npy   (N, 2)
    RUNS/preds/preds_density.json                                 NAME: [low, high] kg

Densities are in kg/m³, scenes in metres. NeRF2Physics computes points and densities and keeps
neither: ``points.npz`` has to be written where its grid mode has them, as ``query_pts`` and
``query_pred_vals``. Its reader of point clouds has taken them out of the reconstruction's frame
already, so ``dataparser_transforms.json`` is not applied again.
"""

from __future__ import annotations

from pathlib import Path

from xden_baselines.adapters.cloud import Cloud, middle
from xden_baselines.adapters.files import (
    checked_points,
    numbers,
    read_json,
    read_npy,
    read_npz,
)

__all__ = ["read_nerf2physics", "read_pugs"]

G_PER_KG = 1000.0


def read_nerf2physics(runs: Path, name: str) -> Cloud:
    """Read a scene of NeRF2Physics, in the frame of its cameras.

    Raises
    ------
    DataError
        If a file is missing or breaks its format.
    """
    path = runs / "scenes" / name / "points.npz"
    points, density = checked_points(
        read_npz(path, ("points", "density")), "points", "density", path
    )
    return Cloud(
        points,
        middle(density, f"{path}: density"),
        "kg/m3",
        mass_native_g=_mass_g(runs / "preds" / "preds_mass.json", name),
    )


def read_pugs(runs: Path, name: str) -> Cloud:
    """Read a scene of PUGS.

    Raises
    ------
    DataError
        If a file is missing or breaks its format.
    """
    folder = runs / "scenes" / name / "pred_result_density"
    arrays = {
        one: read_npy(folder / f"{one}.npy") for one in ("dense_points", "dense_pred_density")
    }
    points, density = checked_points(arrays, "dense_points", "dense_pred_density", folder)
    return Cloud(
        points,
        middle(density, f"{folder}/dense_pred_density.npy"),
        "kg/m3",
        mass_native_g=_mass_g(runs / "preds" / "preds_density.json", name),
    )


def _mass_g(path: Path, name: str) -> float | None:
    """Middle of the mass that the run itself gives; None if it has none."""
    masses = read_json(path) if path.exists() else {}
    if name not in masses:
        return None
    where = f"{path}: {name}"
    low_high = numbers(masses[name], (2,), where)
    return G_PER_KG * float(middle(low_high[None], where)[0])
