"""XDen-1K: biplanar X-rays, part meshes and volumetric density of everyday objects.

Importing it takes 20 ms: each name below is loaded when it is first used. It also makes
``datasets.load_dataset("xden1k")`` work, see :mod:`xden1k.access.alias`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

import xden1k.access.alias as _alias

if TYPE_CHECKING:
    from xden1k.access.conversion import decode, to_plain, to_tensors
    from xden1k.access.dataset import XDen1K, collate
    from xden1k.access.geometry import project, projection_matrix, view_geometry
    from xden1k.access.hub import data_root, download
    from xden1k.access.loading import load_dataset
    from xden1k.access.objects import open_object
    from xden1k.errors import (
        DataError,
        MissingExtraError,
        MissingObjectError,
        SubmissionError,
        XDenError,
    )
    from xden1k.folder import open_folder, write_folder
    from xden1k.folder.verify import verify_folder
    from xden1k.predictions import Predictions, open_predictions, write_predictions
    from xden1k.predictor import Example, Predictor
    from xden1k.rays.reprojection import reprojected
    from xden1k.values.mass import MassProperties
    from xden1k.values.materials import Material, load_materials
    from xden1k.values.modality import ModalityError
    from xden1k.values.types import DensityField, DensityObject, Part
    from xden1k.values.views import ViewGeometry, XRayView

    __version__: str

__all__ = [
    "DataError",
    "DensityField",
    "DensityObject",
    "Example",
    "MassProperties",
    "Material",
    "MissingExtraError",
    "MissingObjectError",
    "ModalityError",
    "Part",
    "Predictions",
    "Predictor",
    "SubmissionError",
    "ViewGeometry",
    "XDen1K",
    "XDenError",
    "XRayView",
    "__version__",
    "collate",
    "data_root",
    "decode",
    "download",
    "load_dataset",
    "load_materials",
    "open_folder",
    "open_object",
    "open_predictions",
    "project",
    "projection_matrix",
    "reprojected",
    "to_plain",
    "to_tensors",
    "verify_folder",
    "view_geometry",
    "write_folder",
    "write_predictions",
]

_NAMES_OF = {
    "access.conversion": ("decode", "to_plain", "to_tensors"),
    "access.dataset": ("XDen1K", "collate"),
    "access.geometry": ("project", "projection_matrix", "view_geometry"),
    "errors": (
        "DataError",
        "MissingExtraError",
        "MissingObjectError",
        "SubmissionError",
        "XDenError",
    ),
    "folder": ("open_folder", "write_folder"),
    "access.hub": ("data_root", "download"),
    "access.loading": ("load_dataset",),
    "access.objects": ("open_object",),
    "rays.reprojection": ("reprojected",),
    "values.mass": ("MassProperties",),
    "values.materials": ("Material", "load_materials"),
    "values.modality": ("ModalityError",),
    "predictions": ("Predictions", "open_predictions", "write_predictions"),
    "predictor": ("Example", "Predictor"),
    "values.types": ("DensityField", "DensityObject", "Part"),
    "folder.verify": ("verify_folder",),
    "values.views": ("ViewGeometry", "XRayView"),
}
_MODULE_OF = {name: module for module, names in _NAMES_OF.items() for name in names}

_EXTRA_OF = {"manifold3d": "build", "numba": "build"}

if not TYPE_CHECKING:  # else every misspelt name would pass for Any

    def __getattr__(name: str) -> Any:
        if name == "__version__":
            value: Any = import_module("importlib.metadata").version(__name__)
        elif name in _MODULE_OF:
            value = getattr(_module(name), name)
        else:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        globals()[name] = value
        return value


def _module(name: str) -> Any:
    """Import the module of a public name."""
    try:
        return import_module(f"{__name__}.{_MODULE_OF[name]}")
    except ModuleNotFoundError as err:
        if not err.name or err.name.startswith(__name__):
            raise
        errors = import_module("xden1k.errors")
        extra = _EXTRA_OF.get(err.name)
        command = errors.install_command(extra) if extra else f"pip install {err.name}"
        raise errors.MissingExtraError(f"xden1k.{name} needs {err.name}: {command}") from err


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


_alias.register()
