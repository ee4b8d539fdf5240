"""Calibration: what painted wedges and balls at known places must give back, and bad folders."""

import datetime
import json
import re
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from builder.calibration_scenes import (
    TOLD,
    TRUE,
    TRUE_PANEL,
    geometry,
    painted,
    seen,
    wedges,
    write_folder,
)
from builder.folders import contents
from click.testing import CliRunner

from xden1k.errors import DataError
from xden1k.values.views import XRayView
from xden_builder.calibrate import geometry as bundle
from xden_builder.calibrate import run as calibration
from xden_builder.calibrate import spectrum
from xden_builder.calibrate.balls import shadow_centres
from xden_builder.calibrate.designs import BALLS, PLATES
from xden_builder.calibrate.example import draw_scanner
from xden_builder.calibrate.light import light_up
from xden_builder.calibrate.readings import read_image_steps
from xden_builder.calibrate.response import Response
from xden_builder.calibrate.run import calibrate_scanner
from xden_builder.calibrate.spectrum import fit_spectrum
from xden_builder.calibrate.told import ToldBalls, read_folder
from xden_builder.capture import read_scanner, write_scanner
from xden_builder.cli import cli
from xden_builder.physics.attenuation import mac_cm2_g
from xden_builder.physics.source import Detector
from xden_builder.physics.spectrum import tube_spectrum

CSI = Detector("CsI")


def transmissions(
    tube, formula="Fe", density=7.85, thickness=(0.05, 0.1, 0.3, 0.5, 1.0), detector=CSI
):
    beam = tube_spectrum(tube, detector=detector)
    lac = density * mac_cm2_g(((formula, 1.0),), beam.energies_kev)
    return beam.transmission(np.array(thickness)[:, None] * lac)


@pytest.fixture(scope="module")
def fit():
    image = read_image_steps(seen(painted(even=0.004, gain=1.03)), wedges())
    return fit_spectrum([image], Response(TOLD, CSI))


def test_a_spectrum_that_was_told_wrong_is_found_through_gain_and_stray_light(fit):
    tube, found = fit.response.tube, {"detector": fit.response.detector}
    true = {"detector": TRUE_PANEL}
    off = transmissions(tube, **found) / transmissions(TRUE, **true) - 1
    assert abs(off[:-1]).max() < 0.01
    assert abs(off[-1]) < fit.probe_sd[-1] < 0.08  # 10 mm of steel beside twice the stray light
    aluminium = {"formula": "Al", "density": 2.70, "thickness": (0.1, 1.0, 4.0)}
    assert transmissions(tube, **aluminium, **found) == pytest.approx(
        transmissions(TRUE, **aluminium, **true), rel=0.005
    )
    assert abs(transmissions(TOLD) / transmissions(TRUE, **true) - 1).max() > 0.1


def test_a_panel_is_found_to_be_thicker_than_assumed_and_how_sure_the_light_is_is_said(fit):
    panel, believed = fit.response.detector, fit.terms[3]
    assert believed.mean < panel.layer_g_cm2 < 0.28 + fit.sd[3]
    aluminium, *_, steel = fit.probe_sd
    assert aluminium < 0.01 < steel


def test_gain_and_stray_light_are_told_apart(fit):
    (stray,) = fit.stray
    assert stray.gain == pytest.approx(1.03, abs=0.002)
    assert stray.mean_share == pytest.approx(0.004, abs=4e-4)


