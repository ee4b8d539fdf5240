"""Phantoms: simulated objects whose inside is known, and the scanner that takes their radiographs.

Reading order: ``shapes`` and ``skins`` (a vocabulary of solids), ``archetypes`` (objects built of
them), ``catalogue`` (which there are, of what), ``phantom`` (one object), ``scanner`` (its
radiographs), ``posing`` (where it lies, and in which frame its meshes come), ``writer``, ``grid``,
``glb`` and ``truth`` (files), ``check`` (of a whole set), ``sheet`` (to look at), ``peer``
(captures by another simulator), ``partnext`` (objects on others' shapes).
"""

from xden_builder.phantoms.catalogue import CATALOGUE, Category
from xden_builder.phantoms.phantom import Phantom, PhantomPart, Plan, make_phantom, plan_objects
from xden_builder.phantoms.posing import Posing
from xden_builder.phantoms.scanner import Scanner
from xden_builder.phantoms.sheet import gallery
from xden_builder.phantoms.truth import truth_object, write_truth_dataset
from xden_builder.phantoms.writer import write_captures

__all__ = [
    "CATALOGUE",
    "Category",
    "Phantom",
    "PhantomPart",
    "Plan",
    "Posing",
    "Scanner",
    "gallery",
    "make_phantom",
    "plan_objects",
    "truth_object",
    "write_captures",
    "write_truth_dataset",
]
