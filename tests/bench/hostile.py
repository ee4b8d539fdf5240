"""Submissions crafted to crash, stall, fill or fool the benchmark, each with what it must be told.

Every one is built by code from a sound submission, in the two modules imported here.
"""

from tests.bench import hostile_archives, hostile_contents
from tests.bench.crafting import CASES, LANDMINE, Case, Sound

__all__ = ["CASES", "LANDMINE", "Case", "Sound", "hostile_archives", "hostile_contents"]