def test_scatter_may_be_narrower_than_assumed(monkeypatch):
    """Thin steel then shines on itself and less on the lead beside it."""
    image = read_image_steps(seen(painted()), wedges())
    near = light_up(image, Response(TRUE, TRUE_PANEL)).stray(Response(TRUE, TRUE_PANEL)).at(-0.5)
    readings = tuple(
        replace(reading, transmission=reading.transmission + 0.15 * light)
        for reading, light in zip(image.readings, near[:, 0].tolist(), strict=True)
    )
    off = []
    for width_sd in (spectrum.NEAR_WIDTH_SD, 1e-4):
        monkeypatch.setattr(spectrum, "NEAR_WIDTH_SD", width_sd)
        found = fit_spectrum([replace(image, readings=readings)], Response(TOLD, CSI)).response
        true = transmissions(TRUE, detector=TRUE_PANEL)
        off.append(abs(transmissions(found.tube, detector=found.detector) / true - 1).max())
    assert off[0] < 0.6 * off[1]
    assert off[0] < 0.015


def test_filters_that_trade_for_each_other_are_said_to_stay_at_their_prior(fit):
    assert [term.name for term in fit.at_prior] == ["Al", "escape"]
    assert fit.sd[0] < 2.0  # kV, of 3 that were believed


def test_too_few_steps_leave_the_voltage_at_its_prior():
    aluminium = replace(wedges()[0], thickness_cm=(0.1, 0.2), last_px=(21.0, 24.0))
    told = Response(TOLD, CSI)
    fit = fit_spectrum([read_image_steps(seen(painted()), [aluminium])], told)
    assert "kv" in [term.name for term in fit.at_prior]
    assert fit.response.tube.kv == pytest.approx(TOLD.kv, abs=1.5)


@pytest.mark.parametrize(("material", "step", "times"), [("steel", 4, 1.1), ("aluminium", 5, 1.05)])
def test_a_step_of_another_thickness_than_told_is_named(material, step, times):
    """One alone moves the spectrum to itself: its own residual is small then."""
    thinner = 100 * (1 - 1 / times)
    told = []
    for wedge in wedges():
        thick = list(wedge.thickness_cm)
        if wedge.material.name == material:
            thick[step - 1] *= times
        told.append(replace(wedge, thickness_cm=tuple(thick)))
    named = rf"plate: {material}: step {step} lies .* as if it were some (.*)% thinner: "
    with pytest.raises(DataError, match=named) as refused:
        fit_spectrum([read_image_steps(seen(painted()), told)], Response(TOLD, CSI))
    assert float(re.search(named, str(refused.value))[1]) == pytest.approx(thinner, rel=0.5)


def test_a_thicker_step_takes_as_much_light_as_the_hardened_beam_says():
    """Not ``T ln T``, which is half as much again behind steel."""
    growth = 1e-4
    image = light_up(read_image_steps(seen(painted()), wedges()), Response(TRUE, TRUE_PANEL))
    grown = tuple(
        replace(reading, path_cm=reading.path_cm * (1 + growth)) for reading in image.image.readings
    )
    thicker = replace(image, image=replace(image.image, readings=grown))
    here, there = (each.direct(Response(TOLD, CSI)) for each in (image, thicker))
    slopes = image.by_thickness(Response(TOLD, CSI))
    assert slopes == pytest.approx((there - here) / growth, rel=1e-3, abs=1e-12)


def test_a_step_that_is_saturated_is_refused_as_that():
    bright = seen(painted())
    full = bright.view.transmission > 0.5
    view = replace(bright.view, valid=bright.view.valid & ~full)
    saturated = replace(bright, view=view, at_least=np.where(full, 0.5, np.nan))
    with pytest.raises(DataError, match=r"0 valid pixels, .* that are saturated: expose image and"):
        read_image_steps(saturated, wedges())


def test_an_image_of_another_exposure_than_its_flat_is_refused():
    image = read_image_steps(seen(painted(gain=0.5)), wedges())
    with pytest.raises(DataError, match=r"plate/pa: was exposed 0\.5\d times as much as its flat"):
        fit_spectrum([image], Response(TOLD, CSI))


