"""Pictures of what methods say of objects."""
