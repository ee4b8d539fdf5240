"""Pictures of phantoms in which a material can be seen: light, reflection, clarity and grain."""