def test_a_tube_that_is_far_from_what_was_told_is_said_and_not_called_as_told(fit):
    told = Response(replace(TOLD, kv=85.0, filtration_cm={"Al": 2.5}), CSI)
    found = fit_spectrum([read_image_steps(seen(painted(gain=1.03)), wedges())], told)
    assert {"kv", "Al"} <= {term.name for term in found.elsewhere}
    said = "\n".join(calibration._of_spectrum(found))
    assert "needs you: kv was told as 85 kV, within 3, and is found more than 3 times" in said
    assert "Al stays" not in said
    assert fit.elsewhere == ()


def test_one_plate_before_two_tubes_is_refused():
    other = replace(TRUE, filtration_cm={"Al": 0.25, "Cu": 0.03})
    images = [
        read_image_steps(seen(painted(tube, gain=gain)), wedges(view=view))
        for view, tube, gain in (("pa", TRUE, 1.0), ("lat", other, 1.02))
    ]
    with pytest.raises(DataError, match=r"the same steps differ by .* sd: expected one tube"):
        fit_spectrum(images, Response(TOLD, CSI))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"first_px": (40.0, 4.0), "last_px": (93.0, 4.0)}, "lies outside of the image"),
        ({"first_px": (80.0, 80.0), "last_px": (86.0, 80.0)}, "no shadow where the wedge"),
        ({"first_px": (66.0, 24.0), "last_px": (12.0, 24.0)}, "stand in another order"),
        ({"first_px": (16.0, 24.0), "last_px": (70.0, 24.0)}, "is not even"),
        ({"step_cm": 0.1}, "valid pixels, expected 9 or more"),
    ],
)
def test_a_wedge_that_is_not_as_told_is_refused_by_name(change, said):
    aluminium = replace(wedges()[0], **change)
    with pytest.raises(DataError, match=f"plate/pa: aluminium.*{said}"):
        read_image_steps(seen(painted()), [aluminium])


def test_stops_of_one_thickness_may_differ_by_their_stray_light():
    lead, image = wedges()[2], painted()
    row, column = (round(place) for place in lead.centres_px[1])
    image[row - 4 : row + 5, column - 6 : column + 7] += 0.01
    assert read_image_steps(seen(image), [lead]).readings


def disc(column, row, radius, side=64, subrays=8):
    at = (np.arange(side * subrays) + 0.5) / subrays - 0.5
    inside = (at[:, None] - row) ** 2 + (at - column) ** 2 < radius**2
    light = np.where(inside, 0.02, 0.7 + 0.004 * at)
    return light.reshape(side, subrays, side, subrays).mean(axis=(1, 3)).astype(np.float32)


@pytest.mark.parametrize("place", [(31.0, 31.0), (30.37, 33.81)])
def test_the_centre_of_a_shadow_is_found_to_a_hundredth_of_a_pixel(place):
    image = disc(*place, radius=4.3)
    view = XRayView("pa", image, np.ones(image.shape, dtype=np.bool_), geometry(side=64))
    (found,) = shadow_centres(view, 8.6)
    assert found == pytest.approx(place, abs=0.01)


def dead(row, column, side=64):
    valid = np.ones((side, side), dtype=np.bool_)
    valid[row, column] = False
    return valid


@pytest.mark.parametrize(
    ("valid", "within_px"),
    [
        (dead(33, 27), 0.02),
        (dead(slice(None), 31), 0.02),
        (dead(slice(None), slice(32, 34)), 0.05),
        (dead(slice(None), 27), 0.1),
    ],
    ids=["pixel", "column", "two columns", "column along the rim"],
)
def test_dead_pixels_and_lines_hardly_move_the_centre_of_a_shadow(valid, within_px):
    """Taken for air a pixel moves it by 0.07 pixels, a rim by 0.3, and a line cuts it in two."""
    place = (30.37, 33.81)
    image = np.where(valid, disc(*place, radius=4.3), np.float32(np.nan))
    (found,) = shadow_centres(XRayView("pa", image, valid, geometry(side=64)), 8.6)
    assert found == pytest.approx(place, abs=within_px)


