"""ct.npz: both forms of attenuation, labels, and what is refused."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from xden1k.errors import DataError
from xden_builder.capture import CTReference
from xden_builder.capture.ct import read_ct

MU = np.random.default_rng(0).uniform(0, 2, (3, 4, 5)).astype("f4")
WHOLE: dict[str, Any] = {
    "mu_per_cm": MU,
    "origin_cm": np.array([1.0, 2.0, 3.0]),
    "spacing_cm": np.array([0.1, 0.2, 0.4]),
    "labels": np.arange(60).reshape(3, 4, 5).astype("u1") % 3,
    "label_names": np.array(["outside", "shell", "air cavity"]),
}
HU = {"hu": np.array([[[-1000, 0, 1000]]], dtype="i2"), "mu_water_per_cm": 0.2}


def read(folder: Path, **arrays: Any) -> CTReference:
    np.savez(folder / "ct.npz", **{name: a for name, a in arrays.items() if a is not None})
    return read_ct(folder / "ct.npz")


def test_attenuation_grid_and_labels_arrive(tmp_path: Path) -> None:
    ct = read(tmp_path, **WHOLE)
    np.testing.assert_array_equal(ct.mu_per_cm, MU)
    assert ct.origin_cm.tolist() == [1, 2, 3]
    assert ct.spacing_cm.tolist() == [0.1, 0.2, 0.4]
    assert ct.voxel_cm3 == pytest.approx(0.008)
    np.testing.assert_array_equal(ct.labels, WHOLE["labels"])
    assert ct.label_names == ("outside", "shell", "air cavity")


def test_hounsfield_units_become_attenuation(tmp_path: Path) -> None:
    ct = read(tmp_path, **{**WHOLE, **HU, "mu_per_cm": None, "labels": None})
    np.testing.assert_allclose(ct.mu_per_cm, [[[0, 0.2, 0.4]]])
    assert ct.mu_per_cm.dtype == np.float32
    assert (ct.labels, ct.label_names) == (None, ())


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mu_per_cm": None}, "expected either mu_per_cm or hu"),
        (HU, "expected either mu_per_cm or hu"),
        ({**HU, "mu_per_cm": None, "mu_water_per_cm": None}, "mu_water_per_cm is missing"),
        ({**HU, "mu_per_cm": None, "mu_water_per_cm": -1.0}, "mu_water_per_cm must be positive"),
        ({"mu_per_cm": MU[0]}, "mu_per_cm must be floats along 3 axes, got float32 along 2"),
        ({"mu_per_cm": MU * np.nan}, "mu_per_cm: 60 voxels are not finite"),
        ({"origin_cm": None}, "origin_cm is missing"),
        ({"origin_cm": np.zeros(2)}, "origin_cm must hold 3 values, got 2"),
        ({"origin_cm": np.full(3, np.inf)}, "origin_cm must be finite, got [inf, inf, inf]"),
        ({"spacing_cm": np.array([0.1, 0, 1])}, "spacing_cm must be positive, got [0.1, 0.0, 1.0]"),
        (
            {"labels": WHOLE["labels"][1:]},
            "labels must have the grid's shape (3, 4, 5), got (2, 4,",
        ),
        ({"labels": WHOLE["labels"].astype("i4")}, "labels must be uint8, got int32"),
        (
            {"label_names": np.array(["outside"])},
            "label_names must name every label up to 2, got 1",
        ),
        ({"label_names": None}, "label_names is missing"),
        ({"label_names": np.array([None, {}])}, "not an npz archive without pickled objects that"),
    ],
)
def test_a_wrong_array_is_named(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(DataError, match=r"ct\.npz: " + re.escape(message)):
        read(tmp_path, **{**WHOLE, **changes})


def test_what_is_no_archive_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "ct.npz"
    path.write_text("nothing")
    with pytest.raises(DataError, match=r"ct\.npz: not an npz archive$"):
        read_ct(path)
    with path.open("wb") as stream:
        np.save(stream, MU)
    with pytest.raises(DataError, match=r"ct\.npz: not an npz archive$"):
        read_ct(path)
