"""Materials weighed by the images: what is not tried would have changed nothing."""

from __future__ import annotations

import numpy as np

from tests.builder.poly_scenes import captured, solved, tool
from xden_builder.poly.materials import evidence


def test_what_is_not_tried_would_not_have_been_probable(monkeypatch):
    capture = captured(tool(label="abs"), size=64)
    few = solved(capture, pose=False).posteriors
    monkeypatch.setattr(evidence, "NEGLIGIBLE", 1e-300)
    every = solved(capture, pose=False).posteriors
    for some, all_of_them in zip(few, every, strict=True):
        left_out = some.probability == 0
        assert left_out.any()
        best = all_of_them.probability.max()
        assert (all_of_them.probability[left_out] < 1e-3 * best).all()
        np.testing.assert_allclose(some.probability, all_of_them.probability, atol=0.02)
        assert np.isfinite(some.density_g_cm3).all()
