"""Real radiographs of a tooth, and another simulator's of an iron frame."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from xden1k.rays import ownership_order, path_lengths
from xden_builder.audit.object import audit_object
from xden_builder.capture import Capture, CaptureFolder
from xden_builder.cli import cli
from xden_builder.fit import FitSettings, fit_lac
from xden_builder.reconstruct.object import reconstruct


def folder_of(shared_data: Path, name: str) -> tuple[CaptureFolder, dict]:
    root = shared_data / f"captures-{name}"
    return CaptureFolder(root), json.loads((root / "expected.json").read_text())[name]


def shifted(capture: Capture, offset_cm: tuple[float, float, float]) -> Capture:
    moved = []
    for part in capture.parts:
        mesh = part.mesh.copy()
        mesh.apply_translation(offset_cm)
        moved.append(replace(part, mesh=mesh))
    return replace(capture, parts=tuple(moved))


def test_tooth_attenuation_is_within_two_percent_of_the_independent_ct(shared_data):
    folder, expected = folder_of(shared_data, "tooth")
    capture = folder.read("tooth")
    tooth = reconstruct(capture)
    for part in tooth.parts:
        reference = expected["reference"][part.name]["core_median_per_cm"]
        assert part.lac_per_cm == pytest.approx(reference, rel=0.02)
        assert np.isnan(part.density_g_cm3)
    assert tooth.density is None
    assert "attenuation_only" in tooth.flags
    audit = audit_object(tooth, capture, folder.ct("tooth"))
    assert all(view.transmission_corr > 0.99 for view in audit.views)
    assert audit.ct.voxel_mae_rel < 0.07
    assert audit.ct.mass_ratio == pytest.approx(1, abs=0.02)
    assert audit.ct.com_l1_cm < 0.002


@pytest.mark.parametrize("offset_cm", [(0.025, 0, 0), (0, 0.025, 0), (0.025, 0.025, 0)])
def test_tooth_with_parts_25_pixels_off_is_reported_bad(shared_data, offset_cm):
    folder, expected = folder_of(shared_data, "tooth")
    capture = shifted(folder.read("tooth"), offset_cm)
    audit = audit_object(reconstruct(capture), capture)
    assert not audit.good
    limit = expected["accept_controls" if "accept_controls" in expected else "controls"]
    limit = limit["accept_controls"]["shifted_transmission_corr_below"]
    assert min(view.transmission_corr for view in audit.views) < limit


def test_iron_frame_gives_its_density_and_every_view_of_the_other_simulator(shared_data):
    folder, expected = folder_of(shared_data, "tetra")
    capture = folder.read("tetra")
    tetra = reconstruct(capture)
    (iron,) = tetra.parts
    assert iron.lac_per_cm == pytest.approx(expected["mu_per_cm"], rel=1e-4)
    assert iron.density_g_cm3 == pytest.approx(7.87, rel=0.01)
    assert iron.density_source == "xray"
    assert abs(iron.density_g_cm3 - 7.874) < 2 * iron.density_sd_g_cm3
    assert tetra.mass_g == pytest.approx(expected["mass_g_at_7_874"], rel=0.003)
    audit = audit_object(tetra, capture)
    assert [view.name for view in audit.views] == ["pa", "lat", "f02", "f07", "f10", "f13"]
    assert [view.fitted for view in audit.views] == [True, True, False, False, False, False]
    assert max(view.transmission_mae for view in audit.views) < 2e-5


@pytest.mark.parametrize(
    ("subrays", "reached"), [(1, "1x1"), (3, "3x3"), (5, "5x5")], ids=["1x1", "3x3", "5x5"]
)
def test_iron_frame_as_others_reached_it_with_as_many_rays(shared_data, subrays, reached):
    folder, expected = folder_of(shared_data, "tetra")
    reached = expected["reached"][f"{reached} rays per pixel, intensities averaged"]
    capture = folder.read("tetra")
    meshes = [part.mesh for part in capture.parts]
    order = ownership_order(meshes)
    views = [(path_lengths(meshes, order, v.geometry, subrays), v) for v in capture.views]
    fit = fit_lac(views, FitSettings(gain="fixed", weights="none"))
    assert fit.lac_per_cm[0] == pytest.approx(reached["mu_per_cm"], rel=1e-4)


@pytest.mark.slow
def test_run_and_audit_a_real_capture_from_the_command_line(shared_data, tmp_path):
    captures, out = tmp_path / "captures", tmp_path / "tooth"
    shutil.copytree(shared_data / "captures-tooth", captures)  # a rebuild writes splits.csv
    runner = CliRunner()
    ran = runner.invoke(cli, ["run", str(captures), "--out", str(out), "--workers", "1"])
    assert ran.exit_code == 0, ran.output
    assert "1 built, 0 kept, 0 failed" in ran.output
    audited = runner.invoke(cli, ["audit", str(out), "--captures", str(captures), "--json"])
    assert audited.exit_code == 0, audited.output
    (report,) = json.loads(audited.output)["objects"]
    assert report["good"]
    assert report["ct"]["voxel_mae_rel"] < 0.07
