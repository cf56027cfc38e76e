"""Size of the gap before and after: as residual, short-horizon prediction and attractor."""
