"""Hypothesis strategies of valid values."""

from __future__ import annotations

import random
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
from hypothesis import strategies as st

from tests.phantoms import NAN, Box, box_object
from xden1k.values.types import SOURCES, SPLITS, DensityObject
from xden1k.values.views import XRayView

words = st.text(st.characters(codec="utf-8"), max_size=12)
"""Anything a person may type."""
object_ids = st.from_regex(r"[A-Za-z0-9._-]{1,20}", fullmatch=True)
figures = st.floats(0, 1e3) | st.just(NAN)
"""A figure of a part, which may be unknown."""
json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(words, inner, max_size=3),
    max_leaves=6,
)


@st.composite
def boxes(draw: st.DrawFn) -> tuple[Box, ...]:
    """One to four boxes in a row along x."""
    widths = draw(st.lists(st.floats(0.25, 4), min_size=1, max_size=4))
    edges = np.cumsum([0.0, *widths]).tolist()
    names = draw(st.lists(words, min_size=len(widths), max_size=len(widths), unique=True))
    return tuple(
        Box(name, (low, -1, 0), (high, 1, 1.5), draw(st.floats(0.01, 22)), material=draw(words))
        for name, low, high in zip(names, edges, edges[1:], strict=False)
    )


@st.composite
def density_objects(draw: st.DrawFn, ids: st.SearchStrategy[str] = object_ids) -> DensityObject:
    """An object of boxes with any radiographs, figures, remarks and meta data."""
    row = draw(boxes())
    values = {
        "shape": draw(st.tuples(st.integers(2, 30), st.integers(1, 30))),
        "density_known": draw(st.booleans()),
        "category": draw(words),
        "split": draw(st.sampled_from(SPLITS)),
        "source": draw(st.sampled_from(SOURCES)),
        "weighed_mass_g": draw(st.none() | st.floats(1e-3, 1e6)),
        "flags": tuple(draw(st.lists(words, max_size=3))),
        "meta": draw(st.dictionaries(words.filter(lambda key: key != "views"), json_values)),
    }
    remarks = [
        {
            "lac_per_cm": draw(figures),
            "flags": tuple(draw(st.lists(words, max_size=2))),
            "color_rgb": draw(st.tuples(*[st.floats(0, 1)] * 3)),
        }
        for _ in row
    ]
    object_id, noise = draw(ids), np.random.default_rng(draw(st.integers(0, 2**32)))
    with _random_state_kept():
        obj = box_object(object_id, row, **values)
        parts = tuple(replace(p, **more) for p, more in zip(obj.parts, remarks, strict=True))
        return replace(obj, parts=parts, views=tuple(_noisy(view, noise) for view in obj.views))


@contextmanager
def _random_state_kept() -> Iterator[None]:
    """Checked annotations look at random items of a sequence; Hypothesis would think it was us."""
    state = random.getstate()
    yield
    random.setstate(state)


def _noisy(view: XRayView, noise: np.random.Generator) -> XRayView:
    """Noise far beyond what the codes hold, and dead pixels that are not a number."""
    shape = view.transmission.shape
    valid = noise.random(shape) < 0.9
    valid.flat[0] = True
    image = view.transmission + noise.normal(0, 0.3, shape).astype(np.float32)
    return replace(view, transmission=np.where(valid, image, np.float32(NAN)), valid=valid)
