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
    from xden1k.hub import data_root, download
    from xden1k.loading import load_dataset
    from xden1k.mass import MassProperties
    from xden1k.predictions import Predictions
    from xden1k.predictor import Predictor
    from xden1k.types import DensityField, DensityObject, Part
    from xden1k.views import ViewGeometry, XRayView

    __version__: str

__all__ = [
    "DataError",
    "DensityField",
    "DensityObject",
    "MassProperties",
    "MissingExtraError",
    "MissingObjectError",
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
]

_MODULE_OF = {
    "DataError": "errors",
    "DensityField": "types",
    "DensityObject": "types",
    "MassProperties": "mass",
    "MissingExtraError": "errors",
    "MissingObjectError": "errors",
    "Part": "types",
    "Predictions": "predictions",
    "Predictor": "predictor",
    "SubmissionError": "errors",
    "ViewGeometry": "views",
    "XDen1K": "dataset",
    "XDenError": "errors",
    "XRayView": "views",
    "collate": "dataset",
    "data_root": "hub",
    "download": "hub",
    "load_dataset": "loading",
}


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