def test_a_ball_before_air_that_is_saturated_is_found():
    place = (30.37, 33.81)
    image = disc(*place, radius=4.3)
    rows, columns = np.indices(image.shape)
    valid = np.hypot(rows - place[1], columns - place[0]) < 12
    image = np.where(valid, image, np.float32(np.nan))
    (found,) = shadow_centres(XRayView("pa", image, valid, geometry(side=64)), 8.6)
    assert found == pytest.approx(place, abs=0.01)


def test_shadows_too_small_to_be_measured_are_refused():
    blank = np.ones((8, 8), dtype=np.float32)
    view = XRayView("pa", blank, blank > 0, geometry(side=8))
    with pytest.raises(DataError, match=r"2\.0 pixels wide, expected 4 or more"):
        shadow_centres(view, 2.0)


def test_the_middle_of_a_balls_shadow_lies_between_the_rays_that_touch_it():
    view = geometry()
    centre, radius = np.array([[6.0, -9.0, 4.0]]), 2.0
    # rays in the plane of source, centre and panel's normal touch at the angle asin(r / distance)
    away = centre[0] - view.source_cm
    distance, along = np.linalg.norm(away), np.array([0.0, 1.0, 0.0])
    across = away - (away @ along) * along
    across /= np.linalg.norm(across)
    angles = np.arctan2(away @ across, away @ along) + np.arcsin(radius / distance) * np.array(
        [1, -1]
    )
    ends = view.source_cm + np.cos(angles)[:, None] * along + np.sin(angles)[:, None] * across
    expected = view.project(ends)[:, :2].mean(axis=0)
    assert bundle._shadow_middles(view, centre, radius)[0] == pytest.approx(expected, abs=1e-9)


def moved(view, source_cm, panel_cm, turn_rad):
    return bundle._moved(view, np.array([*source_cm, *panel_cm, *turn_rad]))


TRUE_VIEWS = {
    "pa": moved(geometry("pa", 512), (0.1, -0.2, 0.05), (-0.1, 0.1, 0.0), (0.002, 0.001, -0.003)),
    "lat": moved(geometry("lat", 512), (0.2, 0.1, 0.0), (0.0, -0.1, 0.1), (0.001, -0.002, 0.002)),
}
BALLS_TOLD = ToldBalls("balls", BALLS.centres_cm, BALLS.ball_cm, 0.001, 0.01)


def bundled(monkeypatch, shadows, balls=BALLS_TOLD):
    monkeypatch.setattr(bundle, "shadow_centres", lambda view, _: shadows[view.name])
    blank = np.ones((512, 512), dtype=np.float32)
    views = {name: XRayView(name, blank, blank > 0, geometry(name, 512)) for name in ("pa", "lat")}
    return bundle.fit_geometry(balls, views)


def shadows_of(points):
    rng = np.random.default_rng(0)
    return {
        name: rng.permutation(bundle._shadow_middles(view, points, BALLS.ball_cm / 2))
        for name, view in TRUE_VIEWS.items()
    }


def test_sources_and_panels_are_found_from_shadows_in_any_order(monkeypatch):
    fit = bundled(monkeypatch, shadows_of(BALLS.centres_cm))
    for name, view in fit.views.items():
        true = TRUE_VIEWS[name]
        assert view.geometry.source_cm == pytest.approx(true.source_cm, abs=0.02)
        for step in ("column_step_cm", "row_step_cm"):
            off = np.linalg.norm(getattr(view.geometry, step) - getattr(true, step))
            assert off < 3e-4 * np.linalg.norm(getattr(true, step))
        assert view.rms_px < 1e-3


