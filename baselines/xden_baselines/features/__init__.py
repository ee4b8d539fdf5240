"""Encoders of picture patches and material names into one space, and their fusion in 3D."""
