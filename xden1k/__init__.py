"""XDen-1K: biplanar X-rays, part meshes and volumetric density of everyday objects."""
