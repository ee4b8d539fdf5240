"""How long scoring and loading take, as ratios in one run, and what memory loading needs."""
