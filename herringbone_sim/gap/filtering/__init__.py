"""The same where only suns and carrier are seen: a filter of the gear."""