def test_balls_elsewhere_than_told_and_balls_too_few_are_refused(monkeypatch):
    stretched = BALLS.centres_cm * (1.0, 1.0, 1.1)
    stretched[::2, 0] += 0.3
    with pytest.raises(DataError, match=r"balls/pa: shadows lie .* pixels from where the table"):
        bundled(monkeypatch, shadows_of(stretched))
    one_off = BALLS.centres_cm.copy()
    one_off[7, 2] += 0.2
    with pytest.raises(DataError, match=r"and \S+ without ball 8 of it: is that its place\?"):
        bundled(monkeypatch, shadows_of(one_off))
    with pytest.raises(DataError, match="balls/pa: 23 shadows of balls found, expected 24"):
        bundled(monkeypatch, shadows_of(BALLS.centres_cm[1:]))


def test_a_source_that_is_found_far_from_where_it_was_told_is_said(monkeypatch):
    fit = bundled(monkeypatch, shadows_of(BALLS.centres_cm))
    near = {name: SimpleNamespace(geometry=view) for name, view in TRUE_VIEWS.items()}
    far = moved(TRUE_VIEWS["pa"], (0.0, 2.0, 0.0), (0.0,) * 3, (0.0,) * 3)
    assert len(calibration._of_geometry(fit.views, near)) == 2
    *_, said = calibration._of_geometry(fit.views, near | {"pa": SimpleNamespace(geometry=far)})
    assert said.startswith("needs you: pa: the source is found 2.0 cm from where it was told")


@pytest.mark.parametrize("noise", range(4))
def test_noise_of_few_balls_is_not_blamed_on_one_of_them(monkeypatch, noise):
    few, rng = BALLS.centres_cm[::5], np.random.default_rng(noise)
    shadows = {
        name: bundle._shadow_middles(view, few, BALLS.ball_cm / 2) + rng.normal(0, 0.12, (5, 2))
        for name, view in TRUE_VIEWS.items()
    }
    fit = bundled(monkeypatch, shadows, replace(BALLS_TOLD, centres_cm=few))
    assert max(view.rms_px for view in fit.views.values()) < 0.5


@pytest.mark.parametrize("text", ["nan", "1_0", "here"])
def test_a_ball_whose_place_is_no_number_is_named_by_its_row(tmp_path, text):
    folder = write_folder(tmp_path / "scans")
    (folder / "balls.csv").write_text(f"x_cm,y_cm,z_cm\n1,2,3\n1,{text},3\n")
    table = folder / "calibration.toml"
    balls = '[balls]\nscan = "balls"\ntable = "balls.csv"\ndiameter_cm = 0.6\n'
    table.write_text(f"{table.read_text()}\n{balls}")
    with pytest.raises(DataError, match=rf"balls\.csv: row 3, y_cm: must be a number.*{text}"):
        read_folder(folder)


def test_no_two_shadows_of_the_ball_phantom_meet_from_any_usual_distance():
    for distance_cm in (90.0, 120.0, 150.0):
        for across, along in ((0, 1), (1, 0)):
            centres = BALLS.centres_cm
            scale = distance_cm / (distance_cm + centres[:, along])
            at = centres[:, [across, 2]] * scale[:, None]
            gaps = np.linalg.norm(at[:, None] - at, axis=2)[np.triu_indices(len(at), 1)]
            assert gaps.min() > 2.5


def test_the_steps_of_a_plate_share_no_space_and_lie_on_one_plane():
    for stairs in PLATES.values():
        boxes = [stair.mesh.bounds for stair in stairs]
        for box, other in pairwise(boxes):
            assert box[1, 0] <= other[0, 0] + 1e-9
        assert all(box[1, 1] == pytest.approx(0.0) for box in boxes)


