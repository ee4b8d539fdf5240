"""Small folders in the layout in which PartNeXt's authors publish it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import trimesh

Masks = dict[str, dict[str, list[int]]]


def box(size: Sequence[float], at: Sequence[float] = (0, 0, 0)) -> trimesh.Trimesh:
    return trimesh.creation.box(size).apply_translation(at)


def lidless(size: Sequence[float]) -> tuple[list[int], list[int]]:
    """Faces of a box, glTF's y up: all but its top, and its top."""
    top = box(size).triangles_center[:, 1] > 0.49 * size[1]
    return np.flatnonzero(~top).tolist(), np.flatnonzero(top).tolist()


def row(
    model_id: str,
    meshes: Sequence[trimesh.Trimesh],
    masks: Masks,
    names: Sequence[str],
    **changed: Any,
) -> dict[str, Any]:
    """One row: leaves of a table's tree with masks 0, 1, ..."""
    leaves = [
        {"name": name, "nodeId": place + 1, "refNodeId": place + 1, "maskId": place}
        for place, name in enumerate(names)
    ]
    tree = [{"name": "Table", "nodeId": 0, "refNodeId": 0, "children": leaves}]
    counts = {str(place): len(mesh.faces) for place, mesh in enumerate(meshes)}
    values = {"mesh_face_num": counts, "masks": masks, "hierarchyList": tree}
    told: dict[str, Any] = {
        "model_id": model_id,
        "type_id": "000-000",
        "user_id": "7",
        "anno_time": "61.5",
        **{name: json.dumps(value) for name, value in values.items()},
    }
    return told | changed


def write_glb(folder: Path, model_id: str, meshes: Sequence[trimesh.Trimesh]) -> Path:
    path = folder / "glbs" / "000-000" / f"{model_id}.glb"
    path.parent.mkdir(parents=True, exist_ok=True)
    scene = trimesh.Scene()
    for place, mesh in enumerate(meshes):
        scene.add_geometry(mesh, node_name=f"node_{place}", geom_name=f"mesh_{place}")
    scene.export(path)
    return path


def write_rows(folder: Path, rows: Sequence[Mapping[str, Any]], kind: str = "parquet") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"train.{kind}"
    table = None if kind == "jsonl" else pa.Table.from_pylist([dict(each) for each in rows])
    if kind == "jsonl":
        path.write_text("".join(json.dumps(each) + "\n" for each in rows))
    elif kind == "parquet":
        pq.write_table(table, path, row_group_size=2)
    else:
        with pa.OSFile(str(path), "wb") as file, pa.ipc.new_stream(file, table.schema) as stream:
            stream.write_table(table, max_chunksize=2)
    return path


def case_and_lid(model_id: str) -> tuple[list[trimesh.Trimesh], dict[str, Any]]:
    """A box of one mesh, divided into a case of five sides and a lid."""
    size = (1.0, 0.6, 0.8)
    case, lid = lidless(size)
    meshes = [box(size)]
    return meshes, row(
        model_id, meshes, {"0": {"0": case}, "1": {"0": lid}}, ["Case", "Wooden Lid"]
    )


def hammer(model_id: str) -> tuple[list[trimesh.Trimesh], dict[str, Any]]:
    """Two meshes, each a part, the handle through the head."""
    meshes = [box((0.2, 1.6, 0.2)), box((0.9, 0.4, 0.5), (0, 0.7, 0))]
    masks = {str(k): {str(k): list(range(12))} for k in range(2)}
    return meshes, row(model_id, meshes, masks, ["Handle", "Steel Head"])


def write_snapshot(folder: Path, kind: str = "parquet") -> Path:
    """Two good models."""
    rows = []
    for make, model_id in ((case_and_lid, "aaaa01"), (hammer, "bbbb02")):
        meshes, told = make(model_id)
        write_glb(folder, model_id, meshes)
        rows.append(told)
    write_rows(folder / "data", rows, kind)
    return folder
