"""Forces and accelerations that effects of the catalogue would cause at the recorded motion."""
