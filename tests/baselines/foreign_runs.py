"""Runs of the original methods, made up in their formats about an object of known density."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.phantoms import Box
from xden_baselines.adapters.frames import Similarity

ANGLE = (
    Box("stem", (0, 0, 0), (1, 2, 4), 1.2, material="polypropylene"),
    Box("foot", (1, 0, 0), (3, 2, 1), 2.7, material="aluminium"),
)
"""An L: turned or mirrored it does not fit into its place."""
BOX = np.array([[0.0, 0, 0], [3, 2, 4]])
PIXIE_VERTEX = (
    *((axis, "f4") for axis in "xyz"),
    *((channel, "u1") for channel in ("red", "green", "blue", "alpha")),
    *(("part_label", "i4"), ("density", "f4"), ("E", "f4"), ("nu", "f4")),
    *(("material_id", "i4"), ("conf", "f4")),
)
"""Properties of Pixie's PLY files."""
RANGES = {"density_p1": 1.7031893730163574, "density_p99": 3.871432304382324}


def density_kg_m3(points_cm: np.ndarray) -> np.ndarray:
    """Density of the L at points; 0 outside."""
    found = np.zeros(len(points_cm))
    for box in ANGLE:
        inside = ((points_cm >= box.low) & (points_cm <= box.high)).all(axis=1)
        found[inside] = 1000 * box.density_g_cm3
    return found


def cloud(count: int = 40_000, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Points in the L, cm, the corners of its box among them, and their densities."""
    points = np.random.default_rng(seed).uniform(*BOX, (count, 3))
    ends = np.array([[0.0, 0, 0], [0, 2, 4], [3, 2, 1]])
    points = np.concatenate([ends, points[density_kg_m3(points) > 0]])
    return points, density_kg_m3(points)


def ranges(density: np.ndarray) -> np.ndarray:
    """Low and high whose middle is the density."""
    return np.stack([0.8 * density, 1.2 * density], axis=1).astype(np.float32)


def drawn_similarity(seed: int) -> Similarity:
    """Any frame: from it to the object's."""
    rng = np.random.default_rng(seed)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    rotation *= np.linalg.det(rotation)
    return Similarity.made(float(np.exp(rng.uniform(-3, 3))), rotation, rng.normal(size=3))


def write_json(path: Path, value: Any) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(value))
    return path


def write_transforms(path: Path, object_id: str, to_object: Similarity, **more: str) -> Path:
    return write_json(path, {object_id: {"similarity": to_object.matrix.tolist(), **more}})


def write_points(runs: Path, name: str, **changes: np.ndarray) -> Path:
    """``points.npz`` in the object's frame, cm, kg/m³."""
    points, density = cloud()
    path = runs / name / "points.npz"
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, **{"points": points.astype(np.float32), "density": density, **changes})
    return path


def write_nerf2physics(runs: Path, name: str, seed: int = 2) -> None:
    """A scene as nerfstudio and NeRF2Physics' grid mode leave it.

    nerfstudio moves the scene's cameras, metres, into a frame of its own, p -> s (R p + t), and
    exports its point cloud there. NeRF2Physics' ``load_ns_point_cloud`` (utils.py at 6d81c09) puts
    1 / s in the corner of a 4 by 4 matrix with [R|t] on top, inverts it, and lets Open3D apply it,
    which divides by the fourth coordinate; ``predict_physical_property_query`` goes on with what
    comes out.
    """
    points, density = cloud()
    found = drawn_similarity(seed)
    rotation, scale = found.matrix[:3, :3] / found.scale, 0.7
    top = np.concatenate([rotation, [[0.3], [-0.2], [0.1]]], axis=1)
    scene = runs / "scenes" / name
    write_json(
        scene / "ns" / "dataparser_transforms.json", {"transform": top.tolist(), "scale": scale}
    )
    exported = scale * (points / 100 @ top[:, :3].T + top[:, 3])
    loaded = _homogeneous(np.linalg.inv(np.vstack([top, [0, 0, 0, 1 / scale]])), exported)
    np.savez(scene / "points.npz", points=loaded.astype(np.float32), density=ranges(density))
    write_json(runs / "preds" / "preds_mass.json", {name: [0.018, 0.022]})


