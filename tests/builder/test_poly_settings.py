"""Choices of a rebuild: what is refused, and what makes it another one."""

from __future__ import annotations

from dataclasses import fields, replace

import pytest

from xden1k.errors import DataError
from xden_builder.cli import cli
from xden_builder.poly.settings import PolySettings
from xden_builder.reconstruct.settings import MODELS, BuildSettings


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"edge_error_cm": -0.1}, r"edge_error_cm must not be negative, got -0\.1"),
        ({"model_share": -1.0}, "model_share must not be negative, got -1"),
        ({"floor": 0.0}, "floors and worth_a_part must be above zero"),
        ({"worth_a_part": 0.0}, "must be above zero"),
        ({"floor": float("nan")}, "floor must be a finite number, got nan"),
        ({"extra_filter_mm_cu": float("nan")}, "extra_filter_mm_cu must be a finite number"),
    ],
)
def test_choices_out_of_range_are_refused(change, message):
    with pytest.raises(DataError, match=message):
        PolySettings(**change)


def test_a_model_that_is_not_there_is_refused_with_those_there_are():
    settings = BuildSettings()
    object.__setattr__(settings, "model", "lac")  # type checkers refuse it sooner
    with pytest.raises(DataError, match=r"model must be one of \('poly', 'paper'\), got 'lac'"):
        settings.__post_init__()


@pytest.mark.parametrize("count", ["subrays", "column_samples"])
def test_counts_must_be_positive(count):
    with pytest.raises(DataError, match="subrays and column_samples must be positive"):
        BuildSettings(**{count: 0})


def test_every_choice_changes_the_digest():
    digests = {BuildSettings().digest, BuildSettings(model="paper").digest}
    digests.add(BuildSettings(filtration="told").digest)
    digests.add(BuildSettings(labels="withheld").digest)
    for each in fields(PolySettings):
        value = getattr(PolySettings(), each.name)
        other = not value if isinstance(value, bool) else 2 * value + 1
        digests.add(BuildSettings(poly=replace(PolySettings(), **{each.name: other})).digest)
    assert len(digests) == 4 + len(fields(PolySettings))
    assert BuildSettings().digest == BuildSettings(poly=PolySettings()).digest


def test_the_command_line_offers_every_model_and_starts_with_the_default():
    (option,) = [each for each in cli.commands["run"].params if each.name == "model"]
    assert tuple(option.type.choices) == MODELS
    assert option.default == BuildSettings().model
