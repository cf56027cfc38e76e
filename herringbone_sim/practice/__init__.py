"""Practice campaigns with known causes, and the score of what was said about them.

Shares no integrator and no shape of an effect with the diagnosis, so that a tool that knows only
its own shapes is found out.
"""
