"""Ways in: where the data is, ``datasets`` rows, torch samples, what a method may touch."""
