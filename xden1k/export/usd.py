"""OpenUSD with its physics schema: one rigid body, m, kg, z up, as text.

The mass is the root's alone: it outranks any density, and a parent's outranks its children's. The
density of each part is kept as custom data, where no simulator reads it. Inertia needs both
attributes, moments and axes; moments alone are taken along the object's axes, and none at all are
made up from the collision shapes.
"""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any, Final

import numpy as np
import trimesh

from xden1k.errors import DataError, require
from xden1k.export.body import Body, Shape
from xden1k.export.si import KG_M3_PER_G_CM3, Inertial, Matrix

__all__ = ["SUFFIX", "check", "expected", "read", "write"]

SUFFIX: Final = ".usda"


def _pxr(name: str) -> Any:
    """One of the modules of usd-core."""
    require("pxr", "usd")
    return importlib.import_module(f"pxr.{name}")


def write(body: Body, path: Path) -> None:
    """Write the stage."""
    geom, physics = _pxr("UsdGeom"), _pxr("UsdPhysics")
    stage = _pxr("Usd").Stage.CreateNew(str(path))
    geom.SetStageUpAxis(stage, geom.Tokens.z)
    geom.SetStageMetersPerUnit(stage, 1.0)
    physics.SetStageKilogramsPerUnit(stage, 1.0)
    root = geom.Xform.Define(stage, f"/{body.name}").GetPrim()
    root.SetDisplayName(body.obj.object_id)
    stage.SetDefaultPrim(root)
    physics.RigidBodyAPI.Apply(root)
    _mass(physics.MassAPI.Apply(root), body.inertial)
    for scope in ("looks", "visual", "collision"):
        geom.Scope.Define(stage, root.GetPath().AppendChild(scope))
    for shape in body.shapes:
        _visual(stage, root.GetPath(), shape)
        for number, hull in enumerate(shape.collision):
            place = root.GetPath().AppendPath(f"collision/{shape.name}_hull{number}")
            felt = _mesh(geom, stage, place, hull)
            felt.CreatePurposeAttr(geom.Tokens.guide)
            physics.CollisionAPI.Apply(felt.GetPrim())
            physics.MeshCollisionAPI.Apply(felt.GetPrim()).CreateApproximationAttr("convexHull")
    stage.GetRootLayer().comment = "Mass, centre and inertia are exact; shapes have none."
    if not stage.GetRootLayer().Save():
        raise DataError(f"{path}: cannot be written")


def _mass(api: Any, inertial: Inertial) -> None:
    gf = _pxr("Gf")
    moments, axes = inertial.principal()
    w, x, y, z = _quaternion(axes)
    api.CreateMassAttr(inertial.mass_kg)
    api.CreateCenterOfMassAttr(gf.Vec3f(*inertial.com_m.tolist()))
    api.CreateDiagonalInertiaAttr(gf.Vec3f(*moments.tolist()))
    api.CreatePrincipalAxesAttr(gf.Quatf(w, x, y, z))


def _quaternion(axes: Matrix) -> tuple[float, float, float, float]:
    """Return w, x, y, z of a right-handed frame."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(axes).as_quat().tolist()
    return w, x, y, z


def _visual(stage: Any, root: Any, shape: Shape) -> None:
    geom, shade, sdf, gf = _pxr("UsdGeom"), _pxr("UsdShade"), _pxr("Sdf"), _pxr("Gf")
    color = gf.Vec3f(*shape.part.color_rgb)
    seen = _mesh(geom, stage, root.AppendPath(f"visual/{shape.name}"), shape.visual)
    seen.CreateDisplayColorAttr([color])
    prim = seen.GetPrim()
    prim.SetDisplayName(shape.part.name)
    prim.SetCustomDataByKey("density_kg_m3", KG_M3_PER_G_CM3 * shape.part.density_g_cm3)
    prim.SetCustomDataByKey("material", shape.part.material)
    place = root.AppendPath(f"looks/{shape.name}")
    material = shade.Material.Define(stage, place)
    shader = shade.Shader.Define(stage, place.AppendChild("surface"))
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("diffuseColor", sdf.ValueTypeNames.Color3f).Set(color)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    shade.MaterialBindingAPI.Apply(prim).Bind(material)


def _mesh(geom: Any, stage: Any, place: Any, mesh: trimesh.Trimesh) -> Any:
    vt = _pxr("Vt")
    made = geom.Mesh.Define(stage, place)
    points = np.asarray(mesh.vertices, dtype=np.float32)
    made.CreatePointsAttr(vt.Vec3fArray.FromNumpy(points))
    made.CreateFaceVertexCountsAttr(vt.IntArray(len(mesh.faces), 3))
    faces = np.asarray(mesh.faces, dtype=np.int32).reshape(-1)
    made.CreateFaceVertexIndicesAttr(vt.IntArray.FromNumpy(faces))
    made.CreateSubdivisionSchemeAttr(geom.Tokens.none)
    made.CreateExtentAttr(
        vt.Vec3fArray.FromNumpy(np.stack([points.min(axis=0), points.max(axis=0)]))
    )
    return made


def expected(body: Body) -> Inertial:
    """Return what a reader should find."""
    return body.inertial


def read(path: Path, body: Body) -> Inertial:
    """Read the root's mass attributes.

    Raises
    ------
    DataError
        If the units are others, or the root has no whole mass.
    MissingExtraError
        If usd-core is not installed.
    """
    geom, physics = _pxr("UsdGeom"), _pxr("UsdPhysics")
    stage = _pxr("Usd").Stage.Open(_pxr("Sdf").Layer.OpenAsAnonymous(str(path)))
    units = geom.GetStageMetersPerUnit(stage), physics.GetStageKilogramsPerUnit(stage)
    if units != (1.0, 1.0):
        raise DataError(f"{path}: expected metersPerUnit and kilogramsPerUnit 1, got {units}")
    api = physics.MassAPI(stage.GetDefaultPrim())
    turn = api.GetPrincipalAxesAttr().Get()
    if turn is None or not stage.GetDefaultPrim().HasAPI(physics.RigidBodyAPI):
        raise DataError(f"{path}: its root is no rigid body with principal axes")
    return Inertial.of_principal(
        float(api.GetMassAttr().Get()),
        np.array(api.GetCenterOfMassAttr().Get(), dtype=np.float64),
        np.array(api.GetDiagonalInertiaAttr().Get(), dtype=np.float64),
        _matrix([turn.GetReal(), *turn.GetImaginary()]),
    )


def _matrix(quaternion: list[float]) -> Matrix:
    from scipy.spatial.transform import Rotation

    w, x, y, z = quaternion
    matrix: Matrix = Rotation.from_quat([x, y, z, w]).as_matrix()
    return matrix


def check(path: Path, body: Body) -> Inertial:
    """Run every validator of usd-core, and read the mass.

    Raises
    ------
    DataError
        If one of them finds an error.
    MissingExtraError
        If usd-core is not installed.
    """
    validation = _pxr("UsdValidation")
    validators = validation.ValidationRegistry().GetOrLoadAllValidators()
    stage = _pxr("Usd").Stage.Open(_pxr("Sdf").Layer.OpenAsAnonymous(str(path)))
    for error in validation.ValidationContext(validators).Validate(stage):
        if error.GetType() != validation.ValidationErrorType.Warn:
            raise DataError(f"{path}: {error.GetErrorAsString()}")
    return read(path, body)
