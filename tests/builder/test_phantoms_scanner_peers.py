"""The direct beam of the simulated scanner against two X-ray simulators by others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from xden1k.values.arrays import Image
from xden_builder.capture import CaptureFolder
from xden_builder.phantoms import CATALOGUE, Phantom, PhantomPart, Plan, Scanner, make_phantom
from xden_builder.phantoms.peer.rays import gvxr
from xden_builder.phantoms.scanner.beam import make_beam
from xden_builder.phantoms.scanner.effects import effect_sizes, effect_table, main
from xden_builder.phantoms.scanner.primary import Absorber, pixel_kernel, render
from xden_builder.physics.attenuation import mac_cm2_g
from xden_builder.physics.source import Tube

KEV = 60.0


def test_iron_frame_looks_as_artist_sees_it(shared_data: Path) -> None:
    """aRTist 2.12.6 at 130 keV, which averaged the intensity of 3 x 3 rays a pixel."""
    capture = CaptureFolder(shared_data / "captures-tetra").read("tetra")
    tube = Tube(energy_kev=130.0)
    beam = make_beam(
        tube,
        groups=1,
        scintillator_g_cm2=0.22,
        heel=False,
        size_px=150,
        panel_cm=19.5,
        distance_cm=40.0,
    )
    lac = np.array([[7.874 * float(mac_cm2_g((("Fe", 1.0),), 130.0))]], dtype=np.float32)
    iron = Absorber([part.mesh for part in capture.parts], lac, lac)
    for view in (*capture.views, *capture.audit_views):
        made = render(iron, beam, view.geometry, 3, pixel_kernel(3, 0.13, 0.0, 0.0))
        difference = np.abs(made.transmission - view.transmission)[made.scattered > 0]
        assert difference.mean() < 5e-4
        assert difference.max() < 1e-3


def ball_and_rod() -> list[Phantom]:
    shapes = {
        "ball": trimesh.creation.icosphere(subdivisions=6, radius=3.0),
        "rod": trimesh.creation.cylinder(radius=2.0, height=8.0, sections=256),
    }
    return [
        Phantom(Plan(0, 0, 0), (PhantomPart(name, "body", mesh, "water", 1.0, (0.5, 0.5, 0.5)),))
        for name, mesh in shapes.items()
    ]


def seen_by_gvxr(library: Any, phantom: Phantom, scanner: Scanner) -> Image:
    """Transmission of the PA view by gVirtualXray, one energy, no detector response."""
    geometry = scanner.geometry("pa")
    library.removePolygonMeshesFromSceneGraph()
    assert geometry.source_cm is not None
    library.setSourcePosition(*geometry.source_cm.tolist(), "cm")
    library.usePointSource()
    library.setMonoChromaticPerPixelAtSDD(KEV, "keV", 1)
    behind = scanner.source_detector_cm - scanner.source_object_cm
    library.setDetectorPosition(0.0, behind, 0.0, "cm")
    library.setDetectorUpVector(0, 0, -1)
    library.setDetectorRightVector(*(-geometry.column_step_cm / scanner.pixel_cm).tolist())
    library.setDetectorNumberOfPixels(scanner.size_px, scanner.size_px)
    library.setDetectorPixelSize(scanner.pixel_cm, scanner.pixel_cm, "cm")
    for part, lac_per_cm in zip(phantom.parts, scanner.lac_per_cm(phantom).tolist(), strict=True):
        corners = np.asarray(part.mesh.vertices, dtype=np.float32).ravel().tolist()
        library.makeTriangularMesh(part.name, corners, part.mesh.faces.ravel().tolist(), "cm")
        library.addPolygonMeshAsInnerSurface(part.name)
        library.setLinearAttenuationCoefficient(part.name, lac_per_cm, "cm-1")
    image = np.asarray(library.computeXRayImage(), dtype=np.float32)
    # its columns run to the left of a viewer for whom its rows run down
    return np.fliplr(image) / np.float32(library.getTotalEnergyWithDetectorResponse())


@pytest.mark.peer
def test_direct_beam_is_that_of_gvirtualxray() -> None:
    reason = "gVirtualXray (gvxr) cannot be imported here"
    pytest.importorskip("gvxrPython3", reason=reason, exc_type=ImportError)
    scanner = Scanner(size_px=256, panel_cm=21.5, subrays=1, energy_kev=KEV).ideal()
    names = ("screwdriver-0000", "padlock-0000")
    for phantom in (*ball_and_rod(), *(make_phantom(Plan.of(3, name)) for name in names)):
        theirs, ours = seen_by_gvxr(gvxr(), phantom, scanner), scanner.transmission(phantom, "pa")
        # interior pixels: those whose neighbourhood is smooth, for edges are sampled differently
        steps = np.stack([np.abs(ours - np.roll(ours, 1, axis)) for axis in (0, 1)]).max(axis=0)
        near = np.stack([np.roll(steps, (i, j), (0, 1)) for i in (-1, 0, 1) for j in (-1, 0, 1)])
        inside = (ours < 0.999) & (near.max(axis=0) < 0.02)
        assert inside.sum() > 200
        assert np.sqrt(((theirs - ours)[inside] ** 2).mean()) < 2e-5


def test_effects_are_measured_by_taking_them_away() -> None:
    phantoms = [make_phantom(Plan.of(3, name)) for name in ("mug-0000", "hammer-0000")]
    sizes = {size.effect: size for size in effect_sizes(phantoms, Scanner.realistic(64))}
    assert sizes["scatter"].depth < 0 < sizes["spectrum"].depth
    assert sizes["scatter"].shadow > sizes["glare"].shadow > sizes["focal spot"].shadow > 0
    assert sizes["electronic noise"].shadow < 1e-4
    assert sizes["exposure"].air == pytest.approx(0.03, abs=0.03)
    lines = effect_table(list(sizes.values())).splitlines()
    assert len(lines) == 2 + len(sizes)
    assert lines[0].startswith("| effect")


def test_table_of_effects_is_printed_for_the_scanner_of_a_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("xden_builder.phantoms.scanner.effects.CATALOGUE", CATALOGUE[:1])
    path = tmp_path / "scanner.toml"
    path.write_text("size_px = 24\nsubrays = 1\nenergy_groups = 2\nglare_share = 0\n")
    main([str(path)])
    rows = {line.split("|")[1].strip(): line for line in capsys.readouterr().out.splitlines()}
    assert "0.00000" in rows["glare"]
    assert "mesh error" in rows
