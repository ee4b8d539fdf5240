"""Painted radiographs of wedges, whose light is known exactly, and folders around them."""

import json
from dataclasses import replace

import numpy as np

from xden1k.values.materials import load_materials
from xden1k.values.views import ViewGeometry, XRayView
from xden_builder.calibrate.told import Wedge
from xden_builder.capture import ScannerFile, ViewFile, write_scanner
from xden_builder.capture.calibration import CalibratedView
from xden_builder.capture.writing import write_image
from xden_builder.physics.attenuation import mac_cm2_g
from xden_builder.physics.source import Detector, Tube
from xden_builder.physics.spectrum import tube_spectrum

SIDE = 96
TOLD = Tube(kv=100.0, filtration_cm={"Al": 0.25})
TRUE = Tube(kv=97.0, filtration_cm={"Al": 0.25, "Cu": 0.02})
TRUE_PANEL = Detector("CsI", layer_g_cm2=0.28, escape=0.15)
STEPS = {
    "aluminium": (0.1, 0.2, 0.5, 1.0, 2.0, 3.0, 4.0),
    "steel": (0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0),
    "lead": (0.3, 0.3),
}
ORDER = {"schema": "xden-calibration/1", "date": "2026-03-14"}


def geometry(view="pa", side=SIDE):
    """A cone of 100 and 120 cm, as the panels of the simulators stand."""
    along, right = {"pa": ((0, 1, 0), (1, 0, 0)), "lat": ((1, 0, 0), (0, -1, 0))}[view]
    along, right, down = (np.array(each, dtype=float) for each in (along, right, (0, 0, -1)))
    pitch = 43.0 / side
    return ViewGeometry(
        beam="cone",
        source_cm=-100.0 * along,
        pixel00_cm=20.0 * along - (43.0 - pitch) / 2 * (right + down),
        column_step_cm=pitch * right,
        row_step_cm=pitch * down,
        shape=(side, side),
    )


def wedges(**changes):
    """Columns of steps, 9 rows each and 12 columns wide."""
    known = load_materials()
    return [
        replace(
            Wedge(
                scan="plate",
                view="pa",
                material=known[name],
                density_g_cm3=known[name].density_nominal_g_cm3,
                thickness_cm=steps,
                first_px=(12.0, 24.0 + 24 * place),
                last_px=(12.0 + 9 * (len(steps) - 1), 24.0 + 24 * place),
                step_cm=9 * 43.0 / SIDE / 1.2,
                width_cm=12 * 43.0 / SIDE / 1.2,
            ),
            **changes,
        )
        for place, (name, steps) in enumerate(STEPS.items())
    ]


def painted(tube=TRUE, even=0.0, gain=1.0):
    """What the steps let pass, along slanted rays too; stray light is the same everywhere."""
    spectrum = tube_spectrum(tube, detector=TRUE_PANEL)
    image = np.ones((SIDE, SIDE))
    rows, columns = np.indices(image.shape)
    away = 43.0 / SIDE * np.hypot(rows - (SIDE - 1) / 2, columns - (SIDE - 1) / 2) / 120.0
    slant = np.sqrt(1 + away**2)
    for wedge in wedges():
        lac = wedge.density_g_cm3 * mac_cm2_g(wedge.material.composition, spectrum.energies_kev)
        for (row, column), thickness in zip(wedge.centres_px, wedge.thickness_cm, strict=True):
            step = (abs(rows - row) <= 4) & (abs(columns - column) <= 6)
            image[step] = spectrum.transmission((thickness * slant[step])[:, None] * lac)
    return gain * (image + even)


def seen(image):
    """As a view that was read."""
    pixels = np.asarray(image, dtype=np.float32)
    view = XRayView("pa", pixels, np.ones(pixels.shape, dtype=np.bool_), geometry())
    return CalibratedView(view, (), None)


def write_folder(root, image=None, entries=None, balls="", **top):
    """A folder with one painted plate; ``entries`` replaces keys of its wedges."""
    views = {
        name: ViewFile(f"{name}.tif", "transmission", geometry(name)) for name in ("pa", "lat")
    }
    (root / "plate").mkdir(parents=True)
    write_scanner(ScannerFile(views, TOLD, Detector("CsI")), root / "scanner.toml")
    write_image(root / "plate" / "pa.tif", np.float32(painted() if image is None else image))
    lines = [f'{key} = "{value}"' for key, value in (ORDER | top).items() if key != "date"]
    lines.append(f"date = {(ORDER | top)['date']}")
    for wedge in wedges():
        values = {
            "scan": wedge.scan,
            "view": wedge.view,
            "material": wedge.material.name,
            "thickness_cm": list(wedge.thickness_cm),
            "first_px": list(wedge.first_px),
            "last_px": list(wedge.last_px),
            "step_cm": wedge.step_cm,
            "width_cm": wedge.width_cm,
        } | (entries or {}).get(wedge.material.name, {})
        lines += ["[[wedges]]", *(f"{key} = {json.dumps(value)}" for key, value in values.items())]
    (root / "calibration.toml").write_text("\n".join([*lines, balls, ""]))
    return root
