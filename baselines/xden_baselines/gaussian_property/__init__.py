"""GaussianProperty style: masks in each view, one material for each, a vote in 3D."""
