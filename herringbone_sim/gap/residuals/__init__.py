"""Residuals of the nominal gear, recalibrated inside its tolerances, against a recording."""
