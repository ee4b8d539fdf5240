"""Files that break their format are refused with one line that names them."""

from __future__ import annotations

import json
import pickle
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.baselines.foreign_runs import (
    BOX,
    Pixie,
    cloud,
    edit_npz,
    write_json,
    write_nerf2physics,
    write_ply,
    write_points,
    write_pugs,
    write_vomp,
)
from xden1k.errors import DataError
from xden_baselines.adapters import files
from xden_baselines.adapters.files import numbers, read_json, read_npy, read_npz, read_ply
from xden_baselines.adapters.frames import Frames, Similarity, dataparser
from xden_baselines.adapters.points import density_table, read_points
from xden_baselines.adapters.scenes import read_nerf2physics, read_pugs
from xden_baselines.adapters.voxels import density_range, read_pixie, read_vomp

NAME = "angle-0001"


class Trap:
    """Unpickled, it would raise something else than DataError."""

    def __reduce__(self) -> tuple[Any, ...]:
        return (exec, ("raise SystemExit('unpickled')",))


@pytest.fixture
def npy(tmp_path: Path) -> Path:
    path = tmp_path / "values.npy"
    np.save(path, np.arange(12.0).reshape(4, 3))
    return path


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("dtype", ["<f4", "<f2", "|b1", "<U5", "<i4"])
def test_arrays_are_read_as_numpy_wrote_them(tmp_path: Path, order: Any, dtype: str) -> None:
    values = np.asarray(np.arange(12).reshape(4, 3).astype(dtype), order=order)
    np.save(tmp_path / "a.npy", values)
    np.savez_compressed(tmp_path / "a.npz", one=values, other=np.zeros(0))
    np.testing.assert_array_equal(read_npy(tmp_path / "a.npy"), values)
    found = read_npz(tmp_path / "a.npz", ("one", "other", "third"))
    np.testing.assert_array_equal(found["one"], values)
    assert found.keys() == {"one", "other"}
    assert found["other"].shape == (0,)


def test_an_array_that_is_cut_short_says_so(npy: Path) -> None:
    npy.write_bytes(npy.read_bytes()[:-8])
    message = r"values.npy: shape \(4, 3\) of float64 needs 224 bytes, there are 216$"
    with pytest.raises(DataError, match=message):
        read_npy(npy)


def test_an_array_that_claims_to_be_huge_is_never_made(npy: Path) -> None:
    said, claimed = b"(4, 3), }           ", b"(999999999999, 3), }"
    assert said in npy.read_bytes()
    npy.write_bytes(npy.read_bytes().replace(said, claimed))
    with pytest.raises(DataError, match="of float64 needs 24000000000104 bytes, there are 224"):
        read_npy(npy)


def test_nothing_is_unpickled(tmp_path: Path) -> None:
    trap = np.array([Trap()], dtype=object)
    np.save(tmp_path / "trap.npy", trap, allow_pickle=True)
    np.savez(tmp_path / "trap.npz", points=trap)
    (tmp_path / "bare.npy").write_bytes(pickle.dumps(Trap()))
    with pytest.raises(DataError, match=r"trap.npy: an object array, which would have to be unp"):
        read_npy(tmp_path / "trap.npy")
    with pytest.raises(DataError, match=r"trap.npz: points: an object array"):
        read_npz(tmp_path / "trap.npz", ("points",))
    with pytest.raises(DataError, match=r"bare.npy: no .npy array"):
        read_npy(tmp_path / "bare.npy")


