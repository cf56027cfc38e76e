"""Residual of a rig, and comparison with a simulator, while both run."""
