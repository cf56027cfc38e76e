"""Size of the gap of nominal and augmented model: as residual, prediction and attractor."""
