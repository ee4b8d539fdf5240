"""Settings and files of the simulated scanner."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.builder.scanner_scenes import TUBE
from xden1k.errors import DataError
from xden_builder.capture import CaptureFolder
from xden_builder.phantoms import (
    Plan,
    Scanner,
    make_phantom,
    truth_object,
    write_captures,
)
from xden_builder.phantoms.scanner import Signal, load_scanner


def test_ideal_has_no_effect_but_the_spectrum() -> None:
    ideal = Scanner.realistic(64).ideal()
    phantom = make_phantom(Plan.of(0, "mug-0000"))
    np.testing.assert_allclose(
        ideal.radiograph(phantom, "pa"), ideal.transmission(phantom, "pa"), atol=1e-6
    )
    assert ideal.mesh_error(phantom.plan).is_none
    assert ideal.exposure(phantom.plan, "pa") == 1.0
    on = {name for name, value in ideal.settings().items() if value != getattr(Scanner(), name)}
    assert on == {
        "energy_kev",
        "size_px",
        "quantum_noise",
        "readout_sd_counts",
        "exposure_sd",
        "bits",
    }


def test_default_scanner_is_the_monochromatic_one() -> None:
    assert Scanner() == Scanner.monochromatic()
    assert Scanner().energy_kev == 100.0


def test_scanner_file_replaces_what_it_names(tmp_path: Path) -> None:
    path = tmp_path / "scanner.toml"
    path.write_text("size_px = 1024\nscatter_level = 0.1\nkv = 90\nfiltration_cm = { Cu = 0.01 }\n")
    expected = replace(
        Scanner.realistic(1024), scatter_level=0.1, kv=90, filtration_cm={"Cu": 0.01}
    )
    assert load_scanner(path) == expected
    path.write_text('preset = "monochromatic"\nenergy_kev = 60.0\n')
    assert load_scanner(path) == Scanner(energy_kev=60.0)


EFFECTS_OFF = """
heel = false
focal_spot_cm = 0
detector_blur_cm = 0
glare_share = 0
scatter_level = 0
quantum_noise = false
readout_sd_counts = 0
dead_share = 0
exposure_sd = 0
bits = 0
mesh_rotation_deg = 0
mesh_shift_cm = 0
mesh_scale_sd = 0
mesh_tolerance_cm = 0
"""


def test_every_effect_can_be_switched_off_in_the_file(tmp_path: Path) -> None:
    path = tmp_path / "scanner.toml"
    path.write_text(EFFECTS_OFF)
    assert load_scanner(path) == Scanner.realistic().ideal()
    named = {line.split(" = ")[0] for line in EFFECTS_OFF.split("\n") if line}
    real, off = Scanner.realistic().settings(), Scanner.realistic().ideal().settings()
    assert named == {name for name in real if real[name] != off[name]}
    path.write_text('preset = "monochromatic"\nenergy_kev = 0\n')
    assert load_scanner(path).tube == TUBE


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("scater_level = 0.1", r"unknown keys \['scater_level'\]; known keys are"),
        ('preset = "ideal"', r"preset: expected one of .*'realistic'.*, got 'ideal'"),
        ("heel = 1", "heel: expected bool, got 1"),
        ("size_px = 64.5", "size_px: expected int, got 64.5"),
        ("glare_share = -0.1", "glare_share must not be negative, got -0.1"),
        ("energy_kev = 60.0", "heel effect needs a tube"),
        ("filtration_cm = { Al = '1 mm' }", "filtration_cm: expected Mapping"),
    ],
)
def test_scanner_file_with_a_fault_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "scanner.toml"
    path.write_text(text)
    with pytest.raises(DataError, match=message):
        load_scanner(path)


def test_realistic_captures_read_back_as_corrected_and_say_what_only_we_know(
    tmp_path: Path,
) -> None:
    scanner = Scanner.realistic(96)
    write_captures(tmp_path / "out", 2, 5, scanner=scanner, categories=["hammer", "mug"])
    folder = CaptureFolder(tmp_path / "out")
    for object_id in folder.object_ids:
        capture, phantom = folder.read(object_id), make_phantom(Plan.of(5, object_id))
        assert capture.tube == TUBE
        for view in capture.views:
            ours = scanner.corrected(phantom, view.name)
            np.testing.assert_array_equal(view.valid, ours.valid)
            np.testing.assert_allclose(view.transmission, ours.transmission, rtol=1e-6)
        truth = json.loads((tmp_path / "out" / object_id / "truth.json").read_text())
        assert truth["mass_g"] == phantom.mass_properties.mass_g
        assert 0 < truth["scatter_share"]["pa"] < 0.5
        matrix = np.array(truth["mesh_error"]["matrix"])
        turned_back = np.linalg.inv(matrix)
        for part, made in zip(capture.parts, phantom.parts, strict=True):
            assert not np.allclose(part.mesh.bounds, made.mesh.bounds, atol=1e-4)
            back = part.mesh.copy().apply_transform(turned_back)
            np.testing.assert_allclose(back.bounds, made.mesh.bounds, atol=0.02)
    kept = json.loads((tmp_path / "out" / "simulation.json").read_text())
    assert Scanner(**kept["scanner"]) == scanner


def test_truth_of_a_tube_is_taken_at_the_mean_energy_of_its_signal() -> None:
    scanner, phantom = Scanner.realistic(48), make_phantom(Plan.of(0, "mug-0000"))
    assert scanner.reference_kev == pytest.approx(52.07, abs=0.05)
    obj = truth_object(phantom, scanner)
    expected = replace(Scanner(), energy_kev=scanner.reference_kev).lac_per_cm(phantom)[0]
    assert obj.parts[0].lac_per_cm == pytest.approx(expected)


def test_signal_can_be_given_where_it_is_known() -> None:
    scanner, phantom = Scanner.realistic(48), make_phantom(Plan.of(0, "mug-0000"))
    signal = scanner.signal(phantom, "pa")
    assert isinstance(signal, Signal)
    np.testing.assert_array_equal(
        scanner.radiograph(phantom, "pa", signal), scanner.radiograph(phantom, "pa")
    )
