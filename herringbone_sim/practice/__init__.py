"""Simulated practice campaigns with known causes, and the score of diagnoses made of them.

Shares no integrator and no effect law with the diagnosis: laws are drawn from families of curves
and noise from all kinds of sensors, so that a diagnosis that only knows its own models is exposed.
"""
