"""Residual of a running rig against its model, and live comparison with a simulator."""
