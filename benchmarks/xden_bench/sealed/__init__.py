"""Hidden truth: inputs published without answers, and the answers sealed for the organiser.

A sealed dataset is three things. A public dataset folder, in which a part of the test split has
become the split ``private`` and holds inputs alone. ``commitments.json`` in it: a salted checksum
of each private object's answers, which nobody can change afterwards or guess from. And
``sealed-truth.xden``, the answers themselves, which only the key opens.
"""

from xden_bench.sealed.check import check_sealed
from xden_bench.sealed.container import SealedTruth
from xden_bench.sealed.key import Key, read_key, write_key
from xden_bench.sealed.publish import Sealing, seal
from xden_bench.sealed.reference import InputsReference, SealedReference

__all__ = [
    "InputsReference",
    "Key",
    "SealedReference",
    "SealedTruth",
    "Sealing",
    "check_sealed",
    "read_key",
    "seal",
    "write_key",
]
