"""How far the gap shrinks: residual, short prediction, attractor."""
