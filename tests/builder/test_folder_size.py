"""Sizes of all objects of a folder together: a wrong geometry is told, a wrong object is not."""

from __future__ import annotations

import json

import pytest

from xden_builder.triage.findings import Findings, find
from xden_builder.triage.remarks import folder_remarks
from xden_builder.triage.sizes import folder_size


def found(factor: float | None) -> Findings:
    meta = {} if factor is None else {"mesh_size": {"factor": factor}}
    return find(
        {
            "object_id": "mug-1",
            "category": "mug",
            "flags": [],
            "mass_g": 225.0,
            "weighed_mass_g": None,
            "part_names": [],
            "part_flags": [],
            "meta_json": json.dumps(meta),
        }
    )


def folder(*factors: float | None):
    return folder_size([found(factor) for factor in factors])


@pytest.mark.parametrize("off", [-0.006, 0.012])
def test_a_pitch_or_a_source_that_is_wrong_for_all_objects_is_told(off):
    size = folder(*(1 + off + jitter for jitter in (-0.001, -0.0005, 0.0, 0.0005, 0.001, 0.0)))
    assert size.contradicts
    (said,) = folder_remarks(None, size)
    assert ("larger" if off > 0 else "smaller") in said.text
    assert f"{abs(off):.1%}" in said.text


def test_objects_all_at_the_bound_of_their_size_are_told():
    assert folder(*[1.0151] * 6).contradicts


def test_one_object_in_another_unit_says_nothing_of_the_scanner():
    size = folder(1.0, 0.9995, 1.0002, 1.0, 1.0151, 1.0001)
    assert not size.contradicts
    assert [*folder_remarks(None, size)] == []


def test_meshes_that_are_scaled_each_for_itself_say_nothing_of_the_scanner():
    assert not folder(1.008, 0.996, 1.004, 0.99, 1.012, 1.001, 0.999, 1.003).contradicts


def test_few_objects_say_nothing_of_the_scanner():
    assert not folder(*[1.01] * 4).contradicts


def test_objects_whose_size_was_not_sought_are_not_counted():
    assert folder(None, None) is None
    assert folder(None, 1.0, 1.0).objects == 2