def _homogeneous(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    found = np.concatenate([points, np.ones((len(points), 1))], axis=1) @ matrix.T
    return found[:, :3] / found[:, 3:]


def write_pugs(runs: Path, name: str) -> None:
    """A scene in metres, as ``predict_property.py`` of PUGS (at edd2c10) leaves it.

    Of the integral by Gaussian volumes: it saves the points of high opacity, the property's low and
    high for each, their shares of the materials, and the colours of all points.
    """
    points, density = cloud()
    folder = runs / "scenes" / name / "pred_result_density"
    folder.mkdir(parents=True)
    np.save(folder / "dense_points.npy", (points / 100).astype(np.float32))
    np.save(folder / "dense_pred_density.npy", ranges(density))
    np.save(folder / "dense_pred_probs.npy", np.ones((len(points), 5), np.float32) / 5)
    np.save(folder / "dense_colors.npy", np.zeros((len(points) + 7, 3)))
    write_json(runs / "preds" / "preds_density.json", {name: [0.01, 0.03]})


def write_vomp(runs: Path, name: str, scale: float = 1.0, segment: str = "voxel_material") -> None:
    """Voxels of the box normalised by centre and longest side, times ``scale``."""
    axis = (np.arange(64) + 0.5) / 64 - 0.5
    normalised = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    density = density_kg_m3(normalised * np.ptp(BOX, axis=0).max() + BOX.mean(axis=0))
    normalised, density = normalised[density > 0] * scale, density[density > 0]
    kinds = [(one, "<f4") for one in ("x", "y", "z", "youngs_modulus", "poissons_ratio", "density")]
    voxels = np.zeros(len(density), dtype=[*kinds, ("segment_id", "<U32")])
    voxels["x"], voxels["y"], voxels["z"] = normalised.T
    voxels["density"], voxels["segment_id"] = density, segment
    runs.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(runs / f"{name}.npz", voxel_data=voxels)


class Pixie:
    """Results, voxel grid and ranges of a Pixie run; its frame is 8 times smaller and moved.

    Channels, scaling and PLY files as ``pixie/voxel/map_pred_to_coords.py`` of vlongle/pixie (at
    6719ab7) reads and writes them: three scaled values, then eight classes.
    """

    step = 1 / 64

    def __init__(self, folder: Path, name: str) -> None:
        self.runs, self.renders, self.name = folder / "runs", folder / "renders", name
        for one in (self.runs, self.renders):
            (one / name).mkdir(parents=True)
        self.ranges = write_json(folder / "normalization_ranges.yaml", RANGES)
        self.to_object = Similarity.made(8.0, None, BOX.mean(axis=0))
        self.indices = np.stack(np.meshgrid(*[np.arange(64)] * 3, indexing="ij"), axis=-1)
        nodes = -0.5 + self.step * self.indices.reshape(-1, 3)
        self.density = density_kg_m3(self.to_object(nodes)).reshape((64,) * 3)
        self.mask = self.density > 0
        np.savez_compressed(
            self.renders / name / "clip_features.npz",
            min_bounds=(-0.5,) * 3,
            max_bounds=(0.5,) * 3,
            voxel_size=self.step,
            feature_dim=768,
            grid_shape=(64, 64, 64),
            alpha_weighted=True,
            alpha_threshold_for_mask=0.01,
        )

    def write(self, background: np.ndarray | None = None) -> None:
        """Arrays; voxels of the mask that are ``background`` get its class and a wrong density."""
        low, high = RANGES["density_p1"], RANGES["density_p99"]
        scaled = 2 * (np.log10(np.where(self.mask, self.density, 100)) - low) / (high - low) - 1
        classes = np.where(self.mask, 0, 7)
        if background is not None:
            classes[background], scaled[background] = 7, 3.0
        found = np.zeros((11, 64, 64, 64), np.float32)
        found[0] = scaled
        found[3:] = np.arange(8)[:, None, None, None] == classes
        np.save(self.runs / self.name / "sample_0_pred.npy", found)
        np.save(self.runs / self.name / "sample_0_mask.npy", self.mask)

    def write_ply(self, file: str = "mapped_preds.ply", to_world: Similarity | None = None) -> None:
        """The PLY file: nodes spread from bound to bound with 63 steps, types mixed."""
        spread = -0.5 + self.indices[self.mask] / 63
        points = spread if to_world is None else to_world(spread)
        vertices = np.zeros(len(points), dtype=[(name, f"<{kind}") for name, kind in PIXIE_VERTEX])
        vertices["x"], vertices["y"], vertices["z"] = points.T
        for channel in ("red", "green", "blue", "alpha"):
            vertices[channel] = 255
        vertices["density"], vertices["E"] = self.density[self.mask], 1e6
        vertices["nu"], vertices["conf"] = 0.3, 0.9
        write_vertices(self.runs / self.name / file, vertices)


def write_ply(path: Path, points: np.ndarray, **properties: np.ndarray) -> None:
    """Binary PLY: coordinates and properties as float32."""
    columns = {**dict(zip("xyz", points.T, strict=True)), **properties}
    vertices = np.zeros(len(points), dtype=[(name, "<f4") for name in columns])
    for name, values in columns.items():
        vertices[name] = values
    write_vertices(path, vertices)


def write_vertices(path: Path, vertices: np.ndarray) -> None:
    """Binary PLY of a structured array, as plyfile writes one."""
    words = {"f4": "float", "u1": "uchar", "i4": "int"}
    lines = "".join(f"property {words[kind[1:]]} {name}\n" for name, kind in vertices.dtype.descr)
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n{lines}end_header\n"
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(head.encode() + vertices.tobytes())


def edit_npz(path: Path, change: Callable[[dict[str, np.ndarray]], object]) -> None:
    with np.load(path) as found:
        arrays = dict(found)
    change(arrays)
    np.savez(path, **arrays)
