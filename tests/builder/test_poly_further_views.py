"""More than two views: what a third one adds, and where it is kept."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.builder.fit_scenes import cone
from tests.builder.poly_scenes import capture_of, geometries, radiograph, solved, tool
from xden_builder.audit.object import audit_object
from xden_builder.poly.diagnosis import diagnose
from xden_builder.poly.model.frames import Pose, posed
from xden_builder.reconstruct.object import reconstruct

OBLIQUE_DEG = 45.0


def three_views(size, turn=None):
    """Pa, lat, and an oblique one, before which the object may have been turned by hand."""
    solids, told = tool(), cone(OBLIQUE_DEG, size, 14.0)
    views = [radiograph(solids, name, where) for name, where in geometries(size).items()]
    there = told if turn is None else posed(told, turn, shifted_rows=False)
    oblique = replace(radiograph(solids, "oblique", there), geometry=told)
    turned = frozenset() if turn is None else frozenset({"oblique"})
    return replace(capture_of(solids, views), further_views=(oblique,), turned=turned)


def test_a_third_view_makes_every_density_surer():
    three = three_views(48)
    sds = [
        np.sqrt(diagnose(solved(capture, pose=False)).covariance.diagonal())
        for capture in (three, replace(three, further_views=()))
    ]
    assert (sds[0] < sds[1]).all()


@pytest.mark.slow
def test_a_dataset_keeps_pa_and_lat_and_the_audit_finds_the_third_view_by_its_pose():
    capture = three_views(128, Pose((0.05, -0.03, 0.06), (0.6, -0.9, 0.8)))
    obj = reconstruct(capture)
    names = ["pa", "lat", "oblique"]
    assert [view.name for view in obj.views] == names[:2]
    assert list(obj.meta["fit"]["gain"]) == names
    assert list(obj.meta["poly"]["pose"]["views"]) == names
    audits = audit_object(obj, capture).views
    assert [audit.name for audit in audits if audit.fitted] == names
    assert all(audit.transmission_corr > 0.99 for audit in audits)
