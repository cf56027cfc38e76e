"""What the Rerun viewer shows, live and from recordings."""
