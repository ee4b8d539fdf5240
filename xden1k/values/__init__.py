"""The dataset as values: views, parts, fields, objects, materials, and their physics."""
