"""How well objects are rebuilt, where the truth is known: on simulated captures."""