def test_files_and_members_have_a_largest_size(
    npy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    np.savez_compressed(tmp_path / "bomb.npz", points=np.zeros(100_000))
    monkeypatch.setattr(files, "MAX_BYTES", 100)
    with pytest.raises(DataError, match=r"values.npy: 224 bytes, at most 100$"):
        read_npy(npy)
    with pytest.raises(DataError, match=r"bomb.npz: points: 800128 bytes, at most 100$"):
        read_npz(tmp_path / "bomb.npz", ("points",))


def test_a_damaged_archive_says_so(tmp_path: Path) -> None:
    path = write_points(tmp_path, NAME)
    data = bytearray(path.read_bytes())
    data[2000] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(DataError, match=r"points.npz: expected a readable .npz file: Bad CRC-32"):
        read_points(tmp_path, NAME, "kg/m3")
    path.write_bytes(data[:5000])
    with pytest.raises(DataError, match=r"points.npz: expected a readable .npz file: File is not"):
        read_points(tmp_path, NAME, "kg/m3")


def test_an_encrypted_archive_says_so(tmp_path: Path) -> None:
    path = tmp_path / "closed.npz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("points.npy", b"x")
    data = path.read_bytes()
    for mark, place in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        at = data.index(mark) + place
        data = data[:at] + b"\x01" + data[at + 1 :]
    path.write_bytes(data)
    with pytest.raises(DataError, match=r"closed.npz: packed or encrypted in a way"):
        read_npz(path, ("points",))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (np.array([[0, 0, np.nan]]), r"a: 1 values are not finite, first at \(0, 2\)"),
        (np.zeros((0, 3)), r"a: shape must be \(N, 3\), got \(0, 3\)"),
        (np.zeros((4, 2)), r"a: shape must be \(N, 3\), got \(4, 2\)"),
        (np.array([["x", "y", "z"]]), "a: expected numbers, got <U1"),
        ([[1, 2, 3], [4]], r"a: expected numbers of shape \(N, 3\)"),
        (None, "a: expected numbers, got object"),
    ],
)
def test_what_are_no_numbers_of_the_shape_are_named(values: object, message: str) -> None:
    with pytest.raises(DataError, match=message):
        numbers(values, (None, 3), "a")


def test_ply_is_read_binary_and_as_text(tmp_path: Path) -> None:
    points, density = cloud(100)
    write_ply(tmp_path / "binary.ply", points, density=density)
    head = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
    text = f"{head}property float z\nproperty float density\nend_header\n0 0 0 5\n1 2 3 6\n"
    (tmp_path / "text.ply").write_text(text)
    found = read_ply(tmp_path / "binary.ply", ("z", "density"))
    np.testing.assert_array_equal(found["density"], density.astype(np.float32))
    np.testing.assert_array_equal(found["z"], points[:, 2].astype(np.float32))
    assert read_ply(tmp_path / "text.ply", ("density",))["density"].tolist() == [5, 6]


@pytest.mark.parametrize(
    "change",
    [
        lambda data: data[:-4],
        lambda data: data.replace(b"vertex 3", b"vertex 9"),
        lambda data: data.replace(b"density", b"opacity"),
        lambda data: data.replace(b"ply", b"obj", 1),
        lambda data: data.replace(b"float x", b"thing x"),
        lambda data: data.replace(b"element vertex", b"element corner"),
        lambda data: b"",
    ],
)
def test_a_damaged_ply_file_is_named(tmp_path: Path, change: Callable[[bytes], bytes]) -> None:
    path = tmp_path / "a.ply"
    write_ply(path, BOX[[0, 1, 0]], density=np.ones(3))
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(DataError, match=r"a.ply: expected a PLY file whose vertices have"):
        read_ply(path, ("x", "y", "z", "density"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not JSON"),
        ("[1]", "expected a JSON object, got list"),
        ("[" * 100_000, "not JSON"),
        ("\udcff", "expected UTF-8 text"),
    ],
)
def test_what_is_no_json_object_is_named(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "a.json").write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(DataError, match=f"a.json: {message}"):
        read_json(tmp_path / "a.json")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"density": np.ones(3)}, r"density: shape must be \(\d+,\), got \(3,\)"),
        ({"density": np.ones((3, 2))}, r"density: shape must be \(\d+, 2\), got \(3, 2\)"),
        ({"points": np.zeros((5, 2))}, r"points: shape must be \(N, 3\), got \(5, 2\)"),
    ],
)
def test_points_and_densities_must_go_together(
    tmp_path: Path, changes: dict[str, np.ndarray], message: str
) -> None:
    write_points(tmp_path, NAME, **changes)
    with pytest.raises(DataError, match=f"points.npz: {message}"):
        read_points(tmp_path, NAME, "kg/m3")


