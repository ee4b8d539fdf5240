"""Phantoms: simulated objects whose inside is known, and the scanner that takes their radiographs.

Reading order: ``shapes`` and ``skins`` (a vocabulary of solids), ``archetypes`` (objects built of
them), ``catalogue`` (which there are, of what), ``phantom`` (one object), ``scanner`` (its
radiographs), ``writer`` and ``truth`` (files), ``gallery`` (to look at).
"""
