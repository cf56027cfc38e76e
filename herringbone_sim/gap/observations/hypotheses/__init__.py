"""Hypotheses: effects of the catalogue, and tolerances, as coefficients of the observations."""
