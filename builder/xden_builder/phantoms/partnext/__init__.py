"""Simulated materials on shapes of PartNeXt: annotated surfaces become closed, disjoint solids.

The format is as its authors publish it; no file of theirs has been read yet. Reading order:
``annotations`` (rows, found and indexed), ``model`` (a GLB and its masks), ``surface`` (points on
it), ``flood`` (what lies inside), ``solids`` (parts, walls and what fills the rest), ``priors``
(what a part of some name may be made of), ``phantom`` (one object), ``writer`` (captures, or the
truth).
"""
