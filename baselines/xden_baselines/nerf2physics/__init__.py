"""NeRF2Physics-style prediction: surface features, candidate materials, kernel regression."""
