"""A twin of the published release: its layout, made of phantoms whose inside is known.

Reading order: ``conventions`` (what holds for a whole release, and is told to nobody), ``defects``
(what befalls one mesh), ``pose`` (from the phantom to mesh and volume), ``surface`` and
``texture`` (the mesh), ``volume``, ``attenuation`` (the paper's fit), ``writer`` (files, and the
truth beside them).
"""

from xden_builder.published.twin.conventions import VARIANTS, Conventions, Variant, draw_conventions
from xden_builder.published.twin.writer import truth_path, write_twin

__all__ = [
    "VARIANTS",
    "Conventions",
    "Variant",
    "draw_conventions",
    "truth_path",
    "write_twin",
]
