"""Captures in, a dataset folder out: many objects, resumably, here or on a cluster."""
