"""The direct beam of the simulated scanner against that of another simulator; effects."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from xden_builder.attenuation import mac_cm2_g
from xden_builder.capture import CaptureFolder, Tube
from xden_builder.phantoms import Plan, Scanner, make_phantom
from xden_builder.phantoms.scanner.beam import make_beam
from xden_builder.phantoms.scanner.effects import effect_sizes, effect_table
from xden_builder.phantoms.scanner.primary import Absorber, pixel_kernel, render


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
