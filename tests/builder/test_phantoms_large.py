"""Objects that the panel does not hold: scanned from twice as far, read back, rebuilt right."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from xden1k.errors import DataError
from xden1k.folder import open_folder
from xden_builder.capture import CaptureFolder
from xden_builder.phantoms import (
    Phantom,
    PhantomPart,
    Plan,
    Scanner,
    make_phantom,
    truth_object,
    write_captures,
)
from xden_builder.phantoms.realism import Realism
from xden_builder.phantoms.scanner import VIEWS
from xden_builder.pipeline.run import build
from xden_builder.reconstruct.settings import BuildSettings

pytestmark = pytest.mark.usefixtures("in_this_process")
DENSITIES = {"case": 0.61, "core": 2.68}


def crate(length_cm: float, plan: Plan | None = None) -> Phantom:
    """A long box of wood around a bar of aluminium."""
    case = trimesh.creation.box((length_cm, 12.0, 10.0))
    core = trimesh.creation.box((0.6 * length_cm, 2.0, 3.0))
    hole = core.copy()
    hole.invert()
    meshes = {"case": trimesh.util.concatenate([case, hole]), "core": core}
    materials = {"case": "wood_oak", "core": "aluminium"}
    return Phantom(
        plan or Plan(0, 0, 0),
        tuple(
            PhantomPart(name, "body", mesh, materials[name], DENSITIES[name], (0.5, 0.4, 0.3))
            for name, mesh in meshes.items()
        ),
    )


@pytest.fixture
def crates(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the first object of a set a crate of 55 cm."""

    def make(plan: Plan, realism: Realism) -> Phantom:
        return make_phantom(plan, realism) if plan.ordinal else crate(55.0, plan)

    monkeypatch.setattr("xden_builder.phantoms.writer.make_phantom", make)


def test_object_is_scanned_in_the_least_setting_that_holds_it() -> None:
    scanner = Scanner()
    assert scanner.setting_for(crate(30.0)) == ("standard", scanner)
    assert scanner.setting_for(crate(55.0)) == ("large", scanner.large())
    with pytest.raises(DataError, match=r"beyond the panel of view pa, and beyond one twice as w"):
        scanner.setting_for(crate(70.0))


def test_large_setting_sees_the_same_angles_with_as_many_quanta_a_pixel() -> None:
    standard = Scanner.realistic(64)
    large = standard.large()
    assert (large.panel_cm, large.source_object_cm, large.source_detector_cm) == (86.0, 200, 240)
    assert large.pixel_cm == 2 * standard.pixel_cm
    np.testing.assert_array_equal(large.beam.open_field, standard.beam.open_field)
    np.testing.assert_array_equal(large.beam.row_weights, standard.beam.row_weights)
    quanta = [
        scanner.beam.kev_per_cm2 * scanner.pixel_cm**2
        for scanner in (standard, large)
        if scanner.beam.kev_per_cm2
    ]
    assert quanta[0] == pytest.approx(quanta[1])
    ray = (20.0 * scanner.geometry("pa").column_step_cm for scanner in (standard, large))
    near, far = ray
    np.testing.assert_allclose(near / 120.0, far / 240.0)


def test_object_twice_as_large_and_half_as_dense_looks_the_same_in_the_large_setting() -> None:
    scanner = replace(Scanner(size_px=64), subrays=2).ideal()
    small = crate(20.0)
    double = Phantom(
        small.plan,
        tuple(
            replace(
                part,
                mesh=part.mesh.copy().apply_scale(2.0),
                density_g_cm3=part.density_g_cm3 / 2,
            )
            for part in small.parts
        ),
    )
    for view in VIEWS:
        np.testing.assert_allclose(
            scanner.large().transmission(double, view), scanner.transmission(small, view), atol=1e-6
        )


def test_panels_of_the_two_settings_are_dead_in_other_places() -> None:
    scanner = replace(Scanner.realistic(64), dead_share=0.05)
    dead = [each._panel(0, "pa", 16).dead for each in (scanner, scanner.large())]
    assert (dead[0] != dead[1]).any()


@pytest.mark.usefixtures("crates")
@pytest.mark.parametrize(
    ("ideal", "within"), [(True, 2e-4), pytest.param(False, 5e-3, marks=pytest.mark.slow)]
)
def test_long_crate_is_captured_read_back_and_rebuilt(
    tmp_path: Path, ideal: bool, within: float
) -> None:
    captures = tmp_path / "captures"
    write_captures(captures, 2, 0, size=128, ideal=ideal, categories=["hammer"])
    kept = {path.name for path in captures.iterdir()}
    assert ("large_flat_pa.tif" in kept) == ("large_dark_lat.tif" in kept) == (not ideal)
    assert not (captures / "hammer-0001" / "scanner.toml").exists()
    settings = {
        name: json.loads((captures / name / "truth.json").read_text())["setting"]
        for name in ("hammer-0000", "hammer-0001")
    }
    assert settings == {"hammer-0000": "large", "hammer-0001": "standard"}

    capture = CaptureFolder(captures).read("hammer-0000")
    scanner = Scanner(size_px=128).large()
    scanner = scanner.ideal() if ideal else scanner
    assert capture.flags == ()
    for view in capture.views:
        ours = scanner.corrected(crate(55.0, Plan.of(0, "hammer-0000")), view.name)
        np.testing.assert_allclose(view.transmission, ours.transmission, rtol=1e-6)
        np.testing.assert_array_equal(view.geometry.source_cm, ours.geometry.source_cm)

    report = build(captures, tmp_path / "out", BuildSettings(), workers=1)
    assert report.count("built") == 2
    rebuilt = open_folder(tmp_path / "out").object("hammer-0000")
    for part in rebuilt.parts:
        assert part.density_g_cm3 == pytest.approx(DENSITIES[part.name], rel=within)


def test_truth_as_a_dataset_is_of_the_same_setting() -> None:
    obj = truth_object(crate(55.0), Scanner(size_px=32).ideal())
    assert obj.meta["setting"] == "large"
    assert obj.meta["scanner"]["panel_cm"] == 86.0
    np.testing.assert_array_equal(obj.views[0].geometry.source_cm, [0.0, -200.0, 0.0])


@pytest.mark.usefixtures("crates")
def test_object_too_large_for_both_settings_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"^hammer-0000 reaches beyond the panel of view pa, and"):
        write_captures(
            tmp_path, 1, 0, scanner=Scanner(size_px=32, panel_cm=30.0), categories=["hammer"]
        )
