"""Reading a capture folder: what came off the scanner and the annotation desk."""