def test_a_range_the_wrong_way_round_is_named(tmp_path: Path) -> None:
    _, density = cloud()
    turned = np.stack([1.1 * density, 0.9 * density], axis=1)
    write_points(tmp_path, NAME, density=turned)
    with pytest.raises(DataError, match=r"expected \[low, high\], \d+ are the other way round, f"):
        read_points(tmp_path, NAME, "kg/m3")


def test_missing_files_are_named(tmp_path: Path) -> None:
    write_nerf2physics(tmp_path, NAME)
    write_pugs(tmp_path, "other")
    scenes = tmp_path / "scenes"
    for path, read in (
        (scenes / NAME / "points.npz", read_nerf2physics),
        (scenes / "other" / "pred_result_density" / "dense_points.npy", read_pugs),
    ):
        path.unlink()
        name = "other" if "other" in path.parts else NAME
        with pytest.raises(DataError, match=f"{path.name}.*No such file"):
            read(tmp_path, name)


def test_a_run_without_masses_has_none(tmp_path: Path) -> None:
    write_nerf2physics(tmp_path, NAME)
    (tmp_path / "preds" / "preds_mass.json").unlink()
    assert read_nerf2physics(tmp_path, NAME).mass_native_g is None
    write_json(tmp_path / "preds" / "preds_mass.json", {NAME: "heavy"})
    with pytest.raises(DataError, match=f"preds_mass.json: {NAME}: expected numbers"):
        read_nerf2physics(tmp_path, NAME)


@pytest.fixture
def pixie(tmp_path: Path) -> Pixie:
    run = Pixie(tmp_path, NAME)
    run.write()
    return run


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"grid_shape": (64, 64, 32)}, "grid_shape must be"),
        ({"voxel_size": 0.01}, "64 steps of 0.01 do not span"),
        ({"voxel_size": -1 / 64}, "do not span"),
        ({"max_bounds": (0.5, 0.5)}, r"max_bounds: shape must be \(3,\)"),
    ],
)
def test_a_grid_that_is_not_pixies_is_named(
    pixie: Pixie, change: dict[str, Any], message: str
) -> None:
    edit_npz(pixie.renders / NAME / "clip_features.npz", lambda found: found.update(change))
    with pytest.raises(DataError, match=f"clip_features.npz: .*{message}"):
        read_pixie(pixie.runs, NAME, pixie.renders, density_range(pixie.ranges))


def test_what_pixie_lacks_is_named(pixie: Pixie) -> None:
    span, folder = density_range(pixie.ranges), pixie.runs / NAME
    with pytest.raises(DataError, match="its densities are scaled: name their --ranges"):
        read_pixie(pixie.runs, NAME, pixie.renders, None)
    np.save(folder / "sample_0_mask.npy", np.zeros((64, 64, 64), bool))
    with pytest.raises(DataError, match=r"sample_0_mask.npy: the mask is empty"):
        read_pixie(pixie.runs, NAME, pixie.renders, span)
    pixie.write(background=np.ones((64, 64, 64), bool))
    with pytest.raises(DataError, match="no voxel of the mask is of another class than backgro"):
        read_pixie(pixie.runs, NAME, pixie.renders, span)
    np.save(folder / "sample_0_pred.npy", np.zeros((4, 64, 64, 64)))
    with pytest.raises(DataError, match=r"sample_0_pred.npy: shape must be \(11, 64, 64, 64\)"):
        read_pixie(pixie.runs, NAME, pixie.renders, span)
    (folder / "sample_0_pred.npy").unlink()
    with pytest.raises(DataError, match=r"expected sample_0_pred.npy or mapped_preds.ply or world"):
        read_pixie(pixie.runs, NAME, pixie.renders, span)
    pixie.write_ply(to_world=Similarity.made(1.0, None, np.array([0.004, 0, 0])))
    with pytest.raises(DataError, match=r"mapped_preds.ply: its points are no nodes of the grid"):
        read_pixie(pixie.runs, NAME, pixie.renders, span)


