"""Our kernel against other integrators: every row in one run, on the same work."""
