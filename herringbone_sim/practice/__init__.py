"""Practice campaigns with known causes, and the score of what was said about them.

Shares no integrator and no law of an effect with the diagnosis: laws are drawn from families of
curves, noise from all kinds of sensors, so that a tool that knows only its own is found out.
"""
