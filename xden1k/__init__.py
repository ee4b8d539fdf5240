"""XDen-1K: biplanar X-rays, part meshes and volumetric density of everyday objects.

Importing it takes 20 ms: each name below is loaded when it is first used. It also makes
``datasets.load_dataset("xden1k")`` work, see :mod:`xden1k.alias`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from xden1k import alias as _alias

if TYPE_CHECKING:
    from xden1k.dataset import XDen1K, collate
    from xden1k.errors import (
        DataError,
        MissingExtraError,
        MissingObjectError,
        SubmissionError,
        XDenError,
    )
    from xden1k.folder import open_folder, write_folder
    from xden1k.hub import data_root, download
    from xden1k.loading import load_dataset
    from xden1k.mass import MassProperties
    from xden1k.materials import Material, load_materials
    from xden1k.modality import ModalityError
    from xden1k.predictions import Predictions, open_predictions, write_predictions
    from xden1k.predictor import Example, Predictor
    from xden1k.types import DensityField, DensityObject, Part
    from xden1k.verify import verify_folder
    from xden1k.views import ViewGeometry, XRayView

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
    "download",
    "load_dataset",
    "load_materials",
    "open_folder",
    "open_predictions",
    "verify_folder",
    "write_folder",
    "write_predictions",
]

_NAMES_OF = {
    "dataset": ("XDen1K", "collate"),
    "errors": (
        "DataError",
        "MissingExtraError",
        "MissingObjectError",
        "SubmissionError",
        "XDenError",
    ),
    "folder": ("open_folder", "write_folder"),
    "hub": ("data_root", "download"),
    "loading": ("load_dataset",),
    "mass": ("MassProperties",),
    "materials": ("Material", "load_materials"),
    "modality": ("ModalityError",),
    "predictions": ("Predictions", "open_predictions", "write_predictions"),
    "predictor": ("Example", "Predictor"),
    "types": ("DensityField", "DensityObject", "Part"),
    "verify": ("verify_folder",),
    "views": ("ViewGeometry", "XRayView"),
}
_MODULE_OF = {name: module for module, names in _NAMES_OF.items() for name in names}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        value: Any = import_module("importlib.metadata").version(__name__)
    elif name in _MODULE_OF:
        value = getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


_alias.register()
