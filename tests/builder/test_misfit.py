"""An object that its folder's errors do not explain is believed less, and no more than that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.builder.poly_scenes import captured, tool
from xden_builder.capture.space import divide
from xden_builder.fit.huber import of_noise, tempered
from xden_builder.poly.estimate import estimate
from xden_builder.poly.hardness import Hardness
from xden_builder.poly.judgement import PolyFit
from xden_builder.poly.line import fit_samples, sampled, with_mass
from xden_builder.poly.misfit import as_far_off, misfit
from xden_builder.poly.model.pixels import block_width
from xden_builder.poly.samples import Samples
from xden_builder.poly.settings import PolySettings

SMALL = Hardness(0.0, 0.002, 80, 30, None, 0.2, 0.2).applied(PolySettings())


@pytest.fixture(scope="module")
def sound() -> Samples:
    capture = captured(tool(), size=72)
    return sampled(capture, divide(capture.parts), SMALL)


@pytest.fixture(scope="module")
def veiled(sound) -> Samples:
    """A twentieth of the light of half of each view goes into a sheet that nobody meshed."""
    seen = []
    for each in sound.seen:
        half = each.samples.index % each.lengths.shape[1] < each.lengths.shape[1] // 2
        measured = np.where(half, 0.95, 1.0) * each.samples.measured
        seen.append(replace(each, samples=replace(each.samples, measured=measured)))
    return replace(sound, seen=tuple(seen))


def image_errors(fit: PolyFit) -> float:
    return fit.solution.problem.settings.image_errors


def test_an_object_that_errors_explain_is_believed_as_its_folder_is(sound):
    assert image_errors(fit_samples(sound, SMALL)) == 1.0


def test_an_object_that_they_do_not_explain_is_believed_less_and_its_deviations_say_so(
    sound, veiled
):
    before, after = fit_samples(sound, SMALL), fit_samples(veiled, SMALL)
    assert 1.1 < image_errors(after) <= 1 / 0.2
    for one, other in zip(before.parts, after.parts, strict=True):
        assert other.sd_g_cm3 > one.sd_g_cm3
    assert after.report(["a", "b", "c"])["image_errors"] == image_errors(after)


def test_errors_never_grow_above_those_that_are_assumed_of_any_object(veiled):
    assert image_errors(fit_samples(veiled, PolySettings())) == 1.0
    for most in (1.5, 3.0):
        surer = replace(SMALL, model_share=1e-4, clear_floor=1e-4, most_image_errors=most)
        looser = as_far_off(estimate(veiled, surer))
        assert looser is not None
        assert looser.image_errors == most


def test_residuals_weigh_less_where_errors_are_larger_so_that_these_do_not_grow_for_ever(veiled):
    left = [misfit(estimate(veiled, replace(SMALL, image_errors=each))) for each in (1, 2, 4)]
    assert left == sorted(left, reverse=True)


def noisy(clean: Samples, share: float, *, in_air: bool = True) -> Samples:
    """Of a panel whose pixels are off by a share of the light, root of it in the shade."""
    rng = np.random.default_rng(1)
    seen = []
    for each in clean.seen:
        mine = each.samples
        width = np.where(mine.is_block, block_width(each.lengths, each.blocks), 1)
        noise = share * np.sqrt(mine.measured) / width * rng.standard_normal(len(width))
        samples = replace(mine, measured=mine.measured + noise)
        grain = share * rng.standard_normal(each.view.transmission.shape).astype(np.float32)
        view = replace(each.view, transmission=each.view.transmission + grain)
        seen.append(replace(each, samples=samples, view=view if in_air else each.view))
    return replace(clean, seen=tuple(seen))


@pytest.mark.parametrize("sd", [1e-3, 0.5, 2.0, 10.0])
def test_what_noise_is_expected_to_leave_is_what_it_leaves(sd):
    drawn = sd * np.random.default_rng(2).standard_normal(100_000)
    assert of_noise(np.full(len(drawn), sd**2)) == pytest.approx(tempered(drawn), rel=0.02)


@pytest.mark.parametrize("share", [0.001, 0.003, 0.01])
def test_noise_alone_makes_no_object_less_believed(sound, share):
    assert image_errors(fit_samples(noisy(sound, share), SMALL)) == 1.0
    unseen = noisy(sound, share, in_air=False)
    assert share < 0.003 or image_errors(fit_samples(unseen, SMALL)) > 1.1


@pytest.mark.parametrize("share", [0.001, 0.003])
def test_noise_hides_no_object_that_errors_do_not_explain(veiled, share):
    assert image_errors(fit_samples(noisy(veiled, share), SMALL)) > 1.1


def test_a_mass_on_the_scale_is_weighed_by_the_errors_that_were_found(veiled):
    by_images = fit_samples(veiled, SMALL)
    both = with_mass(by_images, 60.0, veiled.guess.scene.space.volumes_cm3)
    assert image_errors(both) == image_errors(by_images) > 1.1
