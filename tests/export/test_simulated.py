"""An exported object moves in MuJoCo as the real one would."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests import phantoms
from tests.export.flight import fly, frame, spin
from tests.phantoms import Box
from xden1k.access.hub import SAMPLE
from xden1k.export import export
from xden1k.export.body import body_of
from xden1k.folder import open_folder

HAMMER = (
    Box("handle", (-24, -1.5, 0), (0, 1.5, 2.4), 0.7),
    Box("head", (0, -5, 0), (3, 5, 3), 7.85),
)
CLEAR_CM = 0.3
"""How far from its centre of mass the table ends."""


@pytest.mark.parametrize("object_id", ["hammer-0000", "power_drill-0000"])
def test_it_falls_and_spins_by_the_closed_form(object_id: str, tmp_path: Path) -> None:
    obj = open_folder(SAMPLE).object(object_id)
    inertial = body_of(obj).inertial
    centre_m, spun = fly(export(obj, "mjcf", tmp_path), inertial, 0.5)
    assert centre_m < 1e-6
    assert spun < 1e-6


def test_the_closed_form_keeps_energy_and_momentum() -> None:
    for obj in (phantoms.objects()[1], phantoms.box_object("hammer-0009", HAMMER)):
        moments, _ = frame(body_of(obj).inertial)
        start, later = (spin(moments, np.array([1.0, 0, 6.0]), time) for time in (0.0, 0.7))
        assert moments @ later**2 == pytest.approx(moments @ start**2)
        assert np.linalg.norm(moments * later) == pytest.approx(np.linalg.norm(moments * start))
        assert abs(later[1]) > 0.01  # else it shows nothing


def settled_tilt(path: Path, edge_m: float) -> float:
    """Degrees by which a body has turned, a second after it was laid on a table's edge."""
    spec = mujoco.MjSpec.from_file(str(path))
    spec.option.timestep = 0.002
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX, size=[1, 1, 0.1], pos=[edge_m - 1, 0, -0.1]
    )
    model = spec.compile()
    data = mujoco.MjData(model)
    for _ in range(500):
        mujoco.mj_step(model, data)
    return float(np.degrees(np.arccos(np.clip(data.xmat[1][8], -1, 1))))


def test_a_hammer_on_an_edge_tips_where_its_centre_says(tmp_path: Path) -> None:
    hammer = phantoms.box_object("hammer-0009", HAMMER)
    true = float(hammer.com_cm[0])
    volumes = [float(part.mesh.volume) for part in hammer.parts]
    centres = [float(part.mesh.center_mass[0]) for part in hammer.parts]
    assert np.average(centres, weights=volumes) < true - 5  # a uniform solid would stay on
    path = export(hammer, "mjcf", tmp_path)
    assert settled_tilt(path, (true + CLEAR_CM) / 100) < 1
    assert settled_tilt(path, (true - CLEAR_CM) / 100) > 15
