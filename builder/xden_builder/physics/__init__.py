"""X-ray sources, their spectra, and what matter does to them."""