@pytest.mark.parametrize(
    ("entries", "said"),
    [
        (
            {"steel": {"material": "adamantium"}},
            "wedges.2..material 'adamantium' is no name",
        ),
        ({"steel": {"last_px": [12.0, 48.0]}}, "wedges.2..last_px must differ from first_px"),
        (
            {"steel": {"thickness_cm": [0.1, -1.0]}},
            "wedges.2..thickness_cm must be positive",
        ),
        (
            {"aluminium": {"thickness_cm": [1.0, 10.0, 40.0]}},
            r"wedges.\d..thickness_cm has 40, and so many cm of aluminium let no X-rays through",
        ),
        (
            {"steel": {"density_g_cm3": 7850}},
            r"wedges.2..density_g_cm3 is 7850, but steel has 7\.75 to 7\.9 g/cm³",
        ),
        ({"lead": {"view": "top"}}, "wedges.3..view must be pa or lat"),
        ({"lead": {"colour": "grey"}}, "wedges.3..colour is not a known key"),
    ],
)
def test_a_wrong_key_of_a_wedge_is_named(tmp_path, entries, said):
    with pytest.raises(DataError, match=f"calibration.toml: {said}"):
        read_folder(write_folder(tmp_path / "scans", entries=entries))


@pytest.mark.parametrize(
    ("told", "of_scanner", "said"),
    [
        ({"tube": "B"}, {"name": "A"}, "tube is 'B', but tube.name of scanner.toml is 'A'"),
        ({}, {"taken": datetime.date(2026, 3, 1)}, "date is 2026-03-14, but that of scanner.toml"),
        ({"until": "2026-03-01"}, {}, "valid_until is 2026-03-01, before date"),
    ],
)
def test_scans_of_another_tube_or_day_than_told_are_refused(tmp_path, told, of_scanner, said):
    top = {"tube": told["tube"]} if "tube" in told else {}
    folder = write_folder(tmp_path / "scans", **top)
    path, scanner = folder / "calibration.toml", read_scanner(folder / "scanner.toml")
    if "until" in told:
        until = f"date = 2026-03-14\nvalid_until = {told['until']}"
        path.write_text(path.read_text().replace("date = 2026-03-14", until))
    named = replace(scanner.tube, name=of_scanner.get("name", ""))
    write_scanner(
        replace(scanner, tube=named, taken=of_scanner.get("taken")), folder / "scanner.toml"
    )
    with pytest.raises(DataError, match=f"calibration.toml: {said}"):
        read_folder(folder)


def test_steps_that_no_spectrum_explains_are_refused_and_nothing_is_written(tmp_path):
    copper = {"steel": {"material": "copper"}}
    folder, out = write_folder(tmp_path / "scans", entries=copper), tmp_path / "out"
    answer = CliRunner().invoke(cli, ["calibrate", str(folder), "--out", str(out)])
    assert answer.exit_code == 1
    assert "lie" in answer.output
    assert "plate: aluminium and plate: copper: readings" in answer.output
    assert "off what any spectrum lets pass" in answer.output
    assert len(answer.output.strip().splitlines()) == 1
    assert not out.exists()


def test_a_folder_without_any_phantom_is_refused(tmp_path):
    folder = write_folder(tmp_path / "scans")
    (folder / "calibration.toml").write_text('schema = "xden-calibration/1"\ndate = 2026-03-14\n')
    with pytest.raises(DataError, match="expected at least one phantom"):
        read_folder(folder)


@pytest.fixture(scope="module")
def made(tmp_path_factory, fit):
    """A calibrated folder; the fit is the module's, so that only files are looked at."""
    root = tmp_path_factory.mktemp("calibrated")
    folder = write_folder(root / "scans", tube="A")
    text = (folder / "calibration.toml").read_text()
    until = "date = 2026-03-14\nvalid_until = 2027-03-14"
    (folder / "calibration.toml").write_text(text.replace("date = 2026-03-14", until))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(calibration, "fit_spectrum", lambda *_: fit)
        return folder, root / "out", calibrate_scanner(folder, root / "out")


def test_what_is_written_reads_back_and_nothing_is_overwritten(made):
    folder, out, found = made
    scanner = read_scanner(out / "scanner.toml")
    assert scanner.tube.name == "A"
    assert scanner.tube == found.scanner.tube
    assert scanner.calibration.made_from == ("plate/pa",)
    assert json.loads((out / "calibration.json").read_text())["spectrum_sd"]["kv"] > 0
    assert (out / "steps.png").stat().st_size > 1000
    assert not (out / "balls.png").exists()
    before = contents(out)
    with pytest.raises(DataError, match="is there already; nothing is overwritten"):
        calibrate_scanner(folder, out)
    assert contents(out) == before


