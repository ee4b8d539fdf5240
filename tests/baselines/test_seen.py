"""The perfect eye: the true material of what is seen, and nothing of what is hidden."""

from __future__ import annotations

import numpy as np
import pytest

from tests.baselines.painted import BROWN, GREY, RED, painted
from tests.phantoms import Box
from xden1k.errors import DataError
from xden1k.folder import DatasetFolder, open_folder, write_folder
from xden1k.predictor import Predictor, SampleView
from xden1k.values.materials import load_materials
from xden_baselines.surface.seen import SeenMaterials, SeenMaterialsHollow
from xden_baselines.views.cameras import Rig
from xden_baselines.views.source import RenderedPhantoms

RIG = RenderedPhantoms(Rig(elevations_deg=(-30.0, 30.0), per_ring=3, size_px=96))
CORE = ((0.2, 0.2, 3.4), (0.8, 0.8, 3.8))  # nearer to the sides of the head than to the handle
HAMMER = (
    Box("handle", (0, 0, 0), (1, 1, 3), 0.6, material="wood_oak"),
    Box("head", (-0.5, 0, 3), (2, 1, 4), 7.7, CORE, material="steel"),
    Box("core", *CORE, 0.05, material="foam_eps"),
)
CAVITY = ((-1, -1, -1), (1, 1, 1))
SHELL = (Box("shell", (-2, -2, -2), (2, 2, 2), 2.4, CAVITY, material="glass_soda_lime"),)
OAK, STEEL, GLASS = (
    load_materials()[name].density_nominal_g_cm3
    for name in ("wood_oak", "steel", "glass_soda_lime")
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> DatasetFolder:
    root = tmp_path_factory.mktemp("seen") / "dataset"
    objects = [
        painted("hammer-0001", HAMMER, {"handle": BROWN, "head": GREY, "core": RED}),
        painted("shell-0001", SHELL, {"shell": GREY}),
        painted("shell-0002", (Box("shell", *CAVITY),), {"shell": GREY}),
    ]
    write_folder(objects, root, version="0.1.0", builder="tests")
    return open_folder(root)


def predicted(folder: DatasetFolder, object_id: str, kind: type = SeenMaterials) -> np.ndarray:
    return kind().predict(_view(folder, object_id)).density_g_cm3


def _view(folder: DatasetFolder, object_id: str) -> SampleView:
    return SampleView(folder, object_id, SeenMaterialsHollow.reads, pictures_of=RIG)


def test_what_is_seen_is_right_and_what_is_hidden_follows_it(folder: DatasetFolder) -> None:
    labels = folder.object("hammer-0001").labels[1::2, 1::2, 1::2]
    field = predicted(folder, "hammer-0001")
    inside = _view(folder, "hammer-0001").envelope == 1
    handle, head, core = (field[inside & (labels == part)] for part in (1, 2, 3))
    assert np.median(handle) == pytest.approx(OAK)
    assert (np.abs(head - STEEL) < 1e-4).mean() > 0.9  # voxels at the seam may take the other's
    np.testing.assert_allclose(core, STEEL, rtol=1e-6)  # nobody sees the foam


def test_a_cavity_is_filled_unless_it_is_told(folder: DatasetFolder) -> None:
    view = _view(folder, "shell-0001")
    solid, hollow = (
        predicted(folder, "shell-0001", kind) for kind in (SeenMaterials, SeenMaterialsHollow)
    )
    np.testing.assert_allclose(solid, GLASS * view.envelope, rtol=1e-6)
    np.testing.assert_allclose(hollow, GLASS * view.occupancy, rtol=1e-6)
    assert solid.sum() > 1.1 * hollow.sum()


@pytest.mark.parametrize("kind", [SeenMaterials, SeenMaterialsHollow])
def test_it_is_a_predictor(kind: type) -> None:
    assert isinstance(kind(), Predictor)


def test_a_part_without_material_is_refused(folder: DatasetFolder) -> None:
    with pytest.raises(DataError, match=r"shell-0002: the material table has no \[''\]"):
        predicted(folder, "shell-0002")
