"""Observations of a gear: residuals of recorded runs against its model, with their columns."""