def test_what_was_not_measured_is_said_in_a_sentence(made):
    _, _, found = made
    said = "\n".join(found.sentences())
    assert re.search(r"Al stays at its prior, 2\.5 ± 3 mm Al, within which \S+ is written: ", said)
    assert "no balls were scanned: the geometry is as told" in said


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"name": "B"}, "tube is 'A', but tube.name is 'B'"),
        ({"kv": 90.0}, "kv is .* but tube.kv is 90"),
        ({"filtration_cm": {}}, "filtration differs"),
        (Detector("CsI", layer_g_cm2=0.5), "panel differs from detector"),
        (datetime.date(2026, 3, 1), "date is 2026-03-14, after"),
        (datetime.date(2027, 5, 1), "valid_until is 2027-03-14"),
    ],
)
def test_a_calibration_of_another_tube_setting_or_time_is_refused(tmp_path, made, change, said):
    _, out, _ = made
    file, path = read_scanner(out / "scanner.toml"), tmp_path / "scanner.toml"
    changed = (
        {"tube": replace(file.tube, **change)}
        if isinstance(change, dict)
        else {"detector": change}
        if isinstance(change, Detector)
        else {"taken": change}
    )
    write_scanner(replace(file, **changed), path)
    with pytest.raises(DataError, match=rf"scanner.toml: calibration.{said}"):
        read_scanner(path)


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("kv", '"100 kV"', "kv must be a positive number of kV, got '100 kV'"),
        ("filtration", "{ Al = -0.2 }", "filtration.Al must be a thickness in cm"),
        ("filtration", "{ Unobtainium = 0.2 }", "filtration.Unobtainium is neither an element"),
    ],
)
def test_a_calibrations_values_that_are_none_are_named(tmp_path, made, key, value, said):
    _, out, _ = made
    text = (out / "scanner.toml").read_text()
    at = text.index("[calibration]")
    changed = re.sub(rf"(?m)^{key} = .*$", f"{key} = {value}", text[at:], count=1)
    assert changed != text[at:]
    (tmp_path / "scanner.toml").write_text(text[:at] + changed)
    with pytest.raises(DataError, match=rf"scanner.toml: calibration.{said}"):
        read_scanner(tmp_path / "scanner.toml")


def test_a_folder_that_cannot_be_fitted_is_one_line_and_leaves_nothing(tmp_path):
    folder, out = write_folder(tmp_path / "scans", image=np.ones((96, 96)) * 0.9), tmp_path / "out"
    answer = CliRunner().invoke(cli, ["calibrate", str(folder), "--out", str(out)])
    assert answer.exit_code == 1
    assert len(answer.output.strip().splitlines()) == 1
    assert not out.exists()


def with_one_tube(folder):
    """Say that whatever is scanned is turned by hand before the second view."""
    scanner = read_scanner(folder / "scanner.toml")
    views = {**scanner.views, "lat": replace(scanner.views["lat"], turned=True)}
    write_scanner(replace(scanner, views=views), folder / "scanner.toml")
    return folder


