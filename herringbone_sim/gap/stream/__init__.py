"""The residual of a rig while it runs."""