def test_a_range_that_is_none_is_named(tmp_path: Path) -> None:
    path = write_json(tmp_path / "r.yaml", {"density_p1": 3.0, "density_p99": 2.0})
    with pytest.raises(DataError, match=r"r.yaml: expected density_p1 < density_p99, got 3.0 and"):
        density_range(path)
    with pytest.raises(DataError, match=r"r.yaml: density_p99: expected numbers"):
        density_range(write_json(path, {"density_p1": 3.0}))


def test_vomps_points_of_another_kind_are_refused(tmp_path: Path) -> None:
    write_vomp(tmp_path, NAME, segment="segment_0")
    with pytest.raises(DataError, match=r"'interpolated_material'\], got \['segment_0'\]"):
        read_vomp(tmp_path, NAME, original_scale=False)


@pytest.mark.parametrize(
    "voxels", [{"scale": 0.9}, {"scale": 8, "segment": "query_point_material"}]
)
def test_vomps_scale_is_not_guessed(tmp_path: Path, voxels: dict[str, Any]) -> None:
    write_vomp(tmp_path, NAME, **voxels)
    with pytest.raises(DataError, match=r"for coordinates of the mesh give --original-scale$"):
        read_vomp(tmp_path, NAME, original_scale=False)


def test_vomps_fields_must_be_there(tmp_path: Path) -> None:
    path = tmp_path / f"{NAME}.npz"
    for arrays in ({"voxel_data": np.zeros(3)}, {"other": np.zeros(3)}):
        np.savez(path, **arrays)
        with pytest.raises(DataError, match="voxel_data must have the fields"):
            read_vomp(tmp_path, NAME, original_scale=False)


@pytest.mark.parametrize(
    "matrix",
    [
        np.diag([1.0, 1, 2, 1]),
        np.diag([1.0, 1, -1, 1]),
        np.diag([0.0, 0, 0, 1]),
        np.diag([1.0, 1, 1, 2]),
        np.full((4, 4), np.nan),
    ],
)
def test_what_is_no_similarity_is_refused(matrix: np.ndarray) -> None:
    with pytest.raises(DataError, match="expected a rotation, one positive scale"):
        Similarity(matrix)


def test_a_dataparser_that_shears_is_named(tmp_path: Path) -> None:
    shear = [[1, 1, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]
    path = write_json(tmp_path / "d.json", {"transform": shear, "scale": 1.0})
    with pytest.raises(DataError, match=r"d.json: expected a rotation"):
        dataparser(path)


def test_the_dataparser_goes_first_through_r_and_t_then_through_s(tmp_path: Path) -> None:
    turn = [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3]]
    path = write_json(tmp_path / "d.json", {"transform": turn, "scale": 0.5})
    found = dataparser(path)(np.array([[1.0, 0, 0]]))
    np.testing.assert_allclose(found, [[0.5, 1.5, 1.5]])


def place(tmp_path: Path, entry: object) -> Frames:
    path = tmp_path / "t.json"
    path.write_text(json.dumps({NAME: entry}))
    return Frames.read(None, path)


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ([1], "expected a JSON object for each object id"),
        ({"run": "../../etc"}, "run must be a plain name, got '../../etc'"),
        ({"run": ".."}, "run must be a plain name"),
        ({"run": 7}, "run must be a plain name, got 7"),
    ],
)
def test_names_in_a_run_are_plain(tmp_path: Path, entry: object, message: str) -> None:
    with pytest.raises(DataError, match=f"t.json: {NAME}: {message}"):
        place(tmp_path, entry).run_name(NAME)


def test_a_table_of_densities_has_ranges(tmp_path: Path) -> None:
    path = write_json(tmp_path / "d.json", {"Soft Wood": [400, 600], "glass": [2500]})
    with pytest.raises(DataError, match=r"d.json: glass: shape must be \(2,\)"):
        density_table(path)
    write_json(path, {"Soft Wood": [400, 600]})
    assert density_table(path) == {"soft_wood": 0.5}