def test_balls_that_were_turned_by_hand_are_refused_and_nothing_is_written(tmp_path):
    balls = '[balls]\nscan = "balls"\ntable = "balls.csv"\ndiameter_cm = 0.6'
    folder = with_one_tube(write_folder(tmp_path / "scans", balls=balls))
    (folder / "balls.csv").write_text("x_cm,y_cm,z_cm\n0,0,0\n")
    answer = CliRunner().invoke(cli, ["calibrate", str(folder), "--out", str(tmp_path / "out")])
    assert answer.exit_code == 1
    assert answer.output.startswith(f"Error: {folder}/scanner.toml: views.lat.turned must be false")
    assert len(answer.output.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_steps_are_read_where_objects_are_turned_by_hand_and_it_stays_said(
    tmp_path, fit, monkeypatch
):
    monkeypatch.setattr(calibration, "fit_spectrum", lambda *_: fit)
    folder = with_one_tube(write_folder(tmp_path / "scans"))
    assert calibrate_scanner(folder, tmp_path / "out").scanner.views["lat"].turned
    assert read_scanner(tmp_path / "out" / "scanner.toml").views["lat"].turned


@pytest.mark.parametrize("arguments", [(), ("scans",), ("scans", "--phantoms", "a", "--out", "b")])
def test_arguments_that_do_not_go_together_are_a_matter_of_usage(arguments):
    assert CliRunner().invoke(cli, ["calibrate", *arguments]).exit_code == 2


def test_the_phantoms_are_written_as_they_are_to_be_made(tmp_path):
    out = tmp_path / "designs"
    answer = CliRunner().invoke(cli, ["calibrate", "--phantoms", str(out)])
    assert answer.exit_code == 0
    mesh = trimesh.load_mesh(out / "light_aluminium.stl")
    thickness = PLATES["light"][1].thickness_cm
    assert mesh.volume == pytest.approx(1000 * 2.5 * 2.0 * sum(thickness), rel=1e-6)
    assert mesh.is_watertight
    assert trimesh.load_mesh(out / "balls_tube.stl").is_watertight
    assert len((out / "balls.csv").read_text().splitlines()) == 1 + BALLS.count
    assert {path.name for path in out.glob("*.svg")} == {"light.svg", "heavy.svg", "balls.svg"}
    again = CliRunner().invoke(cli, ["calibrate", "--phantoms", str(out)])
    assert (again.exit_code, "nothing is overwritten" in again.output) == (1, True)


def test_simulated_scans_let_through_what_the_whole_spectrum_does():
    beam = draw_scanner(1, 64).beam
    areal, steel = 7.85 * np.array([0.1, 0.5, 1.0]), (("Fe", 1.0),)
    central = beam.row_weights[31:33].mean(axis=0)
    simulated = np.exp(-areal[:, None] * beam.mac_cm2_g(steel)) @ central
    lac = areal[:, None] * mac_cm2_g(steel, beam.spectrum.energies_kev)
    assert simulated == pytest.approx(beam.spectrum.transmission(lac), rel=1e-3)


@pytest.mark.slow
def test_simulated_scans_give_back_the_scanner(tmp_path):
    scans, out = tmp_path / "scans", tmp_path / "out"
    made = CliRunner().invoke(cli, ["calibrate", "--example", str(scans), "--seed", "5"])
    assert made.exit_code == 0, made.output
    answer = CliRunner().invoke(cli, ["calibrate", str(scans), "--out", str(out), "--json"])
    assert answer.exit_code == 0, answer.output
    truth = json.loads((scans / "truth.json").read_text())
    scanner = read_scanner(out / "scanner.toml")
    true = replace(scanner.tube, kv=truth["kv"], filtration_cm=truth["filtration_cm"])
    found = transmissions(scanner.tube, detector=scanner.detector)
    assert found == pytest.approx(transmissions(true), rel=0.02)
    # the phantom is the frame: where it stands a little askew, so does everything
    turn, shift = np.hsplit(np.linalg.inv(truth["balls_matrix"])[:3], [3])
    for name, view in truth["views"].items():
        found = scanner.views[name].geometry
        source = turn @ view["source_cm"] + shift[:, 0]
        assert np.linalg.norm(found.source_cm - source) < 0.1
        for step in ("column_step_cm", "row_step_cm"):
            right = turn @ view[step]
            assert np.linalg.norm(getattr(found, step) - right) < 1e-3 * np.linalg.norm(right)
