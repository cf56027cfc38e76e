"""Motion and diagnoses in the Rerun viewer, live and from recordings."""
