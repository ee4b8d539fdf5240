"""Calibration by scans that another simulator made, told wrong: SpekPy's tubes, no copper told."""

import numpy as np
import pytest
from builder.folders import contents

from xden1k.values.materials import load_materials
from xden_builder.calibrate.designs import BALLS, PLATES
from xden_builder.calibrate.example import QUARTER, calibration_toml, wedge_entries
from xden_builder.calibrate.run import calibrate_scanner
from xden_builder.calibrate.sheets import write_ball_table
from xden_builder.capture import write_scanner
from xden_builder.capture.writing import write_image
from xden_builder.phantoms.peer.matter import mac_cm2_g
from xden_builder.phantoms.peer.objects import PeerObject, PeerPart
from xden_builder.phantoms.peer.radiograph import expose, make_beam
from xden_builder.phantoms.peer.setup import VIEWS, draw_setup
from xden_builder.phantoms.peer.substances import Substance
from xden_builder.phantoms.phantom import Plan
from xden_builder.physics.attenuation import mac_cm2_g as own_mac_cm2_g
from xden_builder.physics.spectrum import tube_spectrum

pytestmark = [pytest.mark.peer, pytest.mark.slow]
SIZE = 512


@pytest.fixture(autouse=True)
def _others():
    for name in ("xraylib", "spekpy", "gvxrPython3"):
        pytest.importorskip(name, exc_type=ImportError)


def part(name, mesh, material, turn):
    matrix = np.eye(4)
    matrix[:3, :3] = turn
    known = load_materials()[material]
    density = known.density_nominal_g_cm3
    made_of = Substance(name, material, known.composition, density, density)
    return PeerPart(name, mesh.copy().apply_transform(matrix), made_of, density, material)


def scan(setup, beam, parts, view, number, path):
    path.parent.mkdir(exist_ok=True)
    thing = PeerObject(Plan(1, 0, number), parts, np.eye(4), "", 0.0)
    write_image(path, expose(setup, beam, thing, view))


def write_scans(root, setup, beam):
    root.mkdir()
    entries = []
    for number, (name, stairs) in enumerate(PLATES.items()):
        for view, turn in zip(VIEWS, (np.eye(3), QUARTER), strict=True):
            parts = [part(each.name, each.mesh, each.material, turn) for each in stairs]
            scan(setup, beam, parts, view, number, root / name / f"{view}.tif")
            entries += wedge_entries(name, stairs, view, setup.geometry(view))
    balls = [
        part("balls", BALLS.balls_mesh, "steel", np.eye(3)),
        part("tube", BALLS.tube_mesh, "pmma", np.eye(3)),
    ]
    for view in VIEWS:
        scan(setup, beam, balls, view, len(PLATES), root / "balls" / f"{view}.tif")
    write_ball_table(root / "balls.csv")
    write_scanner(setup.told(copper=False), root / "scanner.toml")
    (root / "calibration.toml").write_text(calibration_toml(entries))


def transmissions(beam, tube, detector, formula, density, thickness):
    """By the other simulator, and by the calibrated tube."""
    composition, areal = ((formula, 1.0),), density * np.array(thickness)[:, None]
    true = np.exp(-areal * mac_cm2_g(composition, beam.energies_kev)) @ beam.weights
    spectrum = tube_spectrum(tube, detector=detector)
    return true, spectrum.transmission(areal * own_mac_cm2_g(composition, spectrum.energies_kev))


@pytest.mark.parametrize(("seed", "screen"), [(201, "csi"), (202, "gos")])
def test_another_simulators_scanner_is_found(tmp_path, seed, screen):
    setup = draw_setup(seed, SIZE, screen)
    beam = make_beam(setup)
    write_scans(tmp_path / "scans", setup, beam)
    before = contents(tmp_path / "scans")
    scanner = calibrate_scanner(tmp_path / "scans", tmp_path / "out").scanner
    assert contents(tmp_path / "scans") == before
    for formula, density, thickness, worst in (
        ("Al", 2.70, np.linspace(0.1, 4.0, 14), 0.01),
        ("Fe", 7.85, np.linspace(0.05, 1.0, 20), 0.02),
    ):
        true, found = transmissions(
            beam, scanner.tube, scanner.detector, formula, density, thickness
        )
        assert abs(found / true - 1).max() < worst
    for view in VIEWS:
        true, found = setup.geometry(view), scanner.views[view].geometry
        assert np.linalg.norm(found.source_cm - true.source_cm) < 0.1
        for step in ("column_step_cm", "row_step_cm"):
            off = np.linalg.norm(getattr(found, step) - getattr(true, step))
            assert off < 1e-3 * setup.pitch_cm
