"""Simulate practice campaigns with known causes, and score diagnoses of them.

The package shares no integrator and no effect law with the diagnosis: laws are drawn from families
of curves and noise from models of many kinds of sensors. A diagnosis that only fits its own models
therefore scores badly.
"""
