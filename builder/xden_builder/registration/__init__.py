"""Registration: meshes in any frame onto their two radiographs."""
