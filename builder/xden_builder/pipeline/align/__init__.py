"""Registration alone: meshes into the scanner's frame, with a page to look at."""
