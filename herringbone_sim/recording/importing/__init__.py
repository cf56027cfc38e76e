"""Import files of other programs as a campaign, driven by a specification file (spec)."""
